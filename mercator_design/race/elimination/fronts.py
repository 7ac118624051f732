"""Fronts of several costs: which of some designs no other beats, and how much of the space of costs they dominate."""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from mercator_design.arrays import Flags, Floats
from mercator_design.race.elimination.additive_model import expected, table

MIN_RUNS = 5
"""Results of a configuration from which on it counts as well tested."""
MAX_FRONT = 10
"""Maximum number of configurations that are tested for the front of a race."""
_BEYOND = 1.1
"""The reference of a hypervolume, in each scaled cost: beyond 1, so that the ends of a front count, too."""
_NO_GAIN = 1e-12


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


def front_candidates(tables: Sequence[Sequence[Mapping[int, float]]], elites: Iterable[int], limit: int) -> list[int]:
    """The configurations of a race that may be on the front: the best of the elites and of others that are well tested.

    They are compared by their expected costs (`additive_model.expected`), as in the race. First come those that none
    dominates, then those that only these dominate, and so on, because chance also decides. Of each such layer, one
    after the other is taken that adds most to the hypervolume within the box of all, scaled to 1.

    Args:
        tables: By each objective, of each configuration its costs by instance.
        elites: The numbers of the elites of all iterations.
        limit: Maximum number.

    Returns:
        Their numbers, in the order of the first cost.
    """
    first = tables[0]
    tested = {number for number, own in enumerate(first) if len(own) >= MIN_RUNS}
    known = sorted(number for number in {*elites, *tested} if first[number])
    known = [number for number in known if not any(map(math.isinf, first[number].values()))]
    if not known:
        return []
    costs = np.column_stack([_expected([costs[number] for number in known]) for costs in tables])
    left, chosen = np.arange(len(known)), list[int]()
    while len(chosen) < limit and len(left):
        is_first = nondominated(costs[left])
        layer, left = left[is_first], left[~is_first]
        chosen += layer[_spread(scaled(costs[layer]), limit - len(chosen))].tolist()
    return [known[k] for k in sorted(chosen, key=lambda k: float(costs[k, 0]))]


def _spread(costs: Floats, limit: int) -> list[int]:
    """Points of a front, one after the other, that add most to its hypervolume, until none adds anything."""
    chosen, volume, reference = list[int](), 0.0, np.full(costs.shape[1], _BEYOND)
    while len(chosen) < limit:
        volumes = [hypervolume(costs[[*chosen, k]], reference) for k in range(len(costs))]
        if max(volumes) <= volume + _NO_GAIN:
            break
        volume = max(volumes)
        chosen.append(volumes.index(volume))
    return chosen


def scaled(costs: Floats) -> Floats:
    """Costs of points, each scaled so that the best is 0 and the worst 1; 0 where all are equal."""
    low, span = costs.min(axis=0), np.ptp(costs, axis=0)
    return np.asarray((costs - low) / np.where(span > 0, span, 1.0))


def _expected(costs: Sequence[Mapping[int, float]]) -> Floats:
    known = table(costs)
    return expected(known[:, ~np.isnan(known).all(axis=0)])
