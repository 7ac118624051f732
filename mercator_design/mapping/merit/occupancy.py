"""How well occupied cells agree with true walls. Metres."""

import math
from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Flags, Floats

_SPACING = 0.005
"""[m] Between the places of walls that are compared with cells."""


class Agreement(NamedTuple):
    """Occupied cells against walls, with the tolerance of a distance."""

    precision: float  # share of cells whose centre is near a wall; 1 without cells
    recall: float  # share of places of walls that are near an occupied cell's centre
    f1: float
    cells: int
    tolerance: float  # [m]


def agreement(centres: Floats, walls: Floats, tolerance: float, seen: Flags | None = None) -> Agreement:
    """Precision, recall and F1 of occupied cells.

    Args:
        centres: (k, 2) of the occupied cells.
        walls: (m, 4) x, y of both ends of the faces that a lidar can see.
        tolerance: [m] usually the size of a cell.
        seen: of the places of `places_of(walls)`, those that count for the recall, for example those that some beam
            has hit: this is the quality of what was mapped. None: all count, so that coverage is in it.

    Raises:
        ValueError: without walls, or if none of their places counts.
    """
    places = places_of(walls)
    if seen is not None:
        places = places[seen]
    if len(places) == 0:
        raise ValueError("expected at least one place of a wall")
    if len(centres) == 0:
        return Agreement(1.0, 0.0, 0.0, 0, tolerance)
    margin = tolerance * (1.0 + 1e-9)  # cells whose distance is the tolerance are near
    precision = float(np.mean(distances_to(walls, centres) <= margin))
    recall = float(np.mean(near(places, centres, margin)))
    f1 = 2.0 * precision * recall / (precision + recall) if precision + recall > 0.0 else 0.0
    return Agreement(precision, recall, f1, len(centres), tolerance)


def coverage(points: Floats, walls: Floats, tolerance: float, times: Floats, moments: Floats) -> Floats:
    """The share of the places of walls that hits until some moments are near to.

    Args:
        points: (n, 2) true places of hits.
        walls: (m, 4) ends of faces.
        tolerance: [m]
        times: (n,) [s] of the hits.
        moments: (k,) [s] that rise.
    """
    places = places_of(walls)
    first = np.full(len(places), math.inf)
    begin = -math.inf
    for moment in moments:
        new = points[(times > begin) & (times <= moment)]
        unseen = np.flatnonzero(np.isinf(first))
        if len(new) and len(unseen):
            first[unseen[near(places[unseen], new, tolerance)]] = moment
        begin = moment
    return np.array([np.mean(first <= moment) for moment in moments])


def places_of(walls: Floats) -> Floats:
    """Places (n, 2) along walls (m, 4), at most 5 mm apart, in the order of the walls."""
    found = []
    for x1, y1, x2, y2 in walls:
        n = max(1, math.ceil(math.hypot(x2 - x1, y2 - y1) / _SPACING))
        share = (np.arange(n) + 0.5) / n
        found.append(np.column_stack([x1 + share * (x2 - x1), y1 + share * (y2 - y1)]))
    return np.concatenate(found) if found else np.empty((0, 2))


def near(places: Floats, centres: Floats, distance: float) -> Flags:
    """Which of places (n, 2) are at most so far from one of some points (k, 2)."""
    from scipy.spatial import KDTree

    if len(centres) == 0:
        return np.zeros(len(places), dtype=np.bool_)
    found, _ = KDTree(centres).query(places)
    return np.asarray(found <= distance, dtype=np.bool_)


def distances_to(walls: Floats, points: Floats) -> Floats:
    """Distance (n,) of points (n, 2) to the nearest of walls (m, 4)."""
    nearest = np.full(len(points), math.inf)
    for x1, y1, x2, y2 in walls:
        along = np.array([x2 - x1, y2 - y1])
        length = float(along @ along)
        from_start = points - (x1, y1)
        share = np.clip(from_start @ along / length, 0.0, 1.0) if length > 0.0 else np.zeros(len(points))
        nearest = np.minimum(nearest, np.linalg.norm(from_start - share[:, np.newaxis] * along, axis=1))
    return nearest
