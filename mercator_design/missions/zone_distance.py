"""Distances from points to zones, and points on the borders of zones; for checks of whole floors."""

import math

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.missions.arena import polygon_contains, rectangle_corners
from mercator_design.missions.floor import DISC, HALF_PLANE, POLYGON, RECTANGLE, RING, FloorTable

_AROUND = 72  # points on a circle


def distance_to(floor: FloorTable, row: int, points: Floats) -> Floats:
    """Distances (n,) [m] from points (n, 2) to the zone in a row of `FloorTable.zones`; 0 within it."""
    kind, x, y, p, q, angle = floor.zones[row, :6]
    offset = points - (x, y)
    if kind == POLYGON:
        corners = floor.vertices[int(x) : int(y)]
        sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
        nearest = np.min([distance_to_segment(start, end, points) for start, end in sides], axis=0)
        return np.asarray(np.where(polygon_contains(corners, points), 0.0, nearest))
    if kind == HALF_PLANE:
        return np.asarray(np.maximum(0.0, -(offset @ np.array([p, q])) / math.hypot(p, q)))
    if kind == RECTANGLE:
        return distance_to_box((p, q), angle, offset)
    away = np.hypot(offset[:, 0], offset[:, 1])
    inner = q if kind == RING else 0.0
    return np.asarray(np.maximum(0.0, np.maximum(away - p, inner - away)))


def distance_to_box(half_size: tuple[float, float], angle: float, offset: Floats) -> Floats:
    """Distances from points, given as offsets (n, 2) from its centre, to a box whose x axis has a direction [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    along, across = c * offset[:, 0] + s * offset[:, 1], c * offset[:, 1] - s * offset[:, 0]
    beyond = np.maximum(0.0, np.abs(along) - half_size[0]), np.maximum(0.0, np.abs(across) - half_size[1])
    return np.asarray(np.hypot(*beyond))


def distance_to_segment(start: Floats, end: Floats, points: Floats) -> Floats:
    """Distances from points (n, 2) to the line between two points."""
    along, offset = end - start, points - start
    part = np.clip(offset @ along / (along @ along), 0.0, 1.0)
    return np.asarray(np.hypot(*(offset - part[:, np.newaxis] * along).T))


def border_points(floor: FloorTable, row: int) -> Floats:
    """Points (n, 2) on a zone's border: its corners if it has corners; none for a half plane, which is infinite."""
    kind, x, y, p, q, angle = floor.zones[row, :6]
    if kind == HALF_PLANE:
        return np.empty((0, 2))
    if kind == POLYGON:
        return floor.vertices[int(x) : int(y)]
    if kind == RECTANGLE:
        return rectangle_corners((x, y), (2.0 * p, 2.0 * q), angle)
    assert kind in {DISC, RING}  # noqa: S101 - there are no others
    angles = 2.0 * math.pi * np.arange(_AROUND) / _AROUND
    return np.asarray(np.array([x, y]) + p * np.column_stack([np.cos(angles), np.sin(angles)]))
