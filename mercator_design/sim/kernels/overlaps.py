"""How far bodies overlap, and the shortest way out. Kernels.

The overlap of two bodies is the shortest distance [m] that separates them. With it comes the direction (a unit vector)
in which the first body leaves the other. If they are apart, it is negative: at least that gap lies between them, along
that direction.
"""

import math
from typing import NamedTuple

from mercator_design.arrays import Floats
from mercator_design.jit import jittable


class PlacedBody(NamedTuple):
    """A body on the floor: an obstacle or a robot. A disc has its radius as half length."""

    x: float  # [m] of the centre
    y: float
    c: float  # cosine of the heading
    s: float  # sine of the heading
    half_length: float  # [m]
    half_width: float  # [m]


@jittable
def box_at(boxes: Floats, i: int) -> PlacedBody:
    """Box i of `Scene.boxes`."""
    return PlacedBody(boxes[i, 0], boxes[i, 1], boxes[i, 2], boxes[i, 3], boxes[i, 4], boxes[i, 5])


@jittable
def obstacle_overlap(
    walls: Floats, boxes: Floats, i: int, body: PlacedBody, round_: bool
) -> tuple[float, float, float]:
    """Overlap of a robot in the arena with an obstacle, and the way out (x, y).

    Args:
        walls: (walls, 6) as in Scene.
        boxes: (boxes, 7) as in Scene.
        i: Number of the obstacle: outer walls are counted first, then boxes.
        body: The body of the robot.
        round_: Whether the body is a disc.
    """
    if i < len(walls):
        if round_:
            return _disc_in_wall(walls, i, body)
        return _box_in_wall(walls, i, body)
    box = box_at(boxes, i - len(walls))
    if round_:
        return _disc_in_box(box, body)
    return box_overlap(body, box)


@jittable
def _disc_in_wall(walls: Floats, i: int, disc: PlacedBody) -> tuple[float, float, float]:
    from_x, from_y = disc.x - walls[i, 0], disc.y - walls[i, 1]
    along_x, along_y = walls[i, 2], walls[i, 3]
    part = (from_x * along_x + from_y * along_y) / (along_x * along_x + along_y * along_y)
    part = max(0.0, min(1.0, part))
    away_x, away_y = from_x - part * along_x, from_y - part * along_y
    distance = math.sqrt(away_x * away_x + away_y * away_y)
    if distance == 0.0:
        return disc.half_length, walls[i, 4], walls[i, 5]
    return disc.half_length - distance, away_x / distance, away_y / distance


@jittable
def _disc_in_box(box: PlacedBody, disc: PlacedBody) -> tuple[float, float, float]:
    c, s = box.c, box.s
    along, across = c * (disc.x - box.x) + s * (disc.y - box.y), c * (disc.y - box.y) - s * (disc.x - box.x)
    side_x, side_y = math.copysign(1.0, along), math.copysign(1.0, across)
    over, aside = abs(along) - box.half_length, abs(across) - box.half_width
    if over > 0.0 and aside > 0.0:
        distance = math.sqrt(over * over + aside * aside)
        side_x, side_y = side_x * over / distance, side_y * aside / distance
    elif over > aside:
        distance, side_y = over, 0.0
    else:
        distance, side_x = aside, 0.0
    return disc.half_length - distance, c * side_x - s * side_y, s * side_x + c * side_y


