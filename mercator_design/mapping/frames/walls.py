"""The walls that fragments saw, in one frame: as points with normals, and as a field to compare others with."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Flags, Floats, Numbers
from mercator_design.mapping.frames.fragment import Fragment, keyframes_of
from mercator_design.mapping.poses import rotate, transform
from mercator_design.mapping.track import Keyframes

CELL = 0.05
"""[m]"""
FREE = -0.25
"""The field's value where beams went through."""

_SD = 0.05
"""[m] Of the field beside walls."""
_SECTORS = 8
"""Number of directions of normals: the faces of a thin wall are apart."""
_MAX_VIEWS = 400
"""Keyframes whose beams are followed, evenly spread."""
_BEFORE_WALL = 0.10
"""[m] Before a return, from which on a beam says nothing of free space."""


class Walls(NamedTuple):
    """Pieces of walls, each the mean of the points of a cell and a sector of normals."""

    points: Floats  # (n, 2) [m]
    normals: Floats  # (n, 2)
    counts: Numbers  # (n,) of points
    views: Floats  # (v, 3) poses of keyframes
    ends: tuple[Floats, ...]  # (v) of (p, 2) points that were seen from each of these

    def moved(self, frame: Floats) -> tuple[Floats, Floats]:
        """Points and normals in the frame in which this one stands at a pose."""
        return transform(frame, self.points), rotate(float(frame[2]), self.normals)


class Field(NamedTuple):
    """How well a point agrees with walls: 1 on them, 0 where nothing was seen, FREE where beams went through."""

    low: Floats  # (2,) [m] the corner of the first cell
    values: NDArray[np.float32]  # (rows, columns)

    def at(self, points: Floats) -> Floats:
        """The values (n,) at points (n, 2); 0 outside."""
        cells = np.floor((points - self.low) / CELL).astype(np.int64)
        rows, columns = self.values.shape
        inside = (cells >= 0).all(axis=1) & (cells[:, 0] < columns) & (cells[:, 1] < rows)
        found = np.zeros(len(points))
        found[inside] = self.values[cells[inside, 1], cells[inside, 0]]
        return found


def walls_of(parts: Sequence[Fragment], frames: Sequence[Floats]) -> Walls:
    """The walls that the keyframes of fragments saw, these standing at some frames (3,)."""
    return walls_seen(keyframes_of(parts, np.array(frames)))


def walls_seen(keyframes: Keyframes) -> Walls:
    """The walls that keyframes saw, in their frame."""
    points, normals, views, ends = [], [], [], []
    for way in np.unique(keyframes.segments):
        chosen = np.flatnonzero(keyframes.segments == way)
        viewed = set(chosen[np.linspace(0, len(chosen) - 1, min(len(chosen), _MAX_VIEWS)).astype(np.int64)].tolist())
        for k in chosen.tolist():
            pose = keyframes.poses[k]
            own, across = keyframes.of(k)
            points.append(transform(pose, own.astype(float)))
            normals.append(rotate(float(pose[2]), across.astype(float)))
            if k in viewed:
                views.append(pose)
                ends.append(points[-1])
    if not points or not sum(map(len, points)):
        nothing = np.empty((0, 2))
        return Walls(nothing, nothing, np.empty(0, dtype=np.int64), np.empty((0, 3)), ())
    place, across = np.concatenate(points), np.concatenate(normals)
    sector = np.floor((np.arctan2(across[:, 1], across[:, 0]) / (2.0 * math.pi) + 0.5) * _SECTORS) % _SECTORS
    keys = np.column_stack([np.floor(place / CELL).astype(np.int64), sector.astype(np.int64)])
    _, of, sizes = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    of, counts = of.reshape(-1), np.asarray(sizes, dtype=np.int64)
    sums: list[Floats] = [
        np.asarray(np.bincount(of, weights=column, minlength=len(counts)), dtype=np.float64)
        for column in (*place.T, *across.T)
    ]
    normal: Floats = np.column_stack(sums[2:])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-9)[:, None]
    mean: Floats = np.column_stack(sums[:2]) / counts.reshape(-1, 1)
    kept = counts >= min(2, len(points))  # one view has few points in a cell
    return Walls(mean[kept], normal[kept], counts[kept], np.asarray(views, dtype=np.float64), tuple(ends))


def field_of(walls: Walls) -> Field:
    """The field of walls.

    Raises:
        ValueError: without walls.
    """
    from scipy.ndimage import distance_transform_edt

    if len(walls.points) == 0:
        raise ValueError("expected at least one piece of a wall")
    everything = np.concatenate([walls.points, walls.views[:, :2]])
    low = np.floor(everything.min(axis=0) / CELL) * CELL - 4 * CELL
    columns, rows = (np.ceil((everything.max(axis=0) - low) / CELL).astype(int) + 5).tolist()
    occupied = np.zeros((rows, columns), dtype=np.bool_)
    cells = np.floor((walls.points - low) / CELL).astype(np.int64)
    occupied[cells[:, 1], cells[:, 0]] = True
    free = _crossed(walls, low, rows, columns)
    distance = distance_transform_edt(~occupied) * CELL
    near = np.exp(-0.5 * (distance / _SD) ** 2)
    values = np.where(distance < 3.0 * _SD, near, np.where(free, FREE, 0.0))
    return Field(low, values.astype(np.float32))


def _crossed(walls: Walls, low: Floats, rows: int, columns: int) -> Flags:
    """The cells that beams went through; only along beams that returned, as others may have met glass."""
    free = np.zeros((rows, columns), dtype=np.bool_)
    for view, ends in zip(walls.views, walls.ends, strict=True):
        way = ends[::2] - view[:2]
        length = np.linalg.norm(way, axis=1)
        if not len(length):
            continue
        steps = np.arange(0.0, max(float(length.max()) - _BEFORE_WALL, 0.0), CELL)
        share = steps[None, :] / np.maximum(length, 1e-9)[:, None]
        inside = steps[None, :] < (length - _BEFORE_WALL)[:, None]
        x = np.floor((view[0] - low[0] + way[:, :1] * share)[inside] / CELL).astype(np.int64)
        y = np.floor((view[1] - low[1] + way[:, 1:] * share)[inside] / CELL).astype(np.int64)
        within = (x >= 0) & (x < columns) & (y >= 0) & (y < rows)
        free[y[within], x[within]] = True
    return free


def open_share(field: Field) -> float:
    """How much of the border of the seen floor is no wall, but where nobody looked on: 0 of a closed room, to 1."""
    from scipy.ndimage import binary_closing, binary_dilation

    near_wall = binary_dilation(field.values > 0.0, iterations=2)
    seen = binary_closing(field.values == np.float32(FREE), iterations=3) & ~near_wall
    unknown = ~(seen | near_wall)
    opening = seen & binary_dilation(unknown)
    wall = seen & binary_dilation(near_wall)
    return float(opening.sum() / max(opening.sum() + wall.sum(), 1))


def conflict(walls: Walls, field: Field, frame: Floats) -> float:
    """The share of the walls, standing at a frame, that lie where beams went through in the field's map."""
    if len(walls.points) == 0:
        return 0.0
    values = field.at(transform(frame, walls.points))
    return float(np.mean(values <= 0.5 * FREE))
