"""Finding places where robots can start: they touch neither walls, nor boxes, nor each other. Kernels."""

import numpy as np
from numpy.typing import NDArray

from mercator_design.jit import jittable

Floats = NDArray[np.float64]


@jittable
def first_free(
    candidates: Floats,
    placed: Floats,
    n: int,
    walls: Floats,
    boxes: Floats,
    half_length: float,
    half_width: float,
    round_: bool,
) -> int:
    """The first of some poses at which a robot fits, or -1.

    Args:
        candidates: (poses, 4 or more) x, y [m], cosine and sine of the heading.
        placed: (n or more, 4 or more) the same of robots that have their place.
        n: How many these are.
        walls: (walls, 6) as in Scene.
        boxes: (boxes, 7) as in Scene.
        half_length: Of a robot [m]; the radius of a disc.
        half_width: Of a robot [m].
        round_: Whether robots are discs.
    """
    for k in range(len(candidates)):
        x, y, c, s = candidates[k, 0], candidates[k, 1], candidates[k, 2], candidates[k, 3]
        free = _is_inside(x, y, walls)
        for i in range(len(walls)):
            if not free:
                break
            if round_:
                free = not _disc_touches_wall(x, y, half_length, walls, i)
            else:
                free = not _touches_wall(x, y, c, s, half_length, half_width, walls, i)
        for i in range(len(boxes)):
            if not free:
                break
            if round_:
                free = not _disc_touches_box(x, y, half_length, boxes, i)
            else:
                free = not _touch(
                    x, y, c, s, half_length, half_width,
                    boxes[i, 0], boxes[i, 1], boxes[i, 2], boxes[i, 3], boxes[i, 4], boxes[i, 5],
                )  # fmt: skip
        for i in range(n):
            if not free:
                break
            if round_:
                away_x, away_y = x - placed[i, 0], y - placed[i, 1]
                free = away_x * away_x + away_y * away_y > 4.0 * half_length * half_length
            else:
                free = not _touch(
                    x, y, c, s, half_length, half_width,
                    placed[i, 0], placed[i, 1], placed[i, 2], placed[i, 3], half_length, half_width,
                )  # fmt: skip
        if free:
            return k
    return -1


@jittable
def _is_inside(x: float, y: float, walls: Floats) -> bool:
    """Whether a point lies between the walls: a ray from it crosses an odd number of them."""
    inside = False
    for i in range(len(walls)):
        start_y, rise = walls[i, 1], walls[i, 3]
        if (start_y > y) != (start_y + rise > y) and x < walls[i, 0] + walls[i, 2] * (y - start_y) / rise:
            inside = not inside
    return inside


@jittable
def _touches_wall(
    x: float, y: float, c: float, s: float, half_length: float, half_width: float, walls: Floats, i: int
) -> bool:
    """Whether a box meets a wall's face: no axis of the box, nor the wall's normal, separates them."""
    start_x, start_y = walls[i, 0] - x, walls[i, 1] - y
    end_x, end_y = start_x + walls[i, 2], start_y + walls[i, 3]
    along_start, along_end = c * start_x + s * start_y, c * end_x + s * end_y
    if min(along_start, along_end) > half_length or max(along_start, along_end) < -half_length:
        return False
    across_start, across_end = c * start_y - s * start_x, c * end_y - s * end_x
    if min(across_start, across_end) > half_width or max(across_start, across_end) < -half_width:
        return False
    normal_x, normal_y = walls[i, 4], walls[i, 5]
    extent = half_length * abs(c * normal_x + s * normal_y) + half_width * abs(c * normal_y - s * normal_x)
    return bool(abs(start_x * normal_x + start_y * normal_y) <= extent)


@jittable
def _disc_touches_wall(x: float, y: float, radius: float, walls: Floats, i: int) -> bool:
    """Whether a disc meets a wall's face."""
    start_x, start_y = x - walls[i, 0], y - walls[i, 1]
    along_x, along_y = walls[i, 2], walls[i, 3]
    t = (start_x * along_x + start_y * along_y) / (along_x * along_x + along_y * along_y)
    t = max(0.0, min(1.0, t))
    away_x, away_y = start_x - t * along_x, start_y - t * along_y
    return bool(away_x * away_x + away_y * away_y <= radius * radius)


@jittable
def _disc_touches_box(x: float, y: float, radius: float, boxes: Floats, i: int) -> bool:
    """Whether a disc meets a box."""
    to_x, to_y = x - boxes[i, 0], y - boxes[i, 1]
    beyond = max(0.0, abs(boxes[i, 2] * to_x + boxes[i, 3] * to_y) - boxes[i, 4])
    aside = max(0.0, abs(boxes[i, 2] * to_y - boxes[i, 3] * to_x) - boxes[i, 5])
    return bool(beyond * beyond + aside * aside <= radius * radius)


@jittable
def _touch(
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
) -> bool:
    """Whether two boxes meet: none of their four axes separates them."""
    to_x, to_y = other_x - x, other_y - y
    turn_c, turn_s = abs(c * other_c + s * other_s), abs(c * other_s - s * other_c)
    if abs(c * to_x + s * to_y) > half_length + other_half_length * turn_c + other_half_width * turn_s:
        return False
    if abs(c * to_y - s * to_x) > half_width + other_half_length * turn_s + other_half_width * turn_c:
        return False
    if abs(other_c * to_x + other_s * to_y) > other_half_length + half_length * turn_c + half_width * turn_s:
        return False
    across = abs(other_c * to_y - other_s * to_x)
    return bool(across <= other_half_width + half_length * turn_s + half_width * turn_c)
