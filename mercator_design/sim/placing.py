"""Finds places where robots can start without touching walls, boxes or each other. Kernels."""

from mercator_design.arrays import Floats
from mercator_design.jit import jittable
from mercator_design.sim.kernels.overlaps import PlacedBody, box_overlap, is_inside, obstacle_overlap


@jittable
def first_free(
    candidates: Floats,
    placed: Floats,
    walls: Floats,
    boxes: Floats,
    half_length: float,
    half_width: float,
    round_: bool,
) -> int:
    """Number of the first pose at which a robot fits; -1 if there is none.

    Args:
        candidates: (poses, 4 or more) x, y [m], cosine and sine of the heading.
        placed: (robots, 4 or more) the same of robots that have their place.
        walls: (walls, 6) as in Scene.
        boxes: (boxes, 7) as in Scene.
        half_length: Of a robot [m]; the radius of a disc.
        half_width: Of a robot [m].
        round_: Whether robots are discs.
    """
    for k in range(len(candidates)):
        body = _body(candidates, k, half_length, half_width)
        free = is_inside(walls, body.x, body.y)
        for i in range(len(walls) + len(boxes)):
            if not free:
                break
            overlap, _, _ = obstacle_overlap(walls, boxes, i, body, round_)
            free = overlap < 0.0
        for i in range(len(placed)):
            if not free:
                break
            if round_:
                away_x, away_y = body.x - placed[i, 0], body.y - placed[i, 1]
                free = away_x * away_x + away_y * away_y > 4.0 * half_length * half_length
            else:
                overlap, _, _ = box_overlap(body, _body(placed, i, half_length, half_width))
                free = overlap < 0.0
        if free:
            return k
    return -1


@jittable
def _body(places: Floats, i: int, half_length: float, half_width: float) -> PlacedBody:
    return PlacedBody(places[i, 0], places[i, 1], places[i, 2], places[i, 3], half_length, half_width)
