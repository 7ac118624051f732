"""Which configurations race once more when budget is left after the last iteration (irace's psRace.R)."""

from collections.abc import Mapping, Sequence

import numpy as np

_MAX_COMBINED = 16
"""Candidates whose combinations are tried."""


def select_candidates(needs: Mapping[int, int], budget: int, each_test: int | None) -> list[int]:
    """Those to race, or none if fewer than two fit.

    Preferably as many as can run on new instances; if the budget is too small for that, all that are complete
    and as many as can be completed.

    Args:
        needs: Candidate -> instances it has not been run on, the best candidates first.
        budget: Experiments that are left.
        each_test: New instances that are worth beginning with, None if there are none.
    """
    needs = {candidate: need for candidate, need in needs.items() if need <= budget}
    complete = [candidate for candidate, need in needs.items() if need == 0]
    if each_test is not None:
        n_on_new = budget // each_test
        if 1 < n_on_new <= len(complete):
            return complete[:n_on_new]
        candidates = list(needs)[:_MAX_COMBINED]
        on_new = _largest_fitting(candidates, [needs[c] + each_test for c in candidates], budget, fewest=2)
        if on_new:
            return on_new
    incomplete = [candidate for candidate, need in needs.items() if need > 0][:_MAX_COMBINED]
    completed = _largest_fitting(incomplete, [needs[c] for c in incomplete], budget, fewest=1)
    chosen = complete + completed
    return chosen if len(chosen) > 1 else []


def _largest_fitting(candidates: Sequence[int], prices: Sequence[int], budget: int, *, fewest: int) -> list[int]:
    """The most candidates whose prices fit the budget; of equally many those with the best of all."""
    numbers = np.arange(1 << len(candidates))
    members = (numbers[:, np.newaxis] >> np.arange(len(candidates))) & 1  # one combination a row, the best in bit 0
    sizes = members.sum(axis=1)
    fitting = np.flatnonzero((sizes >= fewest) & (members @ np.array(prices, dtype=int) <= budget))
    if len(fitting) == 0:
        return []
    without_best = 1 - members[fitting, 0]
    chosen = fitting[np.lexsort((fitting, without_best, -sizes[fitting]))[0]]
    return [candidate for candidate, member in zip(candidates, members[chosen], strict=True) if member]
