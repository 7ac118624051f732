"""Post-selection: which configurations race again if budget is left after the last iteration (irace's psRace.R)."""

from collections.abc import Mapping, Sequence

import numpy as np

_MAX_COMBINED = 16
"""Number of candidates whose combinations are tried."""


def select_candidates(needs: Mapping[int, int], budget: int, each_test: int | None) -> list[int]:
    """Select the configurations to race; none if the budget suffices for fewer than two.

    As many as possible run on new instances. If the budget is too small for that, select all that are complete, and as
    many others as can be completed.

    Args:
        needs: For each candidate the number of instances that it lacks, the best candidates first.
        budget: Experiments that are left.
        each_test: New instances to begin with; None if there are none.
    """
    needs = {candidate: need for candidate, need in needs.items() if need <= budget}
    complete = [candidate for candidate, need in needs.items() if need == 0]
    if each_test is not None:
        n_on_new = budget // each_test
        if 1 < n_on_new <= len(complete):
            return complete[:n_on_new]
        candidates = list(needs)[:_MAX_COMBINED]
        on_new = _largest_fitting(candidates, [needs[c] + each_test for c in candidates], budget, min_size=2)
        if on_new:
            return on_new
    incomplete = [candidate for candidate, need in needs.items() if need > 0][:_MAX_COMBINED]
    completed = _largest_fitting(incomplete, [needs[c] for c in incomplete], budget, min_size=1)
    chosen = complete + completed
    return chosen if len(chosen) > 1 else []


def _largest_fitting(candidates: Sequence[int], prices: Sequence[int], budget: int, *, min_size: int) -> list[int]:
    """The largest set of candidates that the budget allows; of equally large sets, one with the best candidate."""
    numbers = np.arange(1 << len(candidates))
    members = (numbers[:, np.newaxis] >> np.arange(len(candidates))) & 1  # one combination a row, the best in bit 0
    sizes = members.sum(axis=1)
    fitting = np.flatnonzero((sizes >= min_size) & (members @ np.array(prices, dtype=int) <= budget))
    if len(fitting) == 0:
        return []
    without_best = 1 - members[fitting, 0]
    chosen = fitting[np.lexsort((fitting, without_best, -sizes[fitting]))[0]]
    return [candidate for candidate, member in zip(candidates, members[chosen], strict=True) if member]
