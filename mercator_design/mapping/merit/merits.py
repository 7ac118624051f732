"""All figures of merit of one map whose truth is known: what `mdesign map` tells, and what the benchmark measures.

Relative errors are evo's (state `delta` of one turn, or of one metre; relations `trans_part` and `angle_rad`), with the
pairs of all robots together; relations are those of Kuemmerle et al. (2009), on pairs of places that are near each
other and far apart in the logs.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from mercator_design import seeds
from mercator_design.arrays import Flags, Floats, Numbers
from mercator_design.errors import MercatorError
from mercator_design.mapping.merit.occupancy import Agreement, agreement, coverage
from mercator_design.mapping.merit.trajectories import (
    AbsoluteError,
    RelativeError,
    near_pairs,
    pairs_along,
    pairs_apart,
    relative_error,
    swarm_error,
)
from mercator_design.mapping.plan.occupancy import occupancy_of
from mercator_design.mapping.plan.plans import Plan
from mercator_design.mapping.plan.ways import Way
from mercator_design.mapping.poses import interpolate, transform

CELLS = (0.05, 0.025)
"""[m] Widths of the cells, and tolerances, of which the F1 is told."""
NEARER, APART = 2.0, 30.0
"""[m], [s] Places of relations are nearer than the one, and seen with more than the other between them."""
_METRE = 1.0
_MOMENTS = 40  # of the curve of coverage


class Coverage(NamedTuple):
    """The share of the walls that the map has, over time."""

    moments: Floats  # (k,) [s] since the map's first turn
    shares: Floats  # (k,)


class MapMerit(NamedTuple):
    """A map against the truth; None where there is nothing to compare."""

    keyframes: AbsoluteError | None
    turns: AbsoluteError | None
    by_turn: RelativeError | None  # from each turn to the next one
    by_metre: RelativeError | None  # over one metre after the other
    relations: RelativeError | None  # of near places that are far apart in the logs
    between_robots: RelativeError | None  # of near places of different robots, whenever they were there
    cells: tuple[Agreement, ...]  # of each of CELLS; none without walls
    coverage: Coverage | None


def truth_of(way: Way, times: Floats) -> Floats:
    """The true poses (n, 3) of a robot at times on its clock.

    Raises:
        ValueError: They are not known.
    """
    if way.log.truth_times is None or way.log.truth is None:
        raise ValueError(f"{way.name}: expected a log with true poses")
    return interpolate(way.log.truth_times, way.log.truth, times)


def merit_of(plan: Plan, seed: int = 0) -> MapMerit | None:
    """The figures of merit of a map; None if the true poses of a robot are not known, or there are no poses.

    Args:
        plan: The map.
        seed: Of the pairs of near places.
    """
    ways = [way for way in plan.ways if len(way.poses)]
    if not ways or any(way.log.truth is None for way in ways):
        return None
    turns = error_of(ways)
    known = _walls_of(ways)
    return MapMerit(
        error_of(ways, at_keyframes=True),
        turns,
        _steps(ways, lambda way: pairs_apart(len(way.poses))),
        _steps(ways, lambda way: pairs_along(way.poses[:, :2], _METRE)),
        relations(ways, seed),
        relations(ways, seed, between_robots=True),
        () if known is None or turns is None else _agreements(plan, ways, known, turns.alignment),
        None if known is None or turns is None else _coverage(plan, ways, known, turns.alignment),
    )


def _walls_of(ways: Sequence[Way]) -> Floats | None:
    """The true walls; None if they are not known, or those of robots differ."""
    walls = [way.log.walls for way in ways if way.log.walls is not None]
    is_known = len(walls) == len(ways) and len(walls[0]) > 0
    return walls[0] if is_known and all(np.array_equal(walls[0], one) for one in walls[1:]) else None


def error_of(ways: Sequence[Way], *, at_keyframes: bool = False) -> AbsoluteError | None:
    """The absolute error of all ways after one alignment of all together; None of fewer than two poses.

    Raises:
        ValueError: The true poses of a robot are not known.
    """
    estimates, truths = [], []
    for way in ways:
        found, times = (way.keyframe_poses, way.keyframe_times) if at_keyframes else (way.poses, way.times)
        estimates.append(found)
        truths.append(truth_of(way, times))
    return swarm_error(estimates, truths) if sum(map(len, estimates)) > 1 else None


def relations(ways: Sequence[Way], seed: int, *, between_robots: bool = False) -> RelativeError | None:
    """Errors of the relative poses of at most 4000 pairs of near places; None if there are none.

    Args:
        ways: Of one map.
        seed: Draws the pairs.
        between_robots: The pairs are of different robots; otherwise they are seen with APART seconds between them.

    Raises:
        ValueError: The true poses of a robot are not known.
    """
    estimated = np.concatenate([way.poses for way in ways])
    true = np.concatenate([truth_of(way, way.times) for way in ways])
    times = np.concatenate([way.times - way.offset for way in ways])
    names = [way.log.name for way in ways]
    robots = np.repeat([names.index(name) for name in names], [len(way.times) for way in ways])
    order = np.argsort(times, kind="stable")
    estimated, true, times, robots = estimated[order], true[order], times[order], robots[order]

    def is_wanted(first: Numbers, second: Numbers) -> Flags:
        if between_robots:
            return np.asarray(robots[first] != robots[second])
        return np.asarray(np.abs(times[first] - times[second]) >= APART)

    pairs = near_pairs(true, seeds.generator(seed, "relations"), is_wanted, nearer=NEARER)
    return relative_error(estimated, true, pairs) if len(pairs) else None


def _steps(ways: Sequence[Way], pairs_of: Callable[[Way], Numbers]) -> RelativeError | None:
    """Relative errors of pairs of each way, together."""
    estimated = np.concatenate([way.poses for way in ways])
    true = np.concatenate([truth_of(way, way.times) for way in ways])
    starts = np.cumsum([0, *(len(way.poses) for way in ways)])
    pairs = np.concatenate([start + pairs_of(way) for start, way in zip(starts, ways, strict=False)])
    return relative_error(estimated, true, pairs) if len(pairs) else None


def _agreements(plan: Plan, ways: Sequence[Way], walls: Floats, alignment: Floats) -> tuple[Agreement, ...]:
    found = []
    for cell in CELLS:
        try:
            grid = plan.occupancy if plan.occupancy.resolution == cell else occupancy_of(ways, cell)
        except MercatorError:  # it would be too large
            continue
        found.append(agreement(transform(alignment, grid.centres), walls, cell))
    return tuple(found)


def _coverage(plan: Plan, ways: Sequence[Way], walls: Floats, alignment: Floats) -> Coverage:
    begin = min(float(way.times[0] - way.offset) for way in ways)
    end = max(float(way.times[-1] - way.offset) for way in ways)
    moments = np.linspace(begin, end, _MOMENTS + 1)
    places = transform(alignment, plan.pieces[:, :2])
    return Coverage(moments - begin, coverage(places, walls, CELLS[0], plan.looks.first, moments))
