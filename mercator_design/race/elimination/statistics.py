"""The statistical tests that eliminate configurations from a race, and how configurations are ranked.

The tests are those of irace (race.R), and agree with R also on ties. For more than two configurations: Friedman's
test and Conover's post-hoc comparison with the best (Conover 1999, Practical Nonparametric Statistics, pp. 369-371).
For two: Wilcoxon's signed-rank test. The alternative to both is the paired t-test against the best, with Bonferroni's
or Holm's correction or without correction.

Costs are minimised. A table of costs has shape (instances, configurations). Only `scipy.special` is used of scipy,
because it is quick to import (scipy does it at the first use).
"""

import math
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Literal, NamedTuple

import numpy as np
import scipy

from mercator_design.arrays import Flags, Floats
from mercator_design.errors import RaceError

TestName = Literal["friedman", "t-test", "t-test-holm", "t-test-bonferroni"]

_EXACT_BELOW = 50
"""R approximates the distribution of Wilcoxon's statistic from this number of differences on."""
_SAME_MEANS = 1.5e-8
"""R's all.equal treats means as equal up to this relative difference."""
_NO_VARIANCE = 10 * float(np.finfo(float).eps)


class Verdict(NamedTuple):
    """The result of a test on a table of costs.

    survivors: which configurations survive, shape (configurations,).
    ranks: what the configurations are ranked by, smaller is better, shape (configurations,).
    best: column of the best, the first of equals.
    p_value: NaN where nothing could be compared, 0 where no test was needed.
    """

    survivors: Flags
    ranks: Floats
    best: int
    p_value: float


def eliminate(costs: Floats, test: TestName, confidence: float, *, several: bool = False) -> Verdict:
    """Test a table of at least one instance and two configurations.

    With several objectives, each pair of an instance and an objective is a row. Their units differ, so only Friedman's
    test is possible, also of two configurations: Wilcoxon's compares the sizes of differences.

    Raises:
        RaceError: Another test is given for several objectives.

    On one instance, as in irace: Friedman's test eliminates none; the t-test eliminates all that are worse than the
    best; the worse one of two configurations is eliminated.
    """
    if several and test != "friedman":
        raise RaceError(f"race option test: expected friedman, as there are several objectives, found {test}")
    return _by_rank_sums(costs, 1.0 - confidence) if several else _TESTS[test](costs, 1.0 - confidence)


def ranking(costs: Floats, test: TestName) -> Floats:
    """The values by which a test sorts the columns: sums of ranks, or ranks of means (without rows, their order)."""
    if test == "friedman":
        ranks: Floats = mid_ranks(costs)[0].sum(axis=0)
        return ranks
    if not len(costs):
        return np.arange(1.0, costs.shape[1] + 1)
    return _row_ranks(column_means(costs))


def overall_ranks(costs: Floats, test: TestName) -> Floats:
    """Ranks of configurations that have not seen the same instances; NaN where there is no result.

    More results rank before fewer. Configurations of as many results are compared on the instances that all
    of them have seen (irace's overall_ranks).
    """
    present = ~np.isnan(costs)
    counts = present.sum(axis=0)
    ranks = np.zeros(costs.shape[1])
    offset = 0.0
    for count in np.unique(counts)[::-1]:
        group = np.flatnonzero(counts == count)
        common = present[:, group].all(axis=1)
        ranks[group] = offset + (ranking(costs[np.ix_(common, group)], test) if len(group) > 1 else 1)
        offset = ranks[group].max()
    return ranks


def column_means(costs: Floats) -> Floats:
    """Means of the columns to the last bit of R's, shape (configurations,).

    Equal means may differ by rounding, and R breaks such ties by these last bits. R sums the rows in order, first the
    costs, then their differences from the first mean (the refinement of matrixStats::colMeans2).
    """
    means = costs.cumsum(axis=0)[-1] / len(costs)
    refined: Floats = means + (costs - means).cumsum(axis=0)[-1] / len(costs)
    return refined


def concordance(costs: Floats) -> float:
    """Kendall's W: how well two instances or more agree on two configurations or more (irace's table column KenW)."""
    n, k = costs.shape
    ranks, ties = mid_ranks(costs)
    spread = 12 * ((ranks.sum(axis=0) - n * (k + 1) / 2) ** 2).sum()
    span = n * n * (k**3 - k) - n * ties
    return float(spread / span) if span > 0 else 1.0


