"""Checks of a log before it is mapped."""

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.errors import MercatorError
from mercator_design.mapping.logs import RobotLog

_MIN_SAMPLES = 2
_MAX_PLACE = 1e5  # [m] of odometry
_MAX_RANGE = 1e4  # [m]


def checked(log: RobotLog, place: str) -> RobotLog:
    """The log, if a map can be made of it; turns without beams are left out.

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
    turns = [turn for turn in log.turns if len(turn.times)]
    _check_times(f"{where}: turns", np.array([turn.times[0] for turn in turns], float))
    for number, turn in enumerate(log.turns, 1):
        if not len(turn.times) == len(turn.angles) == len(turn.ranges):
            counts = ", ".join(str(len(one)) for one in turn)
            raise MercatorError(f"{where}: turn {number}: expected a time, an angle and a range a beam, found {counts}")
        if (np.diff(turn.times) < 0.0).any():
            raise MercatorError(f"{where}: turn {number}: expected beams in the order of time")
        if not (np.isfinite(turn.angles).all() and ((turn.ranges >= 0.0) & (turn.ranges < _MAX_RANGE)).all()):
            raise MercatorError(f"{where}: turn {number}: expected angles and distances from 0 on, found others")
    if len(turns) == len(log.turns):
        return log
    return RobotLog(
        *(log.name, turns, log.odometry_times, log.odometry, log.lidar_pose, log.start, log.truth_times, log.truth)
    )


def _check_times(where: str, times: Floats) -> None:
    """Raise MercatorError unless times (n,) [s] are finite and rise."""
    steps = np.diff(times)
    if not np.isfinite(times).all():
        raise MercatorError(f"{where}: expected times in seconds, found {times[~np.isfinite(times)][0]}")
    if (steps <= 0.0).any():
        row = int(np.argmax(steps <= 0.0))
        raise MercatorError(f"{where}: expected times that rise, found {times[row]:g} before {times[row + 1]:g}")
