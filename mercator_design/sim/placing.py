"""Finding places where robots can start: boxes that touch neither walls, nor boxes, nor each other. Kernels."""

import numpy as np
from numpy.typing import NDArray

from mercator_design.jit import jittable
from mercator_design.sim.overlaps import box_overlap, is_inside, wall_overlap

Floats = NDArray[np.float64]


@jittable
def first_free(
    candidates: Floats, placed: Floats, n: int, walls: Floats, boxes: Floats, half_length: float, half_width: float
) -> int:
    """The first of some poses at which a robot fits, or -1.

    Args:
        candidates: (poses, 4 or more) x, y [m], cosine and sine of the heading.
        placed: (n or more, 4 or more) the same of robots that have their place.
        n: How many these are.
        walls: (walls, 6) as in Scene.
        boxes: (boxes, 6) as in Scene.
        half_length: Of a robot [m].
        half_width: Of a robot [m].
    """
    for k in range(len(candidates)):
        x, y, c, s = candidates[k, 0], candidates[k, 1], candidates[k, 2], candidates[k, 3]
        free = is_inside(walls, x, y)
        for i in range(len(walls)):
            if not free:
                break
            free = wall_overlap(x, y, c, s, half_length, half_width, walls, i)[0] < 0.0
        for i in range(len(boxes)):
            if not free:
                break
            depth, _, _ = box_overlap(
                x, y, c, s, half_length, half_width,
                boxes[i, 0], boxes[i, 1], boxes[i, 2], boxes[i, 3], boxes[i, 4], boxes[i, 5],
            )  # fmt: skip
            free = depth < 0.0
        for i in range(n):
            if not free:
                break
            depth, _, _ = box_overlap(
                x, y, c, s, half_length, half_width,
                placed[i, 0], placed[i, 1], placed[i, 2], placed[i, 3], half_length, half_width,
            )  # fmt: skip
            free = depth < 0.0
        if free:
            return k
    return -1
