"""Logs for the benchmark of maps: of simulated arenas, parts of these, and two real ones."""

import functools
import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from mercator_design import seeds
from mercator_design.fsm import parse
from mercator_design.mapping.logs import RobotLog, Turn
from mercator_design.mapping.poses import between, compose, interpolate, inverse
from mercator_design.mapping.readers.carmen import read_carmen
from mercator_design.mapping.readers.simulation import simulated_logs
from mercator_design.missions.mission import Mission, load_mission

CARMEN = "CARMEN"
"""The environment variable with the folder of the real logs."""

EXPLORATION = "--nstates 1 --s0 0 --rwm0 20"
_CIRCLE = ("arena.walls.sides=64", "arena.walls.apothem=1.25")
_LONG = 1.04  # the factor of the distances of the real logs' odometry
_WALK, _TURN_WALK = math.radians(1.0), math.radians(0.3)  # [rad/sqrt(m)], [rad/sqrt(rad)]
_MAX_RANGE = 30.0  # [m] of a return of these logs
_SAMPLED = 0.05  # [s] between samples of odometry
_PARTS = ((0.0, 0.45), (0.28, 0.73), (0.55, 1.0))
"""Overlapping parts of a real log, as those of three robots."""


def mission_of(arena: str, duration: float) -> Mission:
    """A shipped arena, or `circle`, with robots whose odometry drifts."""
    overrides = (f"duration={duration:g}", "robot_model=mercator-drifting")
    if arena == "circle":
        return load_mission("map_empty_dodecagon", (*overrides, *_CIRCLE))
    return load_mission(arena, overrides)


@functools.lru_cache(maxsize=2)
def explored(arena: str, seed: int, duration: float) -> list[RobotLog]:
    """The logs of robots that explore an arena; the last ones are kept, for windows of them."""
    return simulated_logs(mission_of(arena, duration), parse(EXPLORATION), seed)


def cut(log: RobotLog, start: float, length: float) -> RobotLog:
    """A part of a log [s]."""
    begin = log.turns[0].middle + start
    turns = [turn for turn in log.turns if begin <= turn.middle < begin + length]
    rows = (log.odometry_times >= begin - 0.3) & (log.odometry_times <= begin + length + 0.3)
    return replace(log, turns=turns, odometry_times=log.odometry_times[rows], odometry=log.odometry[rows])


def shifted(log: RobotLog, later: float) -> RobotLog:
    """The same log at another time [s]."""
    return replace(
        log,
        turns=[turn._replace(times=turn.times + later) for turn in log.turns],
        odometry_times=log.odometry_times + later,
        truth_times=None if log.truth_times is None else log.truth_times + later,
    )


def carmen_robots(name: str, seed: int, robots: int) -> list[RobotLog]:
    """A real log as that of one robot, or of three that were in the same building, with unknown starts."""
    log = carmen_log(Path(os.environ[CARMEN]) / f"{name}-corrected.log.gz", seed)
    if robots == 1:
        return [log]
    n = len(log.turns)
    parts = [slice(round(low * n), round(high * n)) for low, high in _PARTS]
    return [_part(log, part, f"robot {number}") for number, part in enumerate(parts)]


def _part(log: RobotLog, part: slice, name: str) -> RobotLog:
    turns = log.turns[part]
    rows = (log.odometry_times >= turns[0].middle - 0.5) & (log.odometry_times <= turns[-1].middle + 0.5)
    own = compose(inverse(log.odometry[rows][0]), log.odometry[rows])
    return replace(log, name=name, turns=turns, odometry_times=log.odometry_times[rows], odometry=own)


def carmen_log(file: Path, seed: int) -> RobotLog:
    """A corrected log in CARMEN's format, with odometry made from its poses: the drift is that of a seed.

    The scans are a second apart, as their times are rounded, and have no skew.
    """
    read = read_carmen(file)
    truth = read.odometry  # that of these files was corrected
    turns = [
        Turn(
            number + 1e-7 * np.arange(len(turn.ranges), dtype=np.float64),
            turn.angles,
            np.where(turn.ranges > _MAX_RANGE, 0.0, turn.ranges),
        )
        for number, turn in enumerate(read.turns)
    ]
    times = np.arange(len(turns), dtype=np.float64)
    samples = np.arange(0.0, times[-1] + _SAMPLED, _SAMPLED)
    odometry = interpolate(times, _drifting(truth, seed), samples)
    return RobotLog(file.name.split("-")[0], turns, samples, odometry, truth_times=times, truth=truth)


def _drifting(truth: np.ndarray, seed: int) -> np.ndarray:
    """Odometry of a true way (n, 3), from the origin."""
    generator = seeds.generator(seed, "odometry of a real log")
    found = np.zeros_like(truth)
    steps = between(truth[:-1], truth[1:])
    walk = generator.normal(size=len(steps)) * _WALK * np.sqrt(np.hypot(steps[:, 0], steps[:, 1]))
    walk += generator.normal(size=len(steps)) * _TURN_WALK * np.sqrt(np.abs(steps[:, 2]))
    for k, step in enumerate(steps):
        found[k + 1] = compose(found[k], step * (_LONG, _LONG, 1.0) + np.array([0.0, 0.0, walk[k]]))
    return found
