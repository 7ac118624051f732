"""Correlative search: the pose of a scan in a window, over all places and headings, by a field of likelihood.

The field is the likelihood of a point in each cell, in 255ths. A second field has the largest value of the 8 x 8 cells
that begin at each cell: so a sum over points in it bounds the sums of 64 places (Olson, 2009), exactly, as the values
are integers.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Floats, Numbers
from mercator_design.jit import compiled, jittable

CELL = 0.05
"""The width [m] of a cell."""

DEVIATION = 0.08
"""The standard deviation [m] of a point from a wall."""

BLOCK = 8
"""Cells along a side of what one value of the second field bounds."""

POINTS = 60
"""Points of a scan that are looked up."""

_FULL = 255
_STENCIL = 5  # cells to each side of a point where the field is not nearly 0
_MARGIN = (_STENCIL + BLOCK + 1) * CELL  # [m] around the points, so that blocks that reach into the field begin in it
_HEADING_STEP = 0.02  # [rad]

Levels: TypeAlias = NDArray[np.uint8]


class LikelihoodField(NamedTuple):
    """Likelihoods of points around a place."""

    corner: Floats  # (2,) [m] x and y
    fine: Levels  # (rows, columns), of 255
    coarse: Levels  # (rows, columns) the largest of the 8 x 8 cells from each one on


class Window(NamedTuple):
    """Where to search, around a pose."""

    place: float  # [m] to each side
    heading: float  # [rad] to each side


@jittable
def fill(points: Floats, stencil: Levels, corner: Floats, fine: Levels, coarse: Levels) -> None:
    """Fill in both fields, which are 0 before."""
    half = len(stencil) // 2
    rows, columns = fine.shape
    for k in range(len(points)):
        column, row = int((points[k, 0] - corner[0]) / CELL), int((points[k, 1] - corner[1]) / CELL)
        for i in range(-half, half + 1):
            for j in range(-half, half + 1):
                if 0 <= row + i < rows and 0 <= column + j < columns:
                    fine[row + i, column + j] = max(fine[row + i, column + j], stencil[i + half, j + half])
    for i in range(rows):
        for j in range(columns):
            coarse[i, j] = fine[i, j]
    step = 1
    while step < BLOCK:  # in place: cells that come later still have the maximum of the step before
        for i in range(rows):
            for j in range(columns - step):
                coarse[i, j] = max(coarse[i, j], coarse[i, j + step])
        for i in range(rows - step):
            for j in range(columns):
                coarse[i, j] = max(coarse[i, j], coarse[i + step, j])
        step *= 2


@jittable
def total(field: Levels, cells: Numbers, n: int, row: int, column: int) -> int:
    """The sum over the first n cells (row, column), moved by some rows and columns."""
    found = 0
    for k in range(n):
        i, j = cells[k, 0] + row, cells[k, 1] + column
        if 0 <= i < field.shape[0] and 0 <= j < field.shape[1]:
            found += field[i, j]
    return found


@jittable
def search(
    field: LikelihoodField,
    points: Floats,
    pose: Floats,
    half: int,
    headings: int,
    step: float,
    least: int,
    cells: Numbers,
) -> tuple[int, int, int, int]:
    """The best pose in a window.

    Args:
        field: Whose first `BLOCK` rows and columns are 0, so that every block that reaches into it begins in it.
        points: (n, 2) [m] in the robot's frame.
        pose: (3,) the window's centre.
        half: Cells to each side.
        headings: Steps of headings to each side.
        step: [rad] between headings.
        least: The sum that a pose needs.
        cells: (n, 2) scratch.

    Returns:
        The best sum, and the pose's rows, columns and steps of heading from the centre; the sum is 0 if no pose has
        more than `least`.
    """
    best, best_row, best_column, best_turn = least, 0, 0, 0
    n, is_found = len(points), False
    for order in range(2 * headings + 1):  # from the centre outwards
        turn = (order + 1) // 2 if order % 2 == 1 else -(order // 2)
        c, s = math.cos(pose[2] + turn * step), math.sin(pose[2] + turn * step)
        for k in range(n):
            x = pose[0] + c * points[k, 0] - s * points[k, 1]
            y = pose[1] + s * points[k, 0] + c * points[k, 1]
            cells[k, 0], cells[k, 1] = (
                math.floor((y - field.corner[1]) / CELL),
                math.floor((x - field.corner[0]) / CELL),
            )
        for row in range(-half, half + 1, BLOCK):
            for column in range(-half, half + 1, BLOCK):
                if total(field.coarse, cells, n, row, column) <= best:
                    continue
                for i in range(row, min(row + BLOCK, half + 1)):
                    for j in range(column, min(column + BLOCK, half + 1)):
                        found = total(field.fine, cells, n, i, j)
                        if found > best:
                            best, best_row, best_column, best_turn, is_found = found, i, j, turn, True
    return best if is_found else 0, best_row, best_column, best_turn


def _stencil() -> Levels:
    cells = np.arange(-_STENCIL, _STENCIL + 1) * CELL
    squares = cells[:, np.newaxis] ** 2 + cells**2
    return np.round(_FULL * np.exp(-0.5 * squares / DEVIATION**2)).astype(np.uint8)


def likelihood_of(points: Floats) -> LikelihoodField:
    """The field of points (n, 2) [m]."""
    corner = points.min(axis=0) - _MARGIN
    columns, rows = (np.ceil((points.max(axis=0) + _MARGIN - corner) / CELL).astype(int) + 1).tolist()
    fine, coarse = np.zeros((2, rows, columns), np.uint8)
    compiled(fill)(points, _stencil(), corner, fine, coarse)
    return LikelihoodField(corner, fine, coarse)


def best_pose(
    field: LikelihoodField, points: Floats, pose: Floats, window: Window, least: float
) -> tuple[Floats, float] | None:
    """The pose (3,) of a scan with the largest mean of the field, and this mean; None: none has more than `least`.

    Args:
        field: Of the points to find it in.
        points: (n, 2) [m] of the scan; `POINTS` of them are looked up.
        pose: (3,) the window's centre.
        window: Its size.
        least: The mean that is needed, from 0 to 1.
    """
    chosen = points[np.linspace(0, len(points) - 1, min(POINTS, len(points))).round().astype(int)]
    chosen = np.ascontiguousarray(chosen, float)
    half, headings = math.ceil(window.place / CELL), math.ceil(window.heading / _HEADING_STEP)
    cells, full = np.zeros((len(chosen), 2), np.int64), _FULL * len(chosen)
    sums, row, column, turn = compiled(search)(
        field, chosen, np.asarray(pose, float), half, headings, _HEADING_STEP, int(least * full), cells
    )
    if not sums:
        return None
    return np.add(pose, [column * CELL, row * CELL, turn * _HEADING_STEP]), sums / full
