"""Finding places where robots can start: they touch neither walls, nor boxes, nor each other. Kernels."""

from mercator_design.arrays import Floats
from mercator_design.jit import jittable
from mercator_design.sim.kernels.overlaps import box_overlap, is_inside, obstacle_overlap


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
        free = is_inside(walls, x, y)
        for i in range(len(walls) + len(boxes)):
            if not free:
                break
            overlap, _, _ = obstacle_overlap(walls, boxes, i, half_length, half_width, round_, x, y, c, s)
            free = overlap < 0.0
        for i in range(n):
            if not free:
                break
            if round_:
                away_x, away_y = x - placed[i, 0], y - placed[i, 1]
                free = away_x * away_x + away_y * away_y > 4.0 * half_length * half_length
            else:
                overlap, _, _ = box_overlap(
                    x, y, c, s, half_length, half_width,
                    placed[i, 0], placed[i, 1], placed[i, 2], placed[i, 3], half_length, half_width,
                )  # fmt: skip
                free = overlap < 0.0
        if free:
            return k
    return -1
