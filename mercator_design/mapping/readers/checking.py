"""Checks of a log before it is mapped."""

from dataclasses import replace

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.errors import MercatorError
from mercator_design.mapping.logs import RobotLog

_MIN_SAMPLES = 2
_MAX_PLACE = 1e5  # [m] of odometry
_MAX_RANGE = 1e4  # [m]


def checked(log: RobotLog, place: str) -> RobotLog:
    """The log, if a map can be made of it.

    Turns without beams, or of the same time as the one before, and readings that no lidar has, are left out. Notes
    tell of the latter two.

    Args:
        log: Of one robot.
        place: Its file, for messages.

    Raises:
        MercatorError: Times do not rise, values are missing or not finite, or there is no odometry.
    """
    where = f"{place}: {log.name}"
    if len(log.odometry_times) < _MIN_SAMPLES and log.turns:
        raise MercatorError(f"{where}: expected {_MIN_SAMPLES} or more samples of odometry, found {len(log.odometry)}")
    if log.odometry.shape != (len(log.odometry_times), 3):
        raise MercatorError(f"{where}: expected a pose for each time of odometry, found {log.odometry.shape}")
    _check_times(f"{where}: odometry", log.odometry_times)
    if not (np.isfinite(log.odometry).all() and np.abs(log.odometry[:, :2]).max(initial=0.0) < _MAX_PLACE):
        raise MercatorError(f"{where}: odometry: expected poses within {_MAX_PLACE:g} m, found others")
    turns, notes = [turn for turn in log.turns if len(turn.times)], list(log.notes)
    apart = [turns[k] for k in range(len(turns)) if k == 0 or turns[k].times[0] != turns[k - 1].times[0]]
    if len(apart) < len(turns):
        notes.append(f"{len(turns) - len(apart)} turns of the same time as the one before are left out.")
        turns = apart
    _check_times(f"{where}: turns", np.array([turn.times[0] for turn in turns], float))
    wrong = 0
    for number, turn in enumerate(turns, 1):
        if not len(turn.times) == len(turn.angles) == len(turn.ranges):
            counts = ", ".join(str(len(one)) for one in turn)
            raise MercatorError(f"{where}: turn {number}: expected a time, an angle and a range a beam, found {counts}")
        if (np.diff(turn.times) < 0.0).any():
            raise MercatorError(f"{where}: turn {number}: expected beams in the order of time")
        if not np.isfinite(turn.angles).all():
            raise MercatorError(f"{where}: turn {number}: expected angles, found others")
        if not (is_right := (turn.ranges >= 0.0) & (turn.ranges < _MAX_RANGE)).all():
            wrong += int(np.count_nonzero(~is_right))
            turns[number - 1] = turn._replace(ranges=np.where(is_right, turn.ranges, 0.0))
    if wrong:
        notes.append(f"{wrong} readings below 0 or beyond {_MAX_RANGE:g} m are left out.")
    is_same = len(turns) == len(log.turns) and not wrong
    return log if is_same else replace(log, turns=turns, notes=tuple(notes))


def _check_times(where: str, times: Floats) -> None:
    """Raise MercatorError unless times (n,) [s] are finite and rise."""
    steps = np.diff(times)
    if not np.isfinite(times).all():
        raise MercatorError(f"{where}: expected times in seconds, found {times[~np.isfinite(times)][0]}")
    if (steps <= 0.0).any():
        row = int(np.argmax(steps <= 0.0))
        raise MercatorError(f"{where}: expected times that rise, found {times[row]:g} before {times[row + 1]:g}")
