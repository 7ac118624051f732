"""Whether a race stagnates: whether it no longer finds better configurations.

The best configuration of an iteration is compared with the best of an earlier one, on the instances that both have
seen, or on all if these are few. The newer one was selected on its instances, so the comparison favours a gain. If
there is still no significant gain for some iterations and for a large part of the budget, the race stagnates.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
import scipy

from mercator_design.arrays import Floats
from mercator_design.race.elimination.statistics import concordance
from mercator_design.race.elimination.summary import IterationSummary

MIN_ITERATIONS = 3
"""Minimum number of iterations without a gain before a note is written."""
MIN_SHARE = 0.4
"""Minimum share of the budget that these iterations have used: a race that improves has short pauses, too."""
_ALPHA = 0.05
_MIN_COMMON = 0.5
"""Part of the instances of one of two configurations that a paired test needs."""


def is_better(costs: Mapping[int, float], earlier: Mapping[int, float]) -> bool:
    """Whether costs are significantly lower than earlier ones (5 %).

    By a paired t-test on common instances; by Welch's test on all instances if few are common. A configuration
    that has since been rejected (infinite cost) is worse than any other.
    """
    if any(map(math.isinf, earlier.values())):
        return True
    common = sorted(costs.keys() & earlier.keys())
    if len(common) < _MIN_COMMON * min(len(costs), len(earlier)):
        return _is_lower(np.array(list(costs.values())), np.array(list(earlier.values())))
    gains = np.array([earlier[instance] - costs[instance] for instance in common])
    n = len(gains)
    if n < 2:
        return False
    return bool(gains.mean() > scipy.special.stdtrit(n - 1, 1 - _ALPHA) * gains.std(ddof=1) / math.sqrt(n))


def _is_lower(costs: Floats, earlier: Floats) -> bool:
    """Welch's test of independent costs."""
    if min(len(costs), len(earlier)) < 2:
        return False
    gain = float(earlier.mean() - costs.mean())
    parts = [float(one.var(ddof=1)) / len(one) for one in (costs, earlier)]
    variance = sum(parts)
    if variance == 0:
        return gain > 0
    shift = -math.frexp(variance)[1]  # a power of two changes no digit, but squares neither overflow nor underflow
    total, *scaled = (math.ldexp(one, shift) for one in (variance, *parts))
    freedom = total**2 / sum(part**2 / (len(one) - 1) for part, one in zip(scaled, (costs, earlier), strict=True))
    return bool(gain > scipy.special.stdtrit(freedom, 1 - _ALPHA) * math.sqrt(variance))


def agreement(costs: Sequence[Mapping[int, float]]) -> tuple[float, float] | None:
    """How well instances agree on configurations that were not selected on these instances.

    Returns Kendall's W on the instances that all configurations have seen, and the p-value of Friedman's test. Returns
    NaN and 1 if all costs on each instance are equal. Returns None if there are fewer than two configurations, or fewer
    than two common instances.

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
    kendall = concordance(table)
    return kendall, float(scipy.special.chdtrc(k - 1, n * (k - 1) * kendall))


def judged(
    iteration: IterationSummary,
    earlier: Sequence[IterationSummary],
    costs: Callable[[int], Mapping[int, float]],
    newcomers: Sequence[int],
    budget: int,
) -> IterationSummary:
    """Add to an iteration that has ended the number of iterations without a gain, and a note for the user.

    Args:
        iteration: The iteration that has ended.
        earlier: The iterations before it.
        costs: Returns the costs of a configuration by instance.
        newcomers: The configurations that are new in this iteration; none if no test is to say whether they differ.
        budget: The budget of the whole race.
    """
    accepted = [own for own in map(costs, newcomers) if not any(map(math.isinf, own.values()))]
    found = agreement(accepted)
    iteration = replace(iteration, newcomers_differ=found is None or found[1] < _ALPHA)
    if not earlier:
        return replace(iteration, note=_of_the_first(found) if newcomers else "")
    before = earlier[-1 - earlier[-1].stagnant]
    if is_better(costs(iteration.best), costs(before.best)):
        return iteration
    idle = [*earlier[len(earlier) - earlier[-1].stagnant :], iteration]
    is_long = len(idle) >= MIN_ITERATIONS and sum(one.used for one in idle) >= MIN_SHARE * budget
    is_new = not any(one.note for one in idle)
    return replace(iteration, stagnant=len(idle), note=_of_stagnation(before, idle) if is_long and is_new else "")


class Counted(Protocol):
    """The fields of an iteration by which `stagnates` counts: a summary and an event of its end have them."""

    @property
    def postselection(self) -> bool: ...
    @property
    def used(self) -> int: ...
    @property
    def stagnant(self) -> int: ...


def stagnates(iterations: Sequence[Counted], budget: int) -> bool:
    """Whether the last of some iterations ends a pause that is long enough for a note."""
    idle = [one for one in iterations if not one.postselection][-iterations[-1].stagnant :]
    is_idle = iterations[-1].stagnant >= MIN_ITERATIONS
    return is_idle and sum(one.used for one in idle) >= MIN_SHARE * budget


def _of_the_first(found: tuple[float, float] | None) -> str:
    if found is None:
        return (
            "too few configurations of the first iteration were accepted, or have common instances, to test whether "
            "they differ"
        )
    kendall, p_value = found
    if p_value < _ALPHA:
        return ""
    if math.isnan(kendall):
        return "all configurations of the first iteration cost the same: the race cannot learn from them"
    return (
        "no significant difference between the configurations of the first iteration (Kendall's W "
        f"{kendall:.2g}, p = {p_value:.2g}): it had too few instances"
    )


def _of_stagnation(before: IterationSummary, idle: Sequence[IterationSummary]) -> str:
    best = idle[-1].best
    if best == before.best:
        what = f"{best} is still the best"
    else:
        what = f"{best} is not significantly better than {before.best}"
    restarts = sum(one.soft_restart for one in idle)
    alike = sum(not one.newcomers_differ for one in idle)
    return (
        f"no gain in {len(idle)} iterations, since iteration {before.iteration}: {what}"
        + (f"; {restarts} soft restart{'s' * (restarts > 1)}" if restarts else "")
        + (f"; no significant difference between new configurations in {alike} of them" if alike else "")
    )
