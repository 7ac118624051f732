"""Early warning: whether a race still finds better configurations, and what it looks like if not.

The best of an iteration is compared with that of an earlier one on the instances that both have seen. The newer one was
chosen because it is good on these, which flatters it: a gain that cannot be told from chance even so is none to wait
for. So a race that has had none for some iterations, and for a good part of its budget, is said to stagnate.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtrc, stdtrit

from mercator_design.race.racing.statistics import concordance
from mercator_design.race.racing.summary import IterationSummary

PATIENCE = 3
"""Iterations without a gain that are told ..."""
SHARE = 0.4
"""... if they took as much of the budget: a race that improves often pauses for less, and its last ones are small."""
_ALPHA = 0.05


def is_better(costs: Mapping[int, float], earlier: Mapping[int, float]) -> bool:
    """Whether costs are lower than others on their common instances by more than chance (paired t-test, 5 %).

    Whatever was accepted is better than what was rejected since.
    """
    if any(map(math.isinf, earlier.values())):
        return True
    common = sorted(costs.keys() & earlier.keys())
    gains = np.array([earlier[instance] - costs[instance] for instance in common])
    n = len(gains)
    if n < 2:
        return False
    return bool(gains.mean() > stdtrit(n - 1, 1 - _ALPHA) * gains.std(ddof=1) / math.sqrt(n))


def agreement(costs: Sequence[Mapping[int, float]]) -> tuple[float, float] | None:
    """How far instances agree on configurations that were not chosen for how they do there.

    Gives Kendall's W on the instances that all have seen, and the probability that instances which know no difference
    agree so well (Friedman's test); NaN and 1 if all costs of each instance are equal; None if there are not two
    configurations, or not two instances that all have seen.

    Args:
        costs: of each configuration, by instance.
    """
    common = sorted(set.intersection(*(set(own) for own in costs))) if costs else []
    n, k = len(common), len(costs)
    if min(n, k) < 2:
        return None
    table = np.array([[own[instance] for own in costs] for instance in common])
    if (np.ptp(table, axis=1) == 0).all():
        return math.nan, 1.0
    kendall = concordance(table).kendall
    return kendall, float(chdtrc(k - 1, n * (k - 1) * kendall))


def judged(
    iteration: IterationSummary,
    earlier: Sequence[IterationSummary],
    costs: Callable[[int], Mapping[int, float]],
    newcomers: Sequence[int],
    budget: int,
) -> IterationSummary:
    """An iteration that has ended, with how long there was no gain, and what a user should know.

    Args:
        iteration: That has ended.
        earlier: Those before it.
        costs: Of a configuration, by instance.
        newcomers: Configurations that it raced first.
        budget: Of the whole race.
    """
    accepted = [own for own in map(costs, newcomers) if not any(map(math.isinf, own.values()))]
    found = agreement(accepted)
    iteration = replace(iteration, newcomers_differ=found is None or found[1] < _ALPHA)
    if not earlier:
        return replace(iteration, note=_of_the_first(found))
    before = earlier[-1 - earlier[-1].stagnant]
    if is_better(costs(iteration.best), costs(before.best)):
        return iteration
    idle = [*earlier[len(earlier) - earlier[-1].stagnant :], iteration]
    is_long = len(idle) >= PATIENCE and sum(one.used for one in idle) >= SHARE * budget
    is_new = not any(one.note for one in idle)
    return replace(iteration, stagnant=len(idle), note=_of_stagnation(before, idle) if is_long and is_new else "")


def _of_the_first(found: tuple[float, float] | None) -> str:
    if found is None:
        return (
            "too few configurations of the first iteration were accepted, or ran on common instances, to say whether "
            "instances tell them apart"
        )
    kendall, p_value = found
    if p_value < _ALPHA:
        return ""
    if math.isnan(kendall):
        return "all configurations of the first iteration cost the same: there is nothing to learn from yet"
    return (
        "the instances rank the configurations of the first iteration no more alike than chance would (Kendall's W "
        f"{kendall:.2g}, p = {p_value:.2g}): as few instances as these do not tell them apart"
    )


def _of_stagnation(before: IterationSummary, idle: Sequence[IterationSummary]) -> str:
    best = idle[-1].best
    if best == before.best:
        what = f"the best is still configuration {best}"
    else:
        what = f"configuration {best} cannot be told from {before.best}, the best then"
    restarts = sum(one.soft_restart for one in idle)
    alike = sum(not one.newcomers_differ for one in idle)
    return (
        f"no gain in {len(idle)} iterations, since iteration {before.iteration}: {what}"
        + (f"; in {restarts} of them newcomers repeated what there was (soft restarts)" if restarts else "")
        + (f"; in {alike} of them the instances could not tell the newcomers apart" if alike else "")
    )
