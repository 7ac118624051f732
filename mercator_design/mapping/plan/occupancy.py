"""The occupancy grid: how often beams ended in each cell, and how often they went through it."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Flags, Floats, Numbers
from mercator_design.errors import MercatorError
from mercator_design.jit import compiled, jittable
from mercator_design.mapping import poses
from mercator_design.mapping.front.scans import CLUSTERED, NOTHING, Scan
from mercator_design.mapping.plan.ways import Way

RESOLUTION = 0.05
"""The width [m] of a cell, unless another one is asked for."""

MAX_CELLS = 100_000_000
"""Cells of a grid; so many take 1.6 GB."""

MAX_RATE = 0.2
"""The yaw rate [rad/s] of a turn and of those beside it, below which a keyframe is sharp."""

_MIN_SHARP = 0.2  # of the keyframes; if fewer are sharp, the slowest ones are taken
_MIN_HITS, _MIN_HIT_SHARE = 2, 0.15
_SAME_CLUSTER = 0.06  # [m]


class OccupancyGrid(NamedTuple):
    """The cells of a map."""

    corner: Floats  # (2,) [m] x and y of the grid's corner
    resolution: float  # [m]
    hits: Numbers  # (rows, columns) beams that ended there; rows rise with y
    crossings: Numbers  # (rows, columns) beams that went through

    @property
    def occupied(self) -> Flags:
        """The cells (rows, columns) of walls and furniture."""
        return (self.hits >= _MIN_HITS) & (self.hits > _MIN_HIT_SHARE * (self.hits + self.crossings))

    @property
    def free(self) -> Flags:
        """The cells (rows, columns) that beams went through."""
        return (self.crossings > 0) & ~self.occupied

    @property
    def centres(self) -> Floats:
        """The centres (n, 2) [m] of the occupied cells."""
        rows, columns = np.nonzero(self.occupied)
        return np.asarray(self.corner + (np.column_stack([columns, rows]) + 0.5) * self.resolution)


@jittable
def trace(
    pose: Floats,
    origins: Floats,
    points: Floats,
    kinds: Numbers,
    corner: Floats,
    cell: float,
    hits: Numbers,
    crossings: Numbers,
) -> None:
    """Count the cells of a turn's beams (Amanatides and Woo, 1987); those of clusters end nowhere.

    Args:
        pose: (3,) of the robot.
        origins: (n, 2) [m] where the beams begin, in the robot's frame.
        points: (n, 2) [m] where they end, in the robot's frame.
        kinds: (n,) of beams.
        corner: (2,) [m] of the grid.
        cell: [m].
        hits: (rows, columns), counted up.
        crossings: (rows, columns), counted up.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    rows, columns = hits.shape
    for k in range(len(kinds)):
        if kinds[k] == NOTHING:
            continue
        x = (pose[0] + c * origins[k, 0] - s * origins[k, 1] - corner[0]) / cell
        y = (pose[1] + s * origins[k, 0] + c * origins[k, 1] - corner[1]) / cell
        end_x = (pose[0] + c * points[k, 0] - s * points[k, 1] - corner[0]) / cell
        end_y = (pose[1] + s * points[k, 0] + c * points[k, 1] - corner[1]) / cell
        column, row, last_column, last_row = math.floor(x), math.floor(y), math.floor(end_x), math.floor(end_y)
        dx, dy = end_x - x, end_y - y
        right, above = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
        step_x = abs(1.0 / dx) if dx != 0.0 else math.inf
        step_y = abs(1.0 / dy) if dy != 0.0 else math.inf
        next_x = (column + (dx > 0.0) - x) / dx if dx != 0.0 else math.inf
        next_y = (row + (dy > 0.0) - y) / dy if dy != 0.0 else math.inf
        for _ in range(abs(last_column - column) + abs(last_row - row)):
            if 0 <= row < rows and 0 <= column < columns:
                crossings[row, column] += 1
            if next_x < next_y:
                next_x, column = next_x + step_x, column + right
            else:
                next_y, row = next_y + step_y, row + above
        if kinds[k] != CLUSTERED and 0 <= last_row < rows and 0 <= last_column < columns:
            hits[last_row, last_column] += 1