def signed_rank_p_value(differences: Floats) -> float:
    """The one-sided p-value of Wilcoxon's signed-rank test; small if differences are significantly positive.

    Below 50 differences that are not zero it is exact, also with ties; from 50 on it is R's normal approximation, with
    a correction for continuity. Zeros are ranked, and half of their ranks counts (zero_method="zsplit" in scipy).
    """
    ranks = np.rint(2 * mid_ranks(np.abs(differences)[np.newaxis])[0][0]).astype(int)  # twice, so that they are whole
    signed, statistic = ranks[differences != 0], int(ranks[differences > 0].sum())
    if len(signed) >= _EXACT_BELOW:
        deviation = math.sqrt(int((signed * signed).sum())) / 2
        return float(scipy.special.ndtr((signed.sum() / 2 - statistic + 1) / deviation))  # 1 is half a rank
    return float(_subset_sum_probabilities(signed.tolist())[statistic:].sum())


def mid_ranks(costs: Floats) -> tuple[Floats, float]:
    """Ranks from 1 within each row, with mean ranks for ties; and the sum of g^3 - g over groups of g ties."""
    n, k = costs.shape
    order = costs.argsort(axis=1, kind="stable")
    in_order = np.take_along_axis(costs, order, axis=1)
    differs = in_order[:, 1:] != in_order[:, :-1]
    if differs.all():
        ranks = np.empty((n, k))
        np.put_along_axis(ranks, order, np.arange(1.0, k + 1)[np.newaxis], axis=1)
        return ranks, 0.0
    places = np.broadcast_to(np.arange(k), (n, k))
    edge = np.ones((n, 1), dtype=bool)
    first = np.maximum.accumulate(np.where(np.hstack((edge, differs)), places, 0), axis=1)
    last = np.minimum.accumulate(np.where(np.hstack((differs, edge)), places, k)[:, ::-1], axis=1)[:, ::-1]
    ranks = np.empty((n, k))
    np.put_along_axis(ranks, order, (first + last) / 2 + 1, axis=1)
    size = (last - first + 1).astype(float)
    return ranks, float((size * size - 1).sum())  # each of g members adds g^2 - 1


def _row_ranks(values: Floats) -> Floats:
    ranks: Floats = mid_ranks(values[np.newaxis])[0][0]
    return ranks


def _friedman(costs: Floats, alpha: float) -> Verdict:
    return _wilcoxon(costs, alpha) if costs.shape[1] == 2 else _by_rank_sums(costs, alpha)


def _by_rank_sums(costs: Floats, alpha: float) -> Verdict:
    n, k = costs.shape
    ranks, ties = mid_ranks(costs)
    sums = ranks.sum(axis=0)
    best = int(sums.argmin())
    span = n * k * (k + 1) - ties / (k - 1)
    if span <= 0:  # all costs of each instance are equal
        return Verdict(np.ones(k, dtype=bool), sums, best, math.nan)
    statistic = 12 * ((sums - n * (k + 1) / 2) ** 2).sum() / span
    p_value = float(scipy.special.chdtrc(k - 1, statistic))
    if n == 1 or not p_value < alpha:  # one instance leaves Conover's comparison no degrees of freedom
        return Verdict(np.ones(k, dtype=bool), sums, best, p_value)
    freedom = (n - 1) * (k - 1)
    within = max(n * (ranks * ranks).sum() - (sums * sums).sum(), 0.0)
    critical = scipy.special.stdtrit(freedom, 1 - alpha / 2) * math.sqrt(2 * within / freedom)
    return Verdict(sums - sums[best] <= critical, sums, best, p_value)


def _wilcoxon(costs: Floats, alpha: float) -> Verdict:
    differences = costs[:, 0] - costs[:, 1]
    if (differences <= 0).all():  # no test if one is never worse; the first wins if they are equal
        return _duel(0, 0.0, dropped=True)
    if (differences >= 0).all():
        return _duel(1, 0.0, dropped=True)
    differences = differences[differences != 0]
    n = len(differences)
    ranks, ties = mid_ranks(np.abs(differences)[np.newaxis])
    statistic = float(ranks[0][differences > 0].sum())
    if n < _EXACT_BELOW and n == len(costs) and ties == 0:
        p_value = _exact_p_value(n, int(statistic))
    else:
        centred = statistic - n * (n + 1) / 4
        sigma = math.sqrt(n * (n + 1) * (2 * n + 1) / 24 - ties / 48)
        z = (centred - math.copysign(0.5, centred) * (centred != 0)) / sigma
        p_value = min(1.0, 2 * float(scipy.special.ndtr(-abs(z))))
    return _duel(1 if _is_shift_positive(differences) else 0, p_value, dropped=p_value < alpha)


