"""An additive model of costs, for configurations that have not all seen the same instances.

A cost is the sum of an effect of the configuration, an effect of the instance, and an error.
"""

from collections.abc import Mapping, Sequence
from itertools import chain

import numpy as np

from mercator_design.arrays import Floats

_PASSES = 30
"""Rounds of the fit of effects of configurations and instances."""
_CLIPPINGS = 3
_CLIPPED_AT = 3.0
"""Results further out than so many standard errors are clipped (Huber 1981)."""
_DEVIATIONS = 1.4826
"""Standard deviation of a normal distribution, in median absolute deviations."""
_MIN_SPREAD = 0.1
"""Minimum part of the variance of the configurations' means that is not counted as error."""


def table(costs: Sequence[Mapping[int, float]]) -> Floats:
    """The costs of configurations as a table of shape (configurations, instances), NaN where there is no cost.

    The instances are those that any configuration has seen, in their order.
    """
    columns = {instance: column for column, instance in enumerate(sorted(set(chain.from_iterable(costs))))}
    found = np.full((len(costs), len(columns)), np.nan, order="F")  # BLAS sums in the order of the memory
    for row, own in enumerate(costs):
        found[row, [columns[instance] for instance in own]] = list(own.values())
    return found


def effects(costs: Floats) -> tuple[Floats, float]:
    """The mean costs of configurations, corrected for their instances, and the variance of a single cost.

    Args:
        costs: shape (configurations, instances), NaN where there is no cost; at least one in each row.
    """
    means, offsets = _fit(costs)
    errors = np.nan_to_num(costs - means[:, np.newaxis] - offsets, copy=False)
    n = int((~np.isnan(costs)).sum())
    return means, float((errors * errors).sum()) / max(n - sum(costs.shape) + 1, 1)


def expected(costs: Floats) -> Floats:
    """The expected costs of configurations on new instances: robust means, shrunk to their centre.

    Outliers are clipped, so that a few of them do not decide. Means of few results are shrunk more, because a good mean
    of few results is partly luck (James and Stein 1961).

    Single results of configurations have no error and count in the limit of clipping, so it is narrow where there are
    many, and 0, without effect, where they are more than half of all. A limit without them, and effects by exact least
    squares, gave designs that were no better (41 races on five missions at a budget of 2000, pooled p = 0.5).

    Args:
        costs: as for `effects`.
    """
    clipped = costs
    for _ in range(_CLIPPINGS):
        means, offsets = _fit(clipped)
        clipped = costs  # the table before is not needed any more: at the end of a long race one takes 14 MB
        clipped = _clipped(costs, means, offsets)
    means, variance = effects(clipped)
    error = variance / (~np.isnan(costs)).sum(axis=1)
    spread = max(float(means.var() - np.median(error)), _MIN_SPREAD * float(means.var()))
    if spread == 0:
        return means
    shrunken: Floats = means.mean() + (means - means.mean()) * spread / (spread + error)
    return shrunken


def _clipped(costs: Floats, means: Floats, offsets: Floats) -> Floats:
    """The costs without outliers from a fit, in two more tables of their size."""
    high = means[:, np.newaxis] + offsets
    low = costs - high
    errors = np.abs(low[~np.isnan(low)])  # few, and `nanmedian` would copy the table
    limit = _CLIPPED_AT * _DEVIATIONS * np.median(errors)
    if not limit > 0:
        return costs
    np.subtract(high, limit, out=low)
    high += limit
    return np.clip(costs, low, high, out=low)


def _fit(costs: Floats) -> tuple[Floats, Floats]:
    """Effects of configurations and of instances, by alternating means; those of instances have mean 0."""
    is_known = ~np.isnan(costs)
    known, filled = is_known.astype(float), np.where(is_known, costs, 0.0)
    a_row, a_column = known.sum(axis=1), np.maximum(known.sum(axis=0), 1)
    of_row, of_column = filled.sum(axis=1), filled.sum(axis=0)
    means, offsets = of_row / a_row, np.zeros(costs.shape[1])
    for _ in range(_PASSES):
        before, offsets = offsets, (of_column - means @ known) / a_column
        offsets -= np.add.reduce(offsets) / len(offsets)  # the mean, in a third of its time
        if (offsets == before).all():  # nothing would change any more
            break
        means = (of_row - known @ offsets) / a_row
    return means, offsets