def sharp_keyframes(way: Way) -> Flags:
    """Which keyframes (k,) of a way turned slowly, with the turns beside them."""
    rates, turns = np.abs(way.track.rates), way.track.keyframes.turns[way.keyframes]
    if not len(turns):
        return np.zeros(0, bool)
    last = len(rates) - 1
    fastest = np.max([rates[np.clip(turns + k, 0, last)] for k in (-1, 0, 1)], axis=0)
    sharp = fastest < MAX_RATE
    if sharp.mean() < _MIN_SHARP:
        sharp = fastest <= np.quantile(fastest, _MIN_SHARP)
    return np.asarray(sharp)


def occupancy_of(ways: Sequence[Way], resolution: float = RESOLUTION) -> OccupancyGrid:
    """The grid of the sharp keyframes of ways in one frame.

    Raises:
        MercatorError: The grid would have more than MAX_CELLS cells.
    """
    low, high = _bounds(ways)
    corner = np.floor(low / resolution) * resolution - resolution
    columns, rows = (np.ceil((high - corner) / resolution).astype(int) + 2).tolist()
    if columns * rows > MAX_CELLS:
        width, height = high - low
        raise MercatorError(
            f"a map of {width:.0f} x {height:.0f} m has {columns * rows:.2g} cells of {resolution:g} m, expected at "
            f"most {MAX_CELLS:.2g}; use a coarser --resolution, or leave out a log whose odometry jumps"
        )
    hits, crossings = np.zeros((rows, columns), np.int64), np.zeros((rows, columns), np.int64)
    for way in ways:
        preparation, keyframes, found = way.preparation(), way.track.keyframes, way.keyframe_poses
        for k in np.flatnonzero(sharp_keyframes(way)):
            turn = int(keyframes.turns[way.keyframes[k]])
            scan = preparation.scan(turn)
            _unmark_furniture(way, turn, scan)
            beams = scan.beams
            pose = np.ascontiguousarray(found[k])
            compiled(trace)(pose, beams.origins, beams.points, beams.kinds, corner, resolution, hits, crossings)
    return OccupancyGrid(corner, resolution, hits, crossings)


def _unmark_furniture(way: Way, turn: int, scan: Scan) -> None:
    """Let clusters that are furniture count as walls."""
    clusters = way.track.clusters
    own = slice(*np.searchsorted(clusters.turns, [turn, turn + 1]))
    chosen = clusters.points[own][way.furniture[own]]
    if not len(chosen):
        return
    for x, y, middle, beams in scan.clusters:
        if np.hypot(chosen[:, 0] - x, chosen[:, 1] - y).min() < _SAME_CLUSTER:
            around = slice(max(0, int(middle - beams)), int(middle + beams) + 1)
            kinds, points = scan.beams.kinds[around], scan.beams.points[around]
            kinds[(kinds == CLUSTERED) & (np.hypot(points[:, 0] - x, points[:, 1] - y) < 2 * _SAME_CLUSTER)] = 1


def _bounds(ways: Sequence[Way]) -> tuple[Floats, Floats]:
    """The corners (2,) [m] of what the keyframes saw, and of where the robots were."""
    seen = [way.poses[:, :2] for way in ways if len(way.poses)]
    for way in ways:
        for pose, number in zip(way.keyframe_poses, way.keyframes.tolist(), strict=True):
            points, _ = way.track.keyframes.of(number)
            seen.append(poses.transform(pose, points.astype(float)))
    places = np.concatenate([*seen, np.zeros((0, 2))])
    if not len(places):
        return np.zeros(2), np.zeros(2)
    return places.min(axis=0), places.max(axis=0)