def _is_shift_positive(differences: Floats) -> bool:
    """Whether the median of the sums of all pairs of differences is above 0 (the estimate of Hodges and Lehmann).

    Each difference is also paired with itself. The n (n + 1) / 2 sums are counted in the sorted differences, not made.
    """
    ordered = np.sort(differences)
    n = len(ordered)
    partners = np.searchsorted(ordered, -ordered, side="right")  # for a sum of 0 or less
    excess = int(partners.sum() + (ordered <= 0).sum()) - n * (n + 1) // 2  # twice the sums of 0 or less, minus all
    if excess:
        return excess < 0
    largest = (ordered + ordered[partners - 1])[partners > 0].max()
    smallest = (ordered + ordered[np.minimum(partners, n - 1)])[partners < n].min()
    return bool(largest + smallest > 0)


def _duel(winner: int, p_value: float, *, dropped: bool) -> Verdict:
    survivors = np.ones(2, dtype=bool)
    survivors[1 - winner] = not dropped
    ranks = np.array([1.0, 2.0]) if winner == 0 else np.array([2.0, 1.0])
    return Verdict(survivors, ranks, winner, p_value)


@cache
def _exact_p_value(n: int, statistic: int) -> float:
    """The two-sided p-value of a sum of signed ranks without ties."""
    probabilities = _subset_sum_probabilities(range(1, n + 1))
    low, high = probabilities[: statistic + 1].sum(), probabilities[statistic:].sum()
    return min(1.0, 2 * float(min(low, high)))


def _subset_sum_probabilities(ranks: Sequence[int]) -> Floats:
    """The probability of each sum of a random subset of ranks."""
    probabilities = np.zeros(sum(ranks) + 1)
    probabilities[0] = 1.0
    for rank in ranks:
        probabilities[rank:] += probabilities[:-rank].copy()
        probabilities /= 2
    return probabilities


def _t_test(costs: Floats, alpha: float, *, adjust: Callable[[Floats], Floats]) -> Verdict:
    n, k = costs.shape
    means = column_means(costs)
    best = int(means.argmin())
    gaps = means - means[best]
    if abs(means[best]) > _SAME_MEANS:
        gaps = gaps / abs(means[best])
    differences = costs[:, [best]] - costs
    if n == 1:  # a single row: all but the best are worse on every row
        p_values = adjust(np.where(gaps <= _SAME_MEANS, 1.0, 0.0))
        return Verdict(p_values >= alpha, _row_ranks(means), best, float(p_values.min()))
    variances = costs.var(axis=0, ddof=1)
    comparable = (np.minimum(variances, variances[best]) >= _NO_VARIANCE) & (differences > 0).any(axis=0)
    errors = differences.std(axis=0, ddof=1) / math.sqrt(n)
    p_values = np.zeros(k)
    tested = comparable & (errors > 0)
    p_values[tested] = 2 * scipy.special.stdtr(n - 1, -np.abs(differences.mean(axis=0)[tested] / errors[tested]))
    p_values[gaps <= _SAME_MEANS] = 1.0
    p_values = adjust(p_values)
    return Verdict(p_values >= alpha, _row_ranks(means), best, float(p_values.min()))


def holm(p_values: Floats) -> Floats:
    """Holm's correction of p-values."""
    order = p_values.argsort(kind="stable")
    factors = np.arange(len(p_values), 0, -1)
    adjusted = np.empty_like(p_values)
    adjusted[order] = np.minimum(1.0, np.maximum.accumulate(factors * p_values[order]))
    return adjusted


_TESTS: dict[TestName, Callable[[Floats, float], Verdict]] = {
    "friedman": _friedman,
    "t-test": partial(_t_test, adjust=lambda p_values: p_values),
    "t-test-holm": partial(_t_test, adjust=holm),
    "t-test-bonferroni": partial(_t_test, adjust=lambda p_values: np.minimum(1.0, len(p_values) * p_values)),
}
