"""The colour of the floor at a point; ground sensors and objectives share this definition.

The marked functions are kernels (see jit.py): plain Python on numpy arrays, or called from compiled code. The
other functions compute whole arrays of points in compiled code.
"""

import math

import numpy as np

from mercator_design.arrays import Floats, Numbers
from mercator_design.config.colours import RGB
from mercator_design.jit import compiled, jittable
from mercator_design.missions.floor import DISC, POLYGON, RECTANGLE, RING, FloorTable


@jittable
def zone_contains(floor: FloorTable, index: int, x: float, y: float) -> bool:
    """Whether the zone in a row of `FloorTable.zones` contains a point; borders belong to it."""
    zones = floor.zones
    kind = zones[index, 0]
    dx = x - zones[index, 1]
    dy = y - zones[index, 2]
    p, q = zones[index, 3], zones[index, 4]
    if kind == DISC:  # p: radius
        return bool(dx * dx + dy * dy <= p * p)
    if kind == RING:  # p, q: radius and inner radius
        return bool(q * q <= dx * dx + dy * dy <= p * p)
    if kind == POLYGON:
        return _polygon_contains(floor.vertices, int(zones[index, 1]), int(zones[index, 2]), x, y)
    if kind == RECTANGLE:  # p, q: half width and height
        angle = zones[index, 5]
        along = dx
        across = dy
        if angle != 0.0:
            along = math.cos(angle) * dx + math.sin(angle) * dy
            across = math.cos(angle) * dy - math.sin(angle) * dx
        return bool(abs(along) <= p and abs(across) <= q)
    return bool(dx * p + dy * q >= 0.0)  # half plane; p, q: normal


@jittable
def any_contains(floor: FloorTable, rows: Numbers, x: float, y: float) -> bool:
    """Whether one of the zones in these rows contains a point."""
    return first_containing(floor, rows, x, y) >= 0


@jittable
def first_containing(floor: FloorTable, rows: Numbers, x: float, y: float) -> int:
    """The index in `rows` of the first zone that contains a point; -1 if none does."""
    for k in range(len(rows)):
        if zone_contains(floor, rows[k], x, y):
            return k
    return -1


@jittable
def _polygon_contains(vertices: Floats, first: int, end: int, x: float, y: float) -> bool:
    """Whether a ray from a point crosses an odd number of sides, or the point lies on one."""
    inside = False
    last = end - 1
    for k in range(first, end):
        from_x, from_y = vertices[last, 0] - x, vertices[last, 1] - y
        to_x, to_y = vertices[k, 0] - x, vertices[k, 1] - y
        turn = from_x * to_y - to_x * from_y
        if turn == 0.0 and from_x * to_x <= 0.0 and from_y * to_y <= 0.0:
            return True
        if (from_y > 0.0) != (to_y > 0.0) and (turn > 0.0) == (to_y > 0.0):
            inside = not inside
        last = k
    return inside


@jittable
def zone_at(floor: FloorTable, x: float, y: float) -> int:
    """The row of the zone on top at a point, the last one painted; -1 if there is none."""
    for index in range(len(floor.zones) - 1, -1, -1):
        if zone_contains(floor, index, x, y):
            return index
    return -1


@jittable
def colour_at(floor: FloorTable, x: float, y: float) -> RGB:
    """Red, green and blue at a point, each in 0 .. 255."""
    index = zone_at(floor, x, y)
    if index >= 0:
        return floor.zones[index, 6], floor.zones[index, 7], floor.zones[index, 8]
    right = x - floor.extent[0]
    up = y - floor.extent[1]
    width, height = floor.extent[2], floor.extent[3]
    if width > 0.0 and 0.0 <= right <= width and 0.0 <= up <= height:
        rows, columns, _ = floor.image.shape
        row = min(int((height - up) / height * rows), rows - 1)
        column = min(int(right / width * columns), columns - 1)
        pixel = floor.image[row, column]
        return float(pixel[0]), float(pixel[1]), float(pixel[2])
    return floor.background[0], floor.background[1], floor.background[2]


def colours_at(floor: FloorTable, points: Floats) -> Floats:
    """The colours (..., 3) at points (..., 2)."""
    flat = np.ascontiguousarray(points.reshape(-1, 2))
    colors = np.zeros((len(flat), 3))
    compiled(_fill_colors)(floor, flat, colors)
    return colors.reshape(*points.shape[:-1], 3)


def _fill_colors(floor: FloorTable, points: Floats, colors: Floats) -> None:
    for i in range(len(points)):
        colors[i, 0], colors[i, 1], colors[i, 2] = colour_at(floor, points[i, 0], points[i, 1])
