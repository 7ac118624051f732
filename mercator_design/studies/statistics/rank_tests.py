"""Tests of ranks on samples of designs: those of scipy.stats, and what it lacks.

All p-values are two-sided. An exact p-value is twice that of the smaller tail, at most 1, as in R's wilcox.test.
"""

import math
from collections.abc import Iterable
from typing import Literal, NamedTuple

import numpy as np
from scipy import stats

from mercator_design.arrays import Floats
from mercator_design.race.elimination.statistics import signed_rank_p_value

_EXACT_BELOW = 50
"""R's wilcox.test takes rank sums for normal from this size of a sample on."""
_FEW = 60
"""Values besides the most frequent one, up to which the test of larger samples is exact, too."""

Ties = Literal["exact", "normal"]


def rank_sum(some: Floats, others: Floats, *, ties: Ties = "exact") -> float:
    """The p-value of Wilcoxon's rank-sum test (Mann-Whitney) of two independent samples.

    It is exact for samples of fewer than 50 values, and for larger ones of which few differ from the most frequent
    value; else rank sums are taken for normal, with the corrections for ties and continuity. The approximation is too
    sure where many values are equal: for 4 of 10 values above 16 equal ones it gives 0.035, and the exact p is 0.087.

    Args:
        some: A sample, not empty.
        others: Another one.
        ties: "normal": R's wilcox.test to the last digit, which is exact only where no values are equal.
    """
    values, counts = np.unique(np.concatenate([some, others]), return_counts=True)
    if len(values) == 1:
        return 1.0
    is_tied = len(values) < counts.sum()
    is_small = max(len(some), len(others)) < _EXACT_BELOW
    has_few = counts.sum() - counts.max() <= _FEW
    is_exact = is_small and not is_tied if ties == "normal" else is_small or has_few
    if is_exact and is_tied:
        return _of_all_deals(some, others)
    return float(stats.mannwhitneyu(some, others, method="exact" if is_exact else "asymptotic").pvalue)


def signed_rank(differences: Floats, *, ties: Ties = "exact") -> float:
    """The p-value of Wilcoxon's signed-rank test of paired samples, by their differences.

    It is exact for fewer than 50 differences; half of the ranks of zeros counts.

    Args:
        differences: Of the pairs, not empty.
        ties: "normal": R's wilcox.test to the last digit, which leaves zeros out, and is exact only where there are
            none and no absolute differences are equal.
    """
    if not differences.any():
        return 1.0
    if ties == "exact":
        return min(1.0, 2.0 * min(signed_rank_p_value(differences), signed_rank_p_value(-differences)))
    is_tied = len(np.unique(np.abs(differences))) < len(differences) or not differences.all()
    method = "approx" if is_tied or len(differences) >= _EXACT_BELOW else "exact"
    return float(stats.wilcoxon(differences, correction=True, method=method).pvalue)


def van_elteren(pairs: Iterable[tuple[Floats, Floats]]) -> float:
    """The p-value of van Elteren's test: the rank-sum test over several problems, in which only ranks within one count.

    The rank sums are divided by the number of values + 1, so that all problems count alike for each value. The sum is
    taken for normal; equal values have their mean rank, and the variance is that of the ranks found (van Elteren 1960).
    """
    distance = variance = 0.0
    for some, others in pairs:
        n, total = len(some), len(some) + len(others)
        ranks = stats.rankdata(np.concatenate([some, others])) / (total + 1)
        distance += ranks[:n].sum() - n * ranks.mean()
        variance += n * (total - n) / total * ranks.var(ddof=1)
    return float(2 * stats.norm.sf(abs(distance) / math.sqrt(variance))) if variance else 1.0


class RankedBlocks(NamedTuple):
    """Friedman's test of blocks, in each of which all of three or more levels have a value.

    mean_ranks: Of the levels; 1 is the best.
    p_value: Of no difference between the levels, by Friedman's test.
    distance: Nemenyi's critical distance at 5 %: mean ranks that are farther apart differ.
    p_values: Nemenyi's p of each pair of levels, shape (levels, levels), 1 on the diagonal.
    """

    n_blocks: int
    mean_ranks: Floats
    statistic: float
    p_value: float
    distance: float
    p_values: Floats

    @property
    def least_p(self) -> float:
        """The least p_value that is possible: if the levels have the same order in all blocks."""
        k = len(self.mean_ranks)
        return float(stats.chi2.sf(self.n_blocks * (k - 1), k - 1))


def friedman(values: Floats) -> RankedBlocks:
    """Friedman's test, and Nemenyi's of all pairs (Demsar 2006).

    Args:
        values: Shape (blocks, levels), at least 2 and 3; higher ones are better.
    """
    n, k = values.shape
    means = stats.rankdata(-values, axis=1).mean(axis=0)
    if (values == values[:, :1]).all():
        statistic, p_value = 0.0, 1.0
    else:
        statistic, p_value = map(float, stats.friedmanchisquare(*values.T))
    unit = math.sqrt(k * (k + 1) / (12.0 * n))
    apart = np.abs(means[:, None] - means) / unit
    p_values = stats.studentized_range.sf(apart, k, np.inf)
    np.fill_diagonal(p_values, 1.0)
    distance = float(stats.studentized_range.isf(0.05, k, np.inf)) * unit
    return RankedBlocks(n, means, statistic, p_value, distance, p_values)


def _of_all_deals(some: Floats, others: Floats) -> float:
    """Of all ways to deal the values anew: how many give rank sums as far out on one side, twice."""
    n, total = len(some), len(some) + len(others)
    ranks = np.rint(2 * stats.rankdata(np.concatenate([some, others]))).astype(int)
    usual = np.bincount(ranks).argmax()
    ranks -= usual  # the most frequent value adds nothing to a sum
    rest = ranks[ranks != 0]
    lowest = int(rest[rest < 0].sum())
    # ways[k, s]: to choose k of the rest with the sum s + lowest
    ways = np.zeros((min(n, len(rest)) + 1, int(rest[rest > 0].sum()) - lowest + 1))
    ways[0, -lowest] = 1.0
    for rank in rest.tolist():
        ways[1:] += np.roll(ways[:-1], rank, axis=1)
    filled_up = [math.comb(total - len(rest), n - k) / math.comb(total, n) for k in range(len(ways))]
    chance = np.array(filled_up) @ ways
    found = int(ranks[:n].sum()) - lowest
    return float(min(1.0, 2.0 * min(chance[: found + 1].sum(), chance[found:].sum())))
