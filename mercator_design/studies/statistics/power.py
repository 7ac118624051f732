"""What a number of designs can show: the smallest difference that the rank-sum test finds, by simulation."""

import math
from collections.abc import Sequence
from functools import cache
from itertools import count
from typing import NamedTuple

import numpy as np
from scipy import stats

from mercator_design.race.elimination.summary import ALPHA
from mercator_design.studies.statistics.rank_tests import rank_sum, van_elteren

POWER = 0.9
"""The probability with which a difference that is called visible is found."""
_REPEATS = 400


class Visible(NamedTuple):
    """The smallest difference that is found with probability POWER.

    shift: Of the means, in standard deviations of the designs' scores; infinite if no difference is ever found.
    a_measure: The same as the share of pairs of designs in which the better method's is better.
    """

    shift: float
    a_measure: float


def visible(n: int, n_tests: int = 1) -> Visible:
    """What n designs of each method can show at 5 %.

    Args:
        n: The number of designs of each method.
        n_tests: The tests that Holm's correction is for; the difference is the only one of them.
    """
    shift = visible_shift(n, n, ALPHA / n_tests)
    return Visible(shift, float(stats.norm.cdf(shift / math.sqrt(2.0))))


def designs_needed(n_tests: int, n_missions: int = 1) -> int:
    """The least number of designs of each with which a difference can be significant at all.

    On one mission by the rank-sum test, over several by van Elteren's.
    """
    level = ALPHA / n_tests
    return next(n for n in count(2) if least_p([(n, n)] * n_missions) <= level)


def least_p(sizes: Sequence[tuple[int, int]]) -> float:
    """The p-value if all designs of a method are better than all of another, and no scores are equal.

    Args:
        sizes: Numbers of designs of both on each mission; the test of one mission is the rank-sum test, that of several
            van Elteren's.
    """
    if len(sizes) == 1:
        return min(1.0, 2.0 / math.comb(sum(sizes[0]), sizes[0][0]))
    return van_elteren((np.arange(m, m + n, dtype=float), np.arange(m, dtype=float)) for n, m in sizes)


@cache
def visible_shift(n: int, m: int, level: float) -> float:
    """The smallest difference of means, in standard deviations, that is found with probability POWER.

    For normal samples of n and m values that differ in their means only, by the rank-sum test at a level: rate / tests
    for a difference that is the only one of a family. Infinite if no samples of these sizes are ever rejected.
    """

    def p_of(above: int) -> float:
        """If of all n m pairs so many have the first sample's value above the second's."""
        places = np.full(n, above // n) + (np.arange(n) < above % n)
        return rank_sum(places - 0.5 + 1e-4 * np.arange(n), np.arange(m, dtype=float))

    low, high = n * m // 2, n * m
    if p_of(high) > level:
        return math.inf
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if p_of(middle) <= level else (middle, high)
    # A shift lifts that many pairs above which are no farther apart.
    random = np.random.default_rng(1)
    needed = []
    for _ in range(_REPEATS):
        apart = random.normal(size=m)[:, None] - random.normal(size=n)
        needed.append(np.partition(apart.ravel(), high - 1)[high - 1])
    return float(np.quantile(needed, POWER))
