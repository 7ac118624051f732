"""The walls that a lidar can see: sides of the arena and of boxes, in pieces, and where a ray meets them."""

import math
from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Flags, Floats, Numbers
from mercator_design.jit import jittable
from mercator_design.missions.arena import Arena, polygon_contains

PIECE = 0.1
"""[m] Length of a piece of a wall, at most."""

_BEFORE = 0.005
"""[m] Distance before the middle of a piece of a point that is free if anybody can see the piece."""


class WallTable(NamedTuple):
    """Sides that are higher than a height, each in pieces of one length."""

    sides: Floats  # (sides, 4) start x, y; vector to the end x, y [m]
    first: Numbers  # (sides,) the number of each side's first piece
    pieces: Numbers  # (sides,) the number of its pieces
    is_open: Flags  # (pieces,) whether there is free floor before the piece


def walls_above(arena: Arena, height: float) -> WallTable:
    """The walls and boxes of an arena that are higher than a height [m].

    Sides within other boxes, or along walls, have pieces that are not open.
    """
    boxes = [box.corners() for box in arena.obstacles if box.height > height]
    outlines = [corners[::-1] for corners in boxes]  # so that free floor is to the left of each side
    outlines += [arena.corners()] if arena.wall_height > height else []
    starts = np.vstack([np.zeros((0, 2)), *outlines])
    along = np.vstack([np.zeros((0, 2)), *(np.roll(corners, -1, axis=0) - corners for corners in outlines)])
    lengths = np.hypot(along[:, 0], along[:, 1])
    pieces = np.maximum(np.ceil(lengths / PIECE - 1e-9).astype(np.int64), 1)
    first = np.cumsum(pieces) - pieces
    side = np.repeat(np.arange(len(pieces)), pieces)
    middle = (np.arange(len(side)) - first[side] + 0.5) / pieces[side]
    leftwards = np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(lengths, 1e-12)[:, np.newaxis]
    points = starts[side] + middle[:, np.newaxis] * along[side] + _BEFORE * leftwards[side]
    is_open = arena.contains(points)
    for corners in boxes:
        is_open &= ~polygon_contains(corners, points)
    return WallTable(np.hstack([starts, along]), first, pieces, is_open)


def open_pieces(walls: WallTable) -> Floats:
    """The pieces (n, 4) of walls with free floor before them: x, y [m] of both ends."""
    side = np.repeat(np.arange(len(walls.pieces)), walls.pieces)[walls.is_open]
    number = np.flatnonzero(walls.is_open) - walls.first[side]
    starts, along = walls.sides[side, :2], walls.sides[side, 2:]
    low, high = ((number + k) / walls.pieces[side] for k in (0, 1))
    return np.hstack([starts + low[:, np.newaxis] * along, starts + high[:, np.newaxis] * along])


@jittable
def meets_side(to_x: float, to_y: float, along_x: float, along_y: float, ray_x: float, ray_y: float) -> float:
    """Distance [m] along a ray from the origin to a side, from either side; infinity if it passes by.

    The side begins at (to_x, to_y) and goes along (along_x, along_y); the ray is a unit vector.
    """
    across = ray_x * along_y - ray_y * along_x
    part = to_x * ray_y - to_y * ray_x
    distance = to_x * along_y - to_y * along_x
    if across < 0.0:  # it comes from the other side
        across, part, distance = -across, -part, -distance
    if across == 0.0 or part < 0.0 or part > across or distance < 0.0:
        return math.inf
    return distance / across
