"""Distances between robots, to places, and along paths: the tests of AutoMoDe-Modules."""

import math

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.jit import compiled
from mercator_design.missions.arena import Point
from mercator_design.missions.plugins import objective
from mercator_design.missions.score_limits import from_zero
from mercator_design.missions.trace import Trace


@objective(limits=from_zero)
def pair_distance(trace: Trace) -> float:
    """Attraction: the distances [m] between all pairs of robots, summed over pairs and cycles; a cost."""
    return float(np.sum(_distances(trace)[:, 0]))


@objective(limits=from_zero)
def nearest_distance(trace: Trace) -> float:
    """Repulsion: from each robot the distance [m] to the nearest other one, summed over robots and cycles.

    The original leaves out the last robot.
    """
    return float(np.sum(_distances(trace)[:, 1]))


@objective(limits=from_zero)
def path_length(trace: Trace) -> float:
    """Stop: how far [m] the robots went, from cycle to cycle, summed; a cost. The original counts centimetres."""
    steps = np.diff(trace.poses[..., :2], axis=0)
    return float(np.sum(np.hypot(steps[..., 0], steps[..., 1])))


@objective(limits=from_zero)
def distance_to(
    trace: Trace,
    *,
    point: Point,  # [m] x, y of the place from which distances count
) -> float:
    """Phototaxis, anti-phototaxis: the distance [m] of the robots from a point, summed over robots and cycles."""
    away = trace.positions - np.array(point)
    return float(np.sum(np.hypot(away[..., 0], away[..., 1])))


def _distances(trace: Trace) -> Floats:
    """In each cycle (cycles, 2): the sum over pairs, and the sum of each robot's distance to the nearest other."""
    sums = np.zeros((trace.cycles, 2))
    compiled(_sum_distances)(np.ascontiguousarray(trace.positions), sums)
    return sums


def _sum_distances(positions: Floats, sums: Floats) -> None:
    robots = positions.shape[1]
    for cycle in range(len(positions)):
        for i in range(robots):
            nearest = math.inf
            for j in range(robots):
                if i != j:
                    x = positions[cycle, j, 0] - positions[cycle, i, 0]
                    y = positions[cycle, j, 1] - positions[cycle, i, 1]
                    distance = math.sqrt(x * x + y * y)
                    nearest = min(nearest, distance)
                    if j > i:
                        sums[cycle, 0] += distance
            if nearest < math.inf:
                sums[cycle, 1] += nearest
