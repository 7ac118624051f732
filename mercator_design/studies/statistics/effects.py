"""How large a difference is: Vargha and Delaney's A, differences of medians and means, with bootstrap intervals.

Intervals are percentiles at 95 % over samples of designs drawn anew from both, with a fixed seed.
docs/explanation/statistics.md has how often they hold the true value.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy import stats

from mercator_design.arrays import Floats
from mercator_design.seeds import generator

_RESAMPLES = 2000
_MAX_PAIRS = 20_000_000
"""Pairs of values that are compared at a time."""


class Effect(NamedTuple):
    """A difference between two samples, with its interval; None if a sample has only one value."""

    value: float
    low: float | None
    high: float | None


def a_measure(some: Floats, others: Floats) -> float:
    """The share of pairs in which the first sample's value is the larger one; equal ones count half.

    It is Vargha and Delaney's A, the probability of superiority; 0.5 where the rank-sum test sees no difference. Means
    may differ in the other direction, by one far value.
    """
    return float(_a_measures(some, others))


def a_effect(some: Floats, others: Floats) -> Effect:
    """The A-measure with its interval."""
    return _effect(some, others, _a_measures, batch=max(1, _MAX_PAIRS // (len(some) * len(others))))


def mirrored(effect: Effect) -> Effect:
    """The A-measure of the samples in the other order."""
    value, low, high = effect
    return Effect(1.0 - value, None if high is None else 1.0 - high, None if low is None else 1.0 - low)


def difference_of_medians(some: Floats, others: Floats) -> Effect:
    """The first sample's median minus the second's."""
    return _effect(some, others, partial(_differences, np.median))


def difference_of_means(some: Floats, others: Floats) -> Effect:
    """The first sample's mean minus the second's."""
    return _effect(some, others, partial(_differences, np.mean))


def notch(values: Floats) -> tuple[float, float]:
    """The limits of a box's notch: median -+ 1.57 interquartile ranges / sqrt(n) (McGill et al. 1978).

    The medians of two samples whose notches do not overlap differ at about 5 %.
    """
    low, middle, high = np.percentile(values, [25, 50, 75])
    half = 1.57 * (high - low) / len(values) ** 0.5
    return float(middle - half), float(middle + half)


def _a_measures(some: Floats, others: Floats, axis: int = -1) -> Floats:
    """Of samples along the last axis."""
    first, second = some[..., :, None], others[..., None, :]
    shares: Floats = ((first > second) + 0.5 * (first == second)).mean(axis=(axis - 1, axis))
    return shares


def _differences(middle: Callable[..., Floats], some: Floats, others: Floats, axis: int = -1) -> Floats:
    return middle(some, axis=axis) - middle(others, axis=axis)


def _effect(some: Floats, others: Floats, statistic: Callable[..., Floats], batch: int | None = None) -> Effect:
    value = float(statistic(some, others))
    if min(len(some), len(others)) < 2:
        return Effect(value, None, None)
    drawn = stats.bootstrap(
        (some, others),
        statistic,
        n_resamples=_RESAMPLES,
        batch=batch,
        vectorized=True,
        method="percentile",
        rng=generator(1, "bootstrap"),
    )
    return Effect(value, float(drawn.confidence_interval.low), float(drawn.confidence_interval.high))
