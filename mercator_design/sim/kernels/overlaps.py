"""How deep bodies reach into each other, and which way out is the shortest. Kernels.

The overlap of two bodies is the shortest way [m] that separates them; it is negative if they are apart. It comes with
the direction (a unit vector) in which the first one leaves the other.
"""

import math

from mercator_design.arrays import Floats
from mercator_design.jit import jittable


@jittable
def obstacle_overlap(
    walls: Floats,
    boxes: Floats,
    i: int,
    half_length: float,
    half_width: float,
    round_: bool,
    x: float,
    y: float,
    c: float,
    s: float,
) -> tuple[float, float, float]:
    """Overlap of a robot with outer wall i, or if there are no more walls with a box, and the way out (x, y).

    Args:
        walls: (walls, 6) as in Scene.
        boxes: (boxes, 7) as in Scene.
        i: Which wall or box.
        half_length: Of the robot [m]; the radius of a disc.
        half_width: Of the robot [m].
        round_: Whether it is a disc.
        x: Of the robot's centre, which is inside the arena [m].
        y: The same.
        c: Cosine of its heading.
        s: Sine.
    """
    if i < len(walls):
        if round_:
            return _disc_in_wall(walls, i, x, y, half_length)
        return _box_in_wall(walls, i, x, y, c, s, half_length, half_width)
    i -= len(walls)
    if round_:
        return _disc_in_box(boxes, i, x, y, half_length)
    return box_overlap(
        x, y, c, s, half_length, half_width,
        boxes[i, 0], boxes[i, 1], boxes[i, 2], boxes[i, 3], boxes[i, 4], boxes[i, 5],
    )  # fmt: skip


@jittable
def _disc_in_wall(walls: Floats, i: int, x: float, y: float, radius: float) -> tuple[float, float, float]:
    from_x, from_y = x - walls[i, 0], y - walls[i, 1]
    along_x, along_y = walls[i, 2], walls[i, 3]
    part = (from_x * along_x + from_y * along_y) / (along_x * along_x + along_y * along_y)
    part = max(0.0, min(1.0, part))
    away_x, away_y = from_x - part * along_x, from_y - part * along_y
    distance = math.sqrt(away_x * away_x + away_y * away_y)
    if distance == 0.0:
        return radius, walls[i, 4], walls[i, 5]
    return radius - distance, away_x / distance, away_y / distance


@jittable
def _disc_in_box(boxes: Floats, i: int, x: float, y: float, radius: float) -> tuple[float, float, float]:
    c, s = boxes[i, 2], boxes[i, 3]
    along, across = c * (x - boxes[i, 0]) + s * (y - boxes[i, 1]), c * (y - boxes[i, 1]) - s * (x - boxes[i, 0])
    side_x, side_y = math.copysign(1.0, along), math.copysign(1.0, across)
    over, aside = abs(along) - boxes[i, 4], abs(across) - boxes[i, 5]
    if over > 0.0 and aside > 0.0:
        distance = math.sqrt(over * over + aside * aside)
        side_x, side_y = side_x * over / distance, side_y * aside / distance
    elif over > aside:
        distance, side_y = over, 0.0
    else:
        distance, side_x = aside, 0.0
    return radius - distance, c * side_x - s * side_y, s * side_x + c * side_y


@jittable
def _box_in_wall(
    walls: Floats, i: int, x: float, y: float, c: float, s: float, half_length: float, half_width: float
) -> tuple[float, float, float]:
    """The way out leads off the wall's face, or past an end where the next wall does not go on into the arena."""
    start_x, start_y = walls[i, 0] - x, walls[i, 1] - y
    normal_x, normal_y = walls[i, 4], walls[i, 5]
    extent = half_length * abs(c * normal_x + s * normal_y) + half_width * abs(c * normal_y - s * normal_x)
    away = start_x * normal_x + start_y * normal_y
    depth = extent - abs(away)
    if depth < 0.0:
        return depth, 0.0, 0.0
    depth, out_x, out_y = extent + away, normal_x, normal_y
    end_x, end_y = start_x + walls[i, 2], start_y + walls[i, 3]
    n = len(walls)
    round_start, round_end = _is_reflex(walls, (i + n - 1) % n, i), _is_reflex(walls, i, (i + 1) % n)
    for axis in range(2):
        half, axis_x, axis_y = (half_length, c, s) if axis == 0 else (half_width, -s, c)
        at_start, at_end = start_x * axis_x + start_y * axis_y, end_x * axis_x + end_y * axis_y
        if at_start > at_end:
            least, most, round_least, round_most = at_end, at_start, round_end, round_start
        else:
            least, most, round_least, round_most = at_start, at_end, round_start, round_end
        backwards, forwards = half - least, half + most
        if backwards < 0.0 or forwards < 0.0:
            return min(backwards, forwards), 0.0, 0.0
        if round_least and backwards < depth:
            depth, out_x, out_y = backwards, -axis_x, -axis_y
        if round_most and forwards < depth:
            depth, out_x, out_y = forwards, axis_x, axis_y
    return depth, out_x, out_y


@jittable
def _is_reflex(walls: Floats, i: int, j: int) -> bool:
    """Whether the arena's corner between a wall and the next one sticks out into the arena."""
    return bool(walls[i, 2] * walls[j, 3] - walls[i, 3] * walls[j, 2] < 0.0)


@jittable
def box_overlap(
    x: float,
    y: float,
    c: float,
    s: float,
    half_length: float,
    half_width: float,
    other_x: float,
    other_y: float,
    other_c: float,
    other_s: float,
    other_half_length: float,
    other_half_width: float,
) -> tuple[float, float, float]:
    """Overlap of a box with another, and the way out (x, y): the shortest along one of their four axes."""
    to_x, to_y = other_x - x, other_y - y
    turn_c, turn_s = abs(c * other_c + s * other_s), abs(c * other_s - s * other_c)
    depth, out_x, out_y = math.inf, 0.0, 0.0
    for axis in range(4):
        if axis == 0:
            axis_x, axis_y = c, s
            extent = half_length + other_half_length * turn_c + other_half_width * turn_s
        elif axis == 1:
            axis_x, axis_y = -s, c
            extent = half_width + other_half_length * turn_s + other_half_width * turn_c
        elif axis == 2:
            axis_x, axis_y = other_c, other_s
            extent = other_half_length + half_length * turn_c + half_width * turn_s
        else:
            axis_x, axis_y = -other_s, other_c
            extent = other_half_width + half_length * turn_s + half_width * turn_c
        away = to_x * axis_x + to_y * axis_y
        along = extent - abs(away)
        if along < depth:
            sign = -1.0 if away > 0.0 else 1.0
            depth, out_x, out_y = along, sign * axis_x, sign * axis_y
            if depth < 0.0:
                break  # apart
    return depth, out_x, out_y


@jittable
def is_inside(walls: Floats, x: float, y: float) -> bool:
    """Whether a point lies between the walls: a ray from it crosses an odd number of them."""
    inside = False
    for i in range(len(walls)):
        start_y, rise = walls[i, 1], walls[i, 3]
        if (start_y > y) != (start_y + rise > y) and x < walls[i, 0] + walls[i, 2] * (y - start_y) / rise:
            inside = not inside
    return inside
