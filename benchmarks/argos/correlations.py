"""How far the means of controllers correlate between the original and ours, and how far they could; and the bias."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.argos.scores import Columns, Comparison
from benchmarks.two_samples import FALSE_DISCOVERIES
from mercator_design.studies.statistics.power import POWER

WANTED_CORRELATION = 0.97
RESAMPLES = 2000


def correlation(some: np.ndarray, others: np.ndarray) -> float:
    """Spearman's; nan if either is constant or too short."""
    return float(_correlations(some[None], others[None])[0])


def _correlations(some: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Of the rows of both (n, values): (n,)."""
    from scipy.stats import rankdata

    if some.shape[1] < 3:
        return np.full(len(some), math.nan)
    a, b = (rankdata(side, axis=1) for side in (some, others))
    a, b = (side - side.mean(axis=1, keepdims=True) for side in (a, b))
    size = np.sqrt((a * a).sum(axis=1) * (b * b).sum(axis=1))
    return np.asarray(np.divide((a * b).sum(axis=1), size, out=np.full(len(a), math.nan), where=size > 0))


@dataclass(frozen=True)
class Limits:
    """Of Spearman's correlation of means, at the sizes of these samples."""

    median: float  # if both were one simulator
    lowest: float  # what less than this is, is no luck
    visible: float  # true correlation of another simulator, which would give less than the lowest with chance POWER;
    # nan if none would


def correlation_limits(comparison: Comparison, missions: int = 1, name: str = "score", seed: int = 1) -> Limits:
    """What our simulator, in the recording's place, would give.

    The lowest is passed with probability 1 - FALSE_DISCOVERIES by all of so many missions together. For `visible`, the
    one in the recording's place has its controllers' true means displaced, by normal numbers of ever larger deviation.
    """
    random = np.random.default_rng(seed)
    some, others = _resampled_means([(c.theirs, c.ours) for c in comparison.controllers], name, random)
    found = _correlations(some, others)
    found = found[np.isfinite(found)]  # all means may be alike by luck
    if len(found) < RESAMPLES // 2:
        return Limits(math.nan, math.nan, math.nan)
    lowest = float(np.quantile(found, FALSE_DISCOVERIES / missions))
    truth = comparison.means(name)[1]
    visible = math.nan
    for size in np.geomspace(0.05, 20.0, 25):
        displaced = random.normal(0.0, size * truth.std(), some.shape)
        if np.mean(_correlations(some + displaced, others) < lowest) >= POWER:
            visible = float(np.median(_correlations(truth + displaced, np.broadcast_to(truth, some.shape))))
            break
    return Limits(float(np.median(found)), lowest, visible)


def _resampled_means(
    pairs: Sequence[tuple[Columns, Columns]], name: str, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Means (RESAMPLES, controllers) of ours, dealt to two samples: as many as theirs are, and the others.

    Seeds are dealt alike for all controllers.
    """
    samples = [ours[name] for _, ours in pairs]
    sizes = [(min(len(theirs[name]), len(ours[name]) // 2), len(ours[name])) for theirs, ours in pairs]
    some, others = np.full((2, RESAMPLES, len(pairs)), math.nan)
    order = np.argsort(random.random((RESAMPLES, max(m for _, m in sizes))), axis=1)
    for n, m in set(sizes):
        which = [k for k, size in enumerate(sizes) if size == (n, m)]
        if n:
            values = np.array([samples[k] for k in which]).T
            within = order[order < m].reshape(RESAMPLES, m)
            for rows in np.array_split(np.arange(RESAMPLES), RESAMPLES // 50):  # all at once would take much memory
                some[rows[:, np.newaxis], which] = values[within[rows, :n]].mean(axis=1)
                others[rows[:, np.newaxis], which] = values[within[rows, n:]].mean(axis=1)
    return some, others


def halves(comparison: Comparison, name: str = "score", seed: int = 1) -> float:
    """Spearman's correlation of means between two halves of the recorded seeds: the median over ways to halve them."""
    random = np.random.default_rng(seed)
    n = comparison.recorded_runs
    theirs = np.array([c.theirs[name] for c in comparison.controllers if len(c.theirs.get(name, ())) == n])
    found = []
    for _ in range(100):
        order = random.permutation(n)
        if theirs.size and n > 1:
            some, others = theirs[:, order[: n // 2]], theirs[:, order[n // 2 :]]
            found.append(correlation(some.mean(axis=1), others.mean(axis=1)))
    return float(np.median(found)) if found else math.nan


def bias(comparison: Comparison, name: str) -> tuple[float, float]:
    """Ours less theirs of a statistic, averaged over the controllers, and its standard error.

    The error is that over seeds, which the controllers share, so that their common luck is counted once.
    """
    n, m = comparison.recorded_runs, comparison.our_runs
    pairs = [
        (c.theirs[name], c.ours[name])
        for c in comparison.controllers
        if len(c.theirs.get(name, ())) == n and len(c.ours[name]) == m
    ]
    if not pairs:
        return math.nan, math.nan
    theirs, ours = (np.mean(side, axis=0) for side in zip(*pairs, strict=True))
    theirs = theirs[np.isfinite(theirs)]
    if min(len(theirs), len(ours)) < 2:
        return math.nan, math.nan
    error = math.sqrt(theirs.var(ddof=1) / len(theirs) + ours.var(ddof=1) / len(ours))
    return float(ours.mean() - theirs.mean()), error
