"""A map of surfels: pieces of walls, each with a mean point, a mean normal and a weight.

A square cell has two surfels, so that both faces of a thin wall find a place. Cells are kept in tiles of 16 x 16, which
are made where there are points; a directory has the number of the tile of each square. So lookups take two reads, and
memory grows with the length of the walls.
"""

import math
from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Floats, Numbers
from mercator_design.jit import compiled, jittable

CELL = 0.05
"""The width [m] of a cell of the front end's map."""

_SIDE = 16  # cells of a tile
_PER_TILE = 2 * _SIDE * _SIDE
_SAME = 0.5  # product of the normals of points of one face
_MAX_WEIGHT = 60.0
_DECAY = 0.98  # of the weight of a surfel that has reached the largest

_MARGIN = 0.12  # [m] at the ends of a beam where it may touch a wall
_SOLID = 3.0  # weight of a surfel that stops beams
_FACING = 0.3  # cosine of the angle under which a beam meets a wall that it does not graze
_ASIDE = 0.02  # [m] of a surfel from a beam that meets it


class SurfelGrid(NamedTuple):
    """The arrays of a map, for kernels."""

    directory: Numbers  # (rows, columns) number of the tile of each square; -1: none
    corner: Floats  # (2,) [m] x and y of the directory's corner
    cell: Floats  # (1,) [m] width of a cell
    rows: Floats  # (tiles * 512, 5) mean x, y [m], mean normal x, y, weight; those of a cell are side by side
    used: Numbers  # (1,) tiles in use


@jittable
def _first_row(grid: SurfelGrid, column: int, row: int) -> int:
    """The first row of `SurfelGrid.rows` of a cell, counted from the corner; -1: it has none."""
    tile_row, tile_column = row // _SIDE, column // _SIDE
    if row < 0 or column < 0 or tile_row >= grid.directory.shape[0] or tile_column >= grid.directory.shape[1]:
        return -1
    tile = grid.directory[tile_row, tile_column]
    if tile < 0:
        return -1
    return int(tile * _PER_TILE + 2 * ((row - tile_row * _SIDE) * _SIDE + column - tile_column * _SIDE))


@jittable
def insert(
    grid: SurfelGrid, pose: Floats, bend: float, points: Floats, normals: Floats, ages: Floats, first: int
) -> int:
    """Add points to the map; returns the first one that did not fit because a tile is missing.

    Args:
        grid: The map.
        pose: (3,) of the robot.
        bend: [rad] how far the robot turned more during the turn of the lidar than its odometry says.
        points: (n, 2) [m] in the robot's frame.
        normals: (n, 2).
        ages: (n,) the points' times in the turn, -0.5 to 0.5.
        first: The number of the first point to add.
    """
    rows = grid.rows
    for k in range(first, len(points)):
        theta = pose[2] + bend * ages[k]
        c, s = math.cos(theta), math.sin(theta)
        x = pose[0] + c * points[k, 0] - s * points[k, 1]
        y = pose[1] + s * points[k, 0] + c * points[k, 1]
        nx, ny = c * normals[k, 0] - s * normals[k, 1], s * normals[k, 0] + c * normals[k, 1]
        column, row = (
            math.floor((x - grid.corner[0]) / grid.cell[0]),
            math.floor((y - grid.corner[1]) / grid.cell[0]),
        )
        tile_row, tile_column = row // _SIDE, column // _SIDE
        if row < 0 or column < 0 or tile_row >= grid.directory.shape[0] or tile_column >= grid.directory.shape[1]:
            return k
        if grid.directory[tile_row, tile_column] < 0:
            if (grid.used[0] + 1) * _PER_TILE > len(rows):
                return k
            grid.directory[tile_row, tile_column] = grid.used[0]
            grid.used[0] += 1
        at = _first_row(grid, column, row)
        place = at if rows[at, 4] <= rows[at + 1, 4] else at + 1  # the free one, or the weaker
        for face in (at, at + 1):
            if rows[face, 4] > 0.0 and rows[face, 2] * nx + rows[face, 3] * ny > _SAME:
                place = face
                break
        if rows[place, 4] > 0.0 and rows[place, 2] * nx + rows[place, 3] * ny <= _SAME:
            rows[place, 4] -= 1.0  # others outvote a face that nobody sees any more
            if rows[place, 4] > 0.0:
                continue
            rows[place, 4] = 0.0
        _join(rows, place, x, y, nx, ny)
    return len(points)


