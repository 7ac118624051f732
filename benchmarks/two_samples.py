"""Two samples of independent runs: could both be of one distribution, and what difference would have been seen?"""

import math
from collections.abc import Iterable, Sequence
from functools import cache

import numpy as np

FALSE_DISCOVERIES = 0.01  # rate of Benjamini and Hochberg's procedure; if nothing differs, the chance of any rejection
POWER = 0.9  # with which a difference that is called visible is found
_FEW = 60  # values besides the most frequent one, up to which the test is exact
_REPEATS = 400
_RESAMPLES = 2000


def mann_whitney(some: np.ndarray, others: np.ndarray) -> float:
    """Two-sided p of the Mann-Whitney test.

    The usual approximation takes rank sums for normal. They are not in small samples, nor where nearly all values are
    equal, as the time spent in a state that is rarely entered: then small p are of the exact permutation distribution.
    """
    from scipy.stats import mannwhitneyu

    values, counts = np.unique(np.concatenate([some, others]), return_counts=True)
    if len(values) == 1:
        return 1.0
    p = float(mannwhitneyu(some, others).pvalue)
    if p < FALSE_DISCOVERIES and counts.sum() - counts.max() <= _FEW:
        return _exact(some, others)
    return p


def share_above(some: np.ndarray, others: np.ndarray) -> float:
    """The share of pairs in which the first sample's value is the larger one; equal ones count half.

    It is the direction of the Mann-Whitney test: 0.5 where the test sees no difference. Means may differ in the other
    direction, by one far value.
    """
    from scipy.stats import rankdata

    n, m = len(some), len(others)
    ranks = rankdata(np.concatenate([some, others]))
    return float((ranks[:n].sum() - n * (n + 1) / 2.0) / (n * m))


def interval_of_share(some: np.ndarray, others: np.ndarray, level: float = 0.95) -> tuple[float, float]:
    """Bounds of `share_above` in the populations: percentiles over samples drawn anew from both, with a fixed seed."""
    random = np.random.default_rng(1)
    above = (some[:, None] > others) + 0.5 * (some[:, None] == others)
    rows, columns = (_times_drawn(random, size) for size in above.shape)
    shares = ((rows @ above) * columns).sum(axis=1) / above.size
    low, high = np.quantile(shares, [0.5 * (1 - level), 0.5 * (1 + level)])
    return float(low), float(high)


def _times_drawn(random: np.random.Generator, size: int) -> np.ndarray:
    """How often each of `size` values is drawn (resamples, size), as numbers with a fraction."""
    drawn = random.integers(size, size=(_RESAMPLES, size)) + size * np.arange(_RESAMPLES)[:, None]
    return np.bincount(drawn.ravel(), minlength=size * _RESAMPLES).reshape(_RESAMPLES, size).astype(float)


def van_elteren(pairs: Iterable[tuple[np.ndarray, np.ndarray]]) -> float:
    """Two-sided p of van Elteren's test: Mann-Whitney's over several problems, in which only ranks within one count.

    The rank sums are divided by the number of values + 1, so that all problems count alike for each value. The sum is
    taken for normal; equal values have their mean rank, and the variance is that of the ranks found.
    """
    from scipy.stats import norm, rankdata

    distance = variance = 0.0
    for some, others in pairs:
        n, total = len(some), len(some) + len(others)
        ranks = rankdata(np.concatenate([some, others])) / (total + 1)
        distance += ranks[:n].sum() - n * ranks.mean()
        variance += n * (total - n) / total * ranks.var(ddof=1)
    return float(2 * norm.sf(abs(distance) / math.sqrt(variance))) if variance else 1.0


def _exact(some: np.ndarray, others: np.ndarray) -> float:
    """Of all ways to deal the values anew: how many give rank sums as far out on one side, twice."""
    from scipy.stats import rankdata

    n, total = len(some), len(some) + len(others)
    ranks = np.rint(2 * rankdata(np.concatenate([some, others]))).astype(int)
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


def rejected(ps: Sequence[float], rate: float = FALSE_DISCOVERIES) -> list[int]:
    """Places of those p that Benjamini and Hochberg's procedure rejects, the smallest first."""
    order = sorted(range(len(ps)), key=lambda k: ps[k])
    passing = [k for k, place in enumerate(order, start=1) if ps[place] <= rate * k / len(ps)]
    return order[: passing[-1]] if passing else []


@cache
def visible_shift(n: int, m: int, level: float) -> float:
    """The smallest difference of means, in standard deviations, that is found with probability POWER.

    For normal samples of n and m values that differ in their means only, by the Mann-Whitney test at a level: rate /
    tests for a difference that is the only one of a family. Infinite if no samples of these sizes are ever rejected.
    """

    def p_of(above: int) -> float:
        """If of all n m pairs so many have the first sample's value above the second's."""
        places = np.full(n, above // n) + (np.arange(n) < above % n)
        return mann_whitney(places - 0.5 + 1e-4 * np.arange(n), np.arange(m))

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
