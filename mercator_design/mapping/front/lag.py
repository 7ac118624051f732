"""The lag between the clocks of lidar and odometry: what it turns a robot by while it turns shows it.

If the lidar's times are late by tau, a turn is matched at the heading of tau before, so (matched - odometry's heading)
falls by tau for each rad/s. Both are differenced from turn to turn, as the odometry's heading drifts slowly.
"""

from collections.abc import Callable

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.mapping import poses
from mercator_design.mapping.front.front_end import FrontEnd
from mercator_design.mapping.logs import RobotLog
from mercator_design.mapping.track import Track

MAX_LAG = 0.5
"""Seconds of lag that can be found; more is another fault."""

_ROUNDS = 5
_FIRST_TURNS = 300  # that the rounds match; fast turning in them is what is needed
_SETTLED = 0.001  # [s]
_MIN_CHANGE = 0.3  # [rad/s] of the yaw rate that tells something
_MIN_EVIDENCE = 30  # such changes
_WINDOW = 0.05  # [s] on each side of which the yaw rate is measured
_SPARSE = 0.5  # [s] between turns
_OUTLIER = 3.0  # robust standard deviations


def track_of(log: RobotLog, scale: float = 1.0, advance: Callable[[int], None] | None = None) -> Track:
    """Match a log, with the lag that its first turns show.

    Args:
        log: Of one robot.
        scale: A factor of the odometry's distances.
        advance: Called with the number of each turn when it was matched for good.
    """
    return FrontEnd(log, lag_of(log, scale), scale).run(advance=advance)


def lag_of(log: RobotLog, scale: float = 1.0) -> float:
    """Seconds to add to the times of a lidar; 0 if the log does not tell, or they exceed MAX_LAG.

    Arguments are those of `track_of`.
    """
    if _is_sparse(log):
        return 0.0
    lag, turns = 0.0, _FIRST_TURNS
    for _ in range(_ROUNDS):
        change = remaining_lag(FrontEnd(log, lag, scale).run(turns))
        if change is None and turns < len(log.turns):
            turns = len(log.turns)
            continue
        if change is None:
            break
        lag += change
        if abs(lag) > MAX_LAG:  # no lag of a clock, but something else
            return 0.0
        if abs(change) < _SETTLED:
            break
    return lag


def _is_sparse(log: RobotLog) -> bool:
    """Whether turns are so far apart that their yaw rates are not those of the ways between them."""
    middles = [turn.middle for turn in log.turns]
    return len(middles) > 1 and float(np.median(np.diff(middles))) > _SPARSE


def remaining_lag(track: Track) -> float | None:
    """Seconds to add to the lag of a track; None: the robot turned too evenly to tell."""
    if len(track.times) < 3:
        return None
    times, odometry = track.log.odometry_times, track.log.odometry
    rates = _heading(times, odometry, track.times + _WINDOW) - _heading(times, odometry, track.times - _WINDOW)
    rates /= 2 * _WINDOW
    apart = poses.wrap(track.poses[:, 2] - _heading(times, odometry, track.times))
    x, y = np.diff(rates), poses.wrap(np.diff(apart))
    known = (track.shares[1:] > 0) & (track.shares[:-1] > 0) & (np.diff(track.segments) == 0)
    known &= np.abs(x) > _MIN_CHANGE
    if known.sum() < _MIN_EVIDENCE:
        return None
    x, y = x[known], y[known]
    slope = _slope(x, y)
    for _ in range(3):  # without outliers, such as wheels that slip
        left = np.abs(y - slope * x)
        kept = left <= _OUTLIER * 1.4826 * max(float(np.median(left)), 1e-6)
        slope = _slope(x[kept], y[kept])
    return slope


def _heading(times: Floats, odometry: Floats, at: Floats) -> Floats:
    return np.interp(at, times, odometry[:, 2])


def _slope(x: Floats, y: Floats) -> float:
    return float(x @ y / (x @ x))