@jittable
def _join(rows: Floats, place: int, x: float, y: float, nx: float, ny: float) -> None:
    """Average a point with a surfel."""
    weight = rows[place, 4]
    if weight >= _MAX_WEIGHT:
        weight *= _DECAY
    total = weight + 1.0
    rows[place, 0] = (rows[place, 0] * weight + x) / total
    rows[place, 1] = (rows[place, 1] * weight + y) / total
    ax, ay = rows[place, 2] * weight + nx, rows[place, 3] * weight + ny
    length = math.hypot(ax, ay)
    if length > 0.0:
        rows[place, 2], rows[place, 3] = ax / length, ay / length
    rows[place, 4] = total


@jittable
def nearest(grid: SurfelGrid, x: float, y: float, nx: float, ny: float, reach: float, agreement: float) -> int:
    """The row of the nearest surfel within `reach` [m] whose normal agrees (product > `agreement`); -1: there is none.

    Cells are searched in square rings, until the next ring must be farther than what was found.
    """
    rows, cell = grid.rows, grid.cell[0]
    across, up = (x - grid.corner[0]) / cell, (y - grid.corner[1]) / cell
    column, row = math.floor(across), math.floor(up)
    fx, fy = across - column, up - row
    border = cell * min(fx, 1.0 - fx, fy, 1.0 - fy)
    best, found, ring = reach * reach, -1, 0
    while ring == 0 or (border + (ring - 1) * cell) ** 2 < best:
        for i in range(-ring, ring + 1):
            step = 1 if i in (-ring, ring) else 2 * ring
            for j in range(-ring, ring + 1, step):
                at = _first_row(grid, column + j, row + i)
                if at < 0:
                    continue
                for face in (at, at + 1):
                    if rows[face, 4] > 0.0 and rows[face, 2] * nx + rows[face, 3] * ny > agreement:
                        dx, dy = rows[face, 0] - x, rows[face, 1] - y
                        if dx * dx + dy * dy < best:
                            best, found = dx * dx + dy * dy, face
        ring += 1
    return found


@jittable
def is_behind(grid: SurfelGrid, x: float, y: float, end_x: float, end_y: float) -> bool:
    """Whether a beam from one place to another passes through a wall of the map; its ends do not count.

    Cells along the beam are visited in order (Amanatides and Woo, 1987).
    """
    rows, cell = grid.rows, grid.cell[0]
    length = math.hypot(end_x - x, end_y - y)
    if length < 2.0 * _MARGIN:
        return False
    ux, uy = (end_x - x) / length, (end_y - y) / length
    across, up = (x - grid.corner[0]) / cell, (y - grid.corner[1]) / cell
    column, row = math.floor(across), math.floor(up)
    right, above = (1 if ux > 0.0 else -1), (1 if uy > 0.0 else -1)
    next_x = ((column + (ux > 0.0)) - across) * cell / ux if ux != 0.0 else math.inf
    next_y = ((row + (uy > 0.0)) - up) * cell / uy if uy != 0.0 else math.inf
    far = 0.0
    while far < length - _MARGIN:
        at = _first_row(grid, column, row)
        if at >= 0 and far > _MARGIN:
            for face in (at, at + 1):
                facing = rows[face, 2] * ux + rows[face, 3] * uy
                aside = (rows[face, 0] - x) * uy - (rows[face, 1] - y) * ux
                if rows[face, 4] >= _SOLID and facing < -_FACING and abs(aside) < _ASIDE:
                    return True
        if next_x < next_y:
            far, column = next_x, column + right
            next_x += cell / abs(ux)
        else:
            far, row = next_y, row + above
            next_y += cell / abs(uy)
    return False