@jittable
def _box_in_wall(walls: Floats, i: int, box: PlacedBody) -> tuple[float, float, float]:
    """The way out leads off the wall's face, or past an end of the wall if the corner there is reflex."""
    c, s = box.c, box.s
    start_x, start_y = walls[i, 0] - box.x, walls[i, 1] - box.y
    normal_x, normal_y = walls[i, 4], walls[i, 5]
    extent = box.half_length * abs(c * normal_x + s * normal_y) + box.half_width * abs(c * normal_y - s * normal_x)
    away = start_x * normal_x + start_y * normal_y
    depth = extent - abs(away)
    if depth < 0.0:
        side = math.copysign(1.0, -away)
        return depth, side * normal_x, side * normal_y
    depth, out_x, out_y = extent + away, normal_x, normal_y
    end_x, end_y = start_x + walls[i, 2], start_y + walls[i, 3]
    n = len(walls)
    round_start, round_end = _is_reflex(walls, (i + n - 1) % n, i), _is_reflex(walls, i, (i + 1) % n)
    for axis in range(2):
        half, axis_x, axis_y = (box.half_length, c, s) if axis == 0 else (box.half_width, -s, c)
        at_start, at_end = start_x * axis_x + start_y * axis_y, end_x * axis_x + end_y * axis_y
        if at_start > at_end:
            low, high, round_low, round_high = at_end, at_start, round_end, round_start
        else:
            low, high, round_low, round_high = at_start, at_end, round_start, round_end
        backwards, forwards = half - low, half + high
        if backwards < 0.0:
            return backwards, -axis_x, -axis_y
        if forwards < 0.0:
            return forwards, axis_x, axis_y
        if round_low and backwards < depth:
            depth, out_x, out_y = backwards, -axis_x, -axis_y
        if round_high and forwards < depth:
            depth, out_x, out_y = forwards, axis_x, axis_y
    return depth, out_x, out_y


@jittable
def _is_reflex(walls: Floats, i: int, j: int) -> bool:
    """Whether the corner between a wall and the next one points into the arena."""
    return bool(walls[i, 2] * walls[j, 3] - walls[i, 3] * walls[j, 2] < 0.0)


@jittable
def box_overlap(box: PlacedBody, other: PlacedBody) -> tuple[float, float, float]:
    """Overlap of a box with another, and the way out (x, y): the shortest along one of their four axes."""
    to_x, to_y = other.x - box.x, other.y - box.y
    turn_c, turn_s = abs(box.c * other.c + box.s * other.s), abs(box.c * other.s - box.s * other.c)
    depth, out_x, out_y = math.inf, 0.0, 0.0
    for axis in range(4):
        if axis == 0:
            axis_x, axis_y = box.c, box.s
            extent = box.half_length + other.half_length * turn_c + other.half_width * turn_s
        elif axis == 1:
            axis_x, axis_y = -box.s, box.c
            extent = box.half_width + other.half_length * turn_s + other.half_width * turn_c
        elif axis == 2:
            axis_x, axis_y = other.c, other.s
            extent = other.half_length + box.half_length * turn_c + box.half_width * turn_s
        else:
            axis_x, axis_y = -other.s, other.c
            extent = other.half_width + box.half_length * turn_s + box.half_width * turn_c
        away = to_x * axis_x + to_y * axis_y
        along = extent - abs(away)
        if along < depth:
            sign = -1.0 if away > 0.0 else 1.0
            depth, out_x, out_y = along, sign * axis_x, sign * axis_y
    return depth, out_x, out_y


@jittable
def body_overlap(body: PlacedBody, other: PlacedBody, round_: bool) -> tuple[float, float, float]:
    """Overlap of a robot with another, and the way out (x, y); both are discs, or both are boxes."""
    if not round_:
        return box_overlap(body, other)
    to_x, to_y = body.x - other.x, body.y - other.y
    distance = math.sqrt(to_x * to_x + to_y * to_y)
    depth = body.half_length + other.half_length - distance
    return (depth, 1.0, 0.0) if distance == 0.0 else (depth, to_x / distance, to_y / distance)


@jittable
def is_inside(walls: Floats, x: float, y: float) -> bool:
    """Whether a point lies between the walls: a ray from it crosses an odd number of them."""
    inside = False
    for i in range(len(walls)):
        start_y, rise = walls[i, 1], walls[i, 3]
        if (start_y > y) != (start_y + rise > y) and x < walls[i, 0] + walls[i, 2] * (y - start_y) / rise:
            inside = not inside
    return inside
