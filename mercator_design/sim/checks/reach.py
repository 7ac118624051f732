"""Which places robots can reach from their starting poses, past walls and obstacles.

A robot is approximated by the largest disc in its body. So a place that is out of reach here is certainly out of reach;
a place within reach may still be too narrow for the robot's corners. Other robots are ignored.
"""

import math
from dataclasses import dataclass

import numpy as np

from mercator_design.arrays import Flags, Floats
from mercator_design.missions.arena import Arena
from mercator_design.missions.floor import FloorTable
from mercator_design.missions.mission import Mission
from mercator_design.missions.placement import FixedPlacement, Placement, covers
from mercator_design.missions.zone_distance import border_points, distance_to, distance_to_box, distance_to_segment
from mercator_design.sim.fields import replaced
from mercator_design.sim.robot_model import RobotModel

_SLACK = 0.005
"""[m] Upper bound of how far a robot is pushed into a wall."""
_FINE = 8  # cells along the disc's radius, if there are not too many
_COARSEST = 3
_MAX_CELLS = 100_000
_SIZES = ("body.length", "body.width", "body.radius")


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """A grid of square cells over the arena, with the cells that a robot's centre can reach."""

    low: Floats  # (2,) its lower left corner [m]
    cell: float  # [m] of a cell's side
    inside: Flags  # (rows, columns) whether the cell's centre is between the walls; the first row is the lowest
    built: Flags  # (rows, columns) whether the cell's centre is in an obstacle
    reached: Flags  # (rows, columns)

    def axes(self) -> tuple[Floats, Floats]:
        """The x (columns,) and y (rows,) of the cells' centres [m]."""
        rows, columns = self.inside.shape
        (left, bottom), cell = self.low, self.cell
        return left + cell * (np.arange(columns) + 0.5), bottom + cell * (np.arange(rows) + 0.5)

    def centres(self, cells: Flags) -> Floats:
        """The centres (n, 2) of some cells [m]."""
        (x, y), (rows, columns) = self.axes(), np.nonzero(cells)
        return np.column_stack([x[columns], y[rows]])

    def corners(self, cells: Flags) -> Floats:
        """The corners (4 n, 2) of some cells [m]."""
        ways = 0.5 * self.cell * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        return np.asarray((self.centres(cells)[:, np.newaxis] + ways).reshape(-1, 2))

    def cells_of(self, floor: FloorTable, row: int, *, within: float = 0.0) -> Flags:
        """The cells (rows, columns) whose centres are in a zone of a floor, or within a distance [m] of it."""
        cells = np.ones_like(self.inside)
        border = border_points(floor, row)
        if len(border):
            cells[:] = False
            cells[self.part(border, within)] = True
        cells[cells] = distance_to(floor, row, self.centres(cells)) <= within
        return cells

    def touched(self, floor: FloorTable, row: int) -> Flags:
        """The cells (rows, columns) that may have a point of a zone in them."""
        return self.cells_of(floor, row, within=self.cell * math.sqrt(0.5))

    def is_reached(self, floor: FloorTable, row: int) -> bool:
        """Whether a robot can reach a cell that may have a point of a zone in it."""
        return bool((self.touched(floor, row) & self.reached).any())

    def part(self, points: Floats, distance: float) -> tuple[slice, slice]:
        """The rows and columns of the cells within a distance [m] of a shape with these corners."""
        first = np.floor((points.min(axis=0) - distance - self.low) / self.cell).astype(int)
        last = np.ceil((points.max(axis=0) + distance - self.low) / self.cell).astype(int) + 1
        columns, rows = (slice(max(0, a), max(0, b)) for a, b in zip(first, last, strict=True))
        return rows, columns