@jittable
def share_behind(grid: SurfelGrid, pose: Floats, lidar: Floats, points: Floats, normals: Floats, reach: float) -> float:
    """The share of points that have no surfel within `reach` [m], and lie behind a wall of the map.

    Args:
        grid: The map.
        pose: (3,) of the robot.
        lidar: (3,) its pose on the robot.
        points: (n, 2) [m] in the robot's frame.
        normals: (n, 2).
        reach: [m].
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    from_x, from_y = pose[0] + c * lidar[0] - s * lidar[1], pose[1] + s * lidar[0] + c * lidar[1]
    count = 0
    for k in range(len(points)):
        x = pose[0] + c * points[k, 0] - s * points[k, 1]
        y = pose[1] + s * points[k, 0] + c * points[k, 1]
        nx, ny = c * normals[k, 0] - s * normals[k, 1], s * normals[k, 0] + c * normals[k, 1]
        if nearest(grid, x, y, nx, ny, reach, _SAME) < 0 and is_behind(grid, from_x, from_y, x, y):
            count += 1
    return count / max(len(points), 1)


class SurfelMap:
    """A map of surfels that grows."""

    def __init__(self, cell: float = CELL) -> None:
        self._tile = _SIDE * cell
        self.grid = SurfelGrid(
            np.full((8, 8), -1), np.full(2, -4 * self._tile), np.array([cell]), self._empty(8), np.zeros(1, np.int64)
        )

    @staticmethod
    def _empty(tiles: int) -> Floats:
        return np.zeros((tiles * _PER_TILE, 5))

    def insert(self, pose: Floats, points: Floats, normals: Floats, ages: Floats, bend: float = 0.0) -> None:
        """Add points; arguments are those of the kernel `insert`."""
        pose = np.asarray(pose, float)
        done = 0
        while (done := compiled(insert)(self.grid, pose, float(bend), points, normals, ages, done)) < len(points):
            x, y = pose[:2]
            self._make_room(float(np.hypot(points[:, 0], points[:, 1]).max()), float(x), float(y))

    def _make_room(self, radius: float, x: float, y: float) -> None:
        """Room for one more tile, and a directory that reaches `radius` around a place."""
        directory, corner, _, rows, used = self.grid
        if (used[0] + 1) * _PER_TILE > len(rows):
            rows = np.concatenate([rows, self._empty(len(rows) // _PER_TILE)])
        low = np.floor((np.array([x, y]) - radius - corner) / self._tile).astype(int)
        high = np.floor((np.array([x, y]) + radius - corner) / self._tile).astype(int) + 1
        before, after = np.maximum(0, -low), np.maximum(0, high - directory.shape[::-1])
        if before.any() or after.any():
            sides = [(int(b + 4 * (b > 0)), int(a + 4 * (a > 0))) for b, a in zip(before, after, strict=True)]
            directory = np.pad(directory, sides[::-1], constant_values=-1)
            corner = corner - self._tile * np.array([sides[0][0], sides[1][0]])
        self.grid = self.grid._replace(directory=directory, corner=corner, rows=rows)

    def share_behind(self, pose: Floats, lidar: Floats, points: Floats, normals: Floats, reach: float) -> float:
        """As the kernel `share_behind`."""
        return compiled(share_behind)(self.grid, pose, lidar, points, normals, reach)

    def surfels(self, min_weight: float = 1.0) -> Floats:
        """Those of some weight, in the order of rows: (n, 5) mean x, y [m], mean normal x, y, weight."""
        rows = self.grid.rows[: self.grid.used[0] * _PER_TILE]
        return rows[rows[:, 4] >= min_weight]
