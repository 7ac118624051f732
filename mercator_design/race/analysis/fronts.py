"""Fronts of several costs: which of some designs no other beats, and how much of the space of costs they dominate."""

import numpy as np

from mercator_design.arrays import Flags, Floats


def nondominated(costs: Floats) -> Flags:
    """Which points no other dominates: none is as good in all costs and better in one.

    Args:
        costs: shape (points, objectives); lower is better.
    """
    at_most = (costs[:, np.newaxis] <= costs).all(axis=2)
    below = (costs[:, np.newaxis] < costs).any(axis=2)
    return np.asarray(~(at_most & below).any(axis=0))


def hypervolume(costs: Floats, reference: Floats) -> float:
    """The volume between points and a reference that they dominate (Zitzler and Thiele 1998); 0 without points.

    Points that are not better than the reference in all costs do not count. It is summed over slices of the last cost
    (While et al. 2006), which is fast for a few dozen points of up to four costs.

    Args:
        costs: shape (points, objectives); lower is better.
        reference: shape (objectives,).
    """
    points = costs[(costs < reference).all(axis=1)]
    if not len(points):
        return 0.0
    if len(reference) == 1:
        return float(reference[0] - points.min())
    points = points[points[:, -1].argsort(kind="stable")]
    ends = [*points[1:, -1], reference[-1]]
    return sum(
        float(end - start) * hypervolume(points[: k + 1, :-1], reference[:-1])
        for k, (start, end) in enumerate(zip(points[:, -1], ends, strict=True))
        if end > start
    )
