"""How well robots cover a floor, over time (cells of a grid) or at the end (distances from points).

The original objectives sample random points. Here the points are on fixed grids, so a score is a function of the trace
alone; the error of each is given, and is smaller than that of the sampling.
"""

import math
from typing import Annotated

import numpy as np

from mercator_design.arrays import Floats, Numbers
from mercator_design.config.schema import Positive, Range
from mercator_design.missions.arena import Point, Size
from mercator_design.missions.plugins import Zones, objective
from mercator_design.missions.score_limits import ExperimentSize
from mercator_design.missions.trace import Trace

Side = Annotated[float, Range(0.01, 1000.0)]
Cells = Annotated[int, Range(1, 500)]

_ACROSS = 40  # points along a side of a square
_AROUND = 720  # points on a circle
_OUTWARDS, _TURNS = 48, 144  # points on a disc


def _of_ages(size: ExperimentSize, **_: object) -> tuple[float, float]:
    return 0.0, size.cycles * (size.cycles - 1) / 2.0


@objective(limits=_of_ages)
def cell_age(
    trace: Trace,
    *,
    side: Side,  # [m] of the square, whose middle is the origin
    cells: Cells,  # how many, along each side of the square
) -> float:
    """How long the cells of a grid stay unvisited: the mean cell's age, summed over cycles; a cost.

    `cells` x `cells` of them cover a square of `side` metres around the origin. In each cycle the ages of
    visited cells become 0, ages are added up, and then each grows by 1 (GridExplorationLoopFunc in ARGoS).

    Between two visits g cycles apart a cell costs 0 + 1 + ... + (g - 1), so the times of visits are enough.
    """
    cell, cycle = _visits(trace, side, cells)
    length = trace.cycles + 1
    starts = np.arange(0, cells * cells * length, length)  # ages begin at 0, as after a visit,
    ends = starts + trace.cycles  # and the last gap ends with the experiment
    visits = cell * length + cycle
    gaps = np.diff(np.sort(np.concatenate([starts, visits, ends])))  # 1 from a cell's end to the next's start
    return float(np.sum(gaps * (gaps - 1) // 2) / (cells * cells))


def _of_visits(size: ExperimentSize, **_: object) -> tuple[float, float]:
    return 0.0, float(size.cycles)


@objective(limits=_of_visits)
def cells_visited(
    trace: Trace,
    *,
    side: Side,  # [m] of the square, whose middle is the origin
    cells: Annotated[int, Range(1, 5000)],  # how many, along each side of the square
) -> float:
    """The share of a grid's cells that some robot has visited so far, summed over cycles; the grid is as in cell_age.

    With cells of 1 cm it is the test of exploration of AutoMoDe-Modules, which counts cells and not their share.
    """
    cell, cycle = _visits(trace, side, cells)
    _, first = np.unique(cell, return_index=True)  # visits are in the order of time
    return float(np.sum(trace.cycles - cycle[first]) / (cells * cells))


def _visits(trace: Trace, side: float, cells: int) -> tuple[Numbers, Numbers]:
    """The numbers of the cells that robots are in, and when, cycle by cycle."""
    x = cells * (trace.positions[..., 0] / side + 0.5)
    y = cells * (trace.positions[..., 1] / side + 0.5)
    on_grid = (x > -1.0) & (x < cells) & (y > -1.0) & (y < cells)  # truncated: up to a cell beyond is cell 0
    cell = np.trunc(y[on_grid]) * cells + np.trunc(x[on_grid])
    return cell.astype(np.int64), np.nonzero(on_grid)[0]


def _of_both(
    size: ExperimentSize,  # noqa: ARG001 - the distances that count are limited
    *,
    farthest_in_square: float,
    farthest_on_circle: float,
    square_unit: float,
    circle_unit: float,
    **_: object,
) -> tuple[float, float]:
    return 0.0, farthest_in_square / square_unit + farthest_on_circle / circle_unit


@objective(limits=_of_both)
def surface_and_perimeter(
    trace: Trace,
    *,
    square_center: Point,  # [m] x, y of the square's middle
    square_side: Size,  # [m] of the square
    circle_center: Point,  # [m] x, y of the circle's middle
    circle_radius: Size,  # [m] of the circle
    margin: Size = 0.04,  # [m] from the circle's line within which a robot is on it
    farthest_in_square: Size = 0.85,  # [m] that a point of the square counts as away from the robots at most
    farthest_on_circle: Size = 0.6,  # [m] that a point of the circle counts as away from the robots at most
    square_unit: Positive = 0.08,  # [m] by which the square's mean distance is divided
    circle_unit: Positive = 0.06,  # [m] by which the circle's mean distance is divided
) -> float:
    """SPC of Chocolate: how badly a square's surface and a circle's line are covered at the end; a cost.

    The score is the mean distance from a point of the square to the nearest robot in it, over `square_unit`, plus the
    mean distance from a point of the circle to the nearest robot within `margin` of it, over `circle_unit`. Distances
    are at most the farthest. Points: 40 x 40 and 720; error below 0.1 %.
    """
    robots = trace.final_positions
    from_square = _surface_distance(robots, square_center, square_side, farthest_in_square)
    from_center = np.hypot(robots[:, 0] - circle_center[0], robots[:, 1] - circle_center[1])
    near = robots[np.abs(from_center - circle_radius) <= margin]
    angles = 2.0 * math.pi * (np.arange(_AROUND) + 0.5) / _AROUND
    line = circle_center + circle_radius * np.column_stack([np.cos(angles), np.sin(angles)])
    from_circle = float(np.mean(_nearest(line, near, farthest_on_circle)))
    return from_square / square_unit + from_circle / circle_unit


def _of_square(size: ExperimentSize, *, farthest: float, **_: object) -> tuple[float, float]:  # noqa: ARG001
    return 0.0, (100.0 * farthest) ** 2


@objective(limits=_of_square)
def surface_distance(
    trace: Trace,
    *,
    square_center: Point,  # [m] x, y of the square's middle
    square_side: Size,  # [m] of the square
    farthest: Size = 0.67,  # [m] that a point counts as away from the robots at most
) -> float:
    """SPD8 of Mate: the square of the mean distance [cm2] from a point of a square to the nearest robot in it; a cost.

    At the end; distances are at most `farthest`. Points and error as in surface_and_perimeter.
    """
    return (100.0 * _surface_distance(trace.final_positions, square_center, square_side, farthest)) ** 2


def _of_disc(size: ExperimentSize, *, farthest: float, unit: float, **_: object) -> tuple[float, float]:  # noqa: ARG001
    return 0.0, farthest / unit


@objective(limits=_of_disc)
def coverage_outside_zones(
    trace: Trace,
    *,
    zones: Zones,  # zones in which robots do not count
    radius: Size = 1.2,  # [m] of the disc, whose middle is the origin
    farthest: Size = 2.5,  # [m] that a point counts as away from the robots at most
    unit: Positive = 0.01,  # [m] by which the score is divided
) -> float:
    """CFA of Chocolate: how near to every point of a disc around the origin a robot outside the zones is at the end.

    `farthest` less the mean distance to the nearest such robot, over `unit`, but not less than 0. As in the original
    the mean is over points uniform in distance from the centre, not in area. Its distances were not summed (the score
    was nearly always 250); here they are. Points: 48 distances x 144 angles; error below 0.1 %.
    """
    robots = trace.final_positions[~trace.inside(zones, "end")[0]]
    distance = radius * (np.arange(_OUTWARDS) + 0.5) / _OUTWARDS
    angle = 2.0 * math.pi * (np.arange(_TURNS) + 0.5) / _TURNS
    points = np.stack([np.outer(distance, np.cos(angle)), np.outer(distance, np.sin(angle))], axis=-1).reshape(-1, 2)
    return max(0.0, farthest - float(np.mean(_nearest(points, robots, farthest)))) / unit


def _surface_distance(robots: Floats, center: Point, side: float, farthest: float) -> float:
    """The mean distance from a point of a square to the nearest robot in it."""
    along = side * ((np.arange(_ACROSS) + 0.5) / _ACROSS - 0.5)
    points = np.stack(np.meshgrid(center[0] + along, center[1] + along), axis=-1).reshape(-1, 2)
    inside = np.all(np.abs(robots - center) <= 0.5 * side, axis=1)
    return float(np.mean(_nearest(points, robots[inside], farthest)))


def _nearest(points: Floats, robots: Floats, farthest: float) -> Floats:
    """The distance from each point (n, 2) to the nearest robot, at most `farthest`."""
    nearest = np.full(len(points), farthest)
    for x, y in robots:
        np.minimum(nearest, np.hypot(points[:, 0] - x, points[:, 1] - y), out=nearest)
    return nearest