def reach_of(mission: Mission, model: RobotModel) -> Reach | None:
    """The reach of the robots of a mission; None if they are too small for the grid."""
    for key, (smallest, _) in (model.vary or {}).items():
        if key in _SIZES:
            model = replaced(model, key.split("."), smallest)
    arena, radius = mission.arena, min(model.body.half_size)
    corners = arena.corners()
    low, size = corners.min(axis=0), np.ptp(corners, axis=0)
    cell = max(radius / _FINE, math.sqrt(float(size[0] * size[1]) / _MAX_CELLS))
    if cell > radius / _COARSEST:
        return None
    columns, rows = (math.ceil(length / cell) + 2 for length in size)
    grid = Reach(
        low=low - cell,
        cell=cell,
        inside=np.zeros((rows, columns), dtype=np.bool_),
        built=np.zeros((rows, columns), dtype=np.bool_),
        reached=np.zeros((rows, columns), dtype=np.bool_),
    )
    grid.inside[:] = arena.contains_grid(*grid.axes())
    # A cell is free if the disc's centre may be anywhere in it.
    free = grid.inside & ~_blocked(arena, grid, radius - _SLACK - cell * math.sqrt(0.5))
    grid.reached[:] = _connected(free, _starts(mission.placement, grid) & free)
    return grid


def _connected(free: Flags, starts: Flags) -> Flags:
    """The free cells that are connected to some starts, by sides or corners; the starts are free."""
    border = np.pad(free & ~starts, 1)
    left = border.ravel()  # free cells that are not reached yet
    width = border.shape[1]
    ways = np.array([row * width + column for row in (-1, 0, 1) for column in (-1, 0, 1)])
    newest = np.flatnonzero(np.pad(starts, 1))
    while len(newest):
        near = (newest[:, np.newaxis] + ways).ravel()
        newest = np.unique(near[left[near]])
        left[newest] = False
    return np.asarray(free & ~border[1:-1, 1:-1], dtype=np.bool_)


def _blocked(arena: Arena, grid: Reach, distance: float) -> Flags:
    """The cells whose centres are nearer to a wall or an obstacle than a distance."""
    blocked = np.zeros_like(grid.inside)
    corners = arena.corners()

    def near(points: Floats) -> tuple[tuple[slice, slice], Floats]:
        """The part of the grid around some points, and the centres (n, 2) of its cells."""
        (x, y), part = grid.axes(), grid.part(points, distance)
        rows, columns = part
        centres = np.stack(np.meshgrid(x[columns], y[rows]), axis=-1)
        return part, centres.reshape(-1, 2)

    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        part, centres = near(np.array([start, end]))
        blocked[part] |= (distance_to_segment(start, end, centres) < distance).reshape(blocked[part].shape)
    for box in arena.obstacles:
        part, centres = near(box.corners())
        half = 0.5 * box.size[0], 0.5 * box.size[1]
        away = distance_to_box(half, box.angle, centres - np.array(box.center))
        blocked[part] |= (away < distance).reshape(blocked[part].shape)
        grid.built[part] |= (away <= 0.0).reshape(blocked[part].shape)
    return blocked


def _starts(placement: Placement, grid: Reach) -> Flags:
    """The cells where a robot may start, and their neighbours."""
    starts = np.zeros_like(grid.inside)
    if isinstance(placement, FixedPlacement):
        points = np.array(placement.poses, dtype=float)[:, :2]
    else:
        starts[grid.inside] = covers(placement, grid.centres(grid.inside))
        draws = np.random.default_rng(0).random((placement.draws, 1000))  # of areas smaller than a cell
        points = placement.points(draws)
        points = points[covers(placement, points)]
    columns, rows = np.floor((points - grid.low) / grid.cell).astype(int).T
    there = (rows >= 0) & (rows < starts.shape[0]) & (columns >= 0) & (columns < starts.shape[1])
    starts[rows[there], columns[there]] = True
    padded = np.pad(starts, 1)
    beside = padded[:, :-2] | padded[:, 1:-1] | padded[:, 2:]
    return np.asarray(beside[:-2] | beside[1:-1] | beside[2:], dtype=np.bool_)
