"""Logs of a robot among straight walls, cast beam by beam from known poses; no engine."""

import numpy as np

from mercator_design.mapping import poses
from mercator_design.mapping.logs import RobotLog, Turn

BEAMS, PERIOD = 719, 1 / 7


def box(left, bottom, right, top):
    """The walls of a rectangle: rows of x, y of the start and of the end."""
    corners = np.array([[left, bottom], [right, bottom], [right, top], [left, top]], float)
    return np.hstack([corners, np.roll(corners, -1, axis=0)])


ROOM = np.vstack([box(-1.5, -1.2, 1.7, 1.3), box(1.0, 0.7, 1.3, 1.0), box(-1.2, -0.95, -0.8, -0.75)])


def cast(walls, origins, directions):
    """Distances (n,) [m] from points (n, 2) along directions (n,) [rad] to the nearest wall; inf: there is none."""
    ux, uy = np.cos(directions)[:, np.newaxis], np.sin(directions)[:, np.newaxis]
    sx, sy = walls[:, 0] - origins[:, :1], walls[:, 1] - origins[:, 1:]
    wx, wy = walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = ux * wy - uy * wx
        far, along = (sx * wy - sy * wx) / cross, (sx * uy - sy * ux) / cross
    return np.where((far > 0) & (along >= 0) & (along <= 1), far, np.inf).min(axis=1)


def turn(walls, pose_at, start, rng=None, noise=0.0, lost=0.0, lidar=(0.0, 0.0, 0.0), beams=BEAMS, period=PERIOD):
    """A turn that starts at a time, clockwise; `pose_at` gives poses (n, 3) at times (n,)."""
    times = start + period * np.arange(beams) / beams
    angles = np.pi - 2 * np.pi * np.arange(beams) / beams
    at = poses.compose(pose_at(times), np.asarray(lidar, float))
    ranges = cast(walls, at[:, :2], at[:, 2] + angles)
    ranges = np.where(ranges < 12.0, ranges, 0.0)
    if rng is not None:
        ranges = np.where(ranges > 0, ranges + rng.uniform(-noise, noise, beams), 0.0)
        ranges[rng.random(beams) < lost] = 0.0
    return Turn(times, angles, ranges)


def wander(times):
    """A smooth way around a room's middle with fast turns: poses (n, 3) at times (n,)."""
    times = np.asarray(times, float)
    theta = 0.5 * times + 2.2 * np.sin(0.9 * times) + 0.8 * np.sin(2.3 * times)
    return np.column_stack([0.6 * np.sin(0.31 * times), 0.5 * np.sin(0.23 * times + 0.4), theta])


def drifting(pose_at, times, rng, scale=1.04, yaw_walk=0.0175, turn_walk=0.0052, step=0.001):
    """Odometry (n, 3) at times (n,): the scale is off, the yaw walks, places are rounded.

    `yaw_walk` [rad/sqrt(m)] is for the path, `turn_walk` [rad/sqrt(rad)] for turning.
    """
    true = pose_at(times)
    moved = poses.between(true[:-1], true[1:])
    length = np.hypot(moved[:, 0], moved[:, 1])
    sd = np.sqrt(yaw_walk**2 * length + turn_walk**2 * np.abs(moved[:, 2]))
    moved = moved * (scale, scale, 1.0) + np.column_stack(
        [*np.zeros((2, len(moved))), sd * rng.standard_normal(len(moved))]
    )
    found = [np.zeros(3)]
    for one in moved:
        found.append(poses.compose(found[-1], one))
    found = np.array(found)
    found[:, :2] = np.round(found[:, :2] / step) * step
    return found


def log(walls=ROOM, pose_at=wander, seconds=20.0, seed=1, noise=0.01, lost=0.02, late=0.0, **drift):
    """A log with its truth; `late` [s]: by how much the lidar's times are late."""
    rng = np.random.default_rng(seed)
    odometry_times = np.arange(-0.2, seconds + 0.4, 0.05)
    turns = [turn(walls, pose_at, start, rng, noise, lost) for start in np.arange(0.0, seconds, PERIOD)]
    turns = [one._replace(times=one.times + late) for one in turns]
    odometry = drifting(pose_at, odometry_times, rng, **drift)
    truth_times = np.arange(-0.2, seconds + 0.4, 0.01)
    truth = pose_at(truth_times)
    return RobotLog("robot", turns, odometry_times, odometry, truth_times=truth_times, truth=truth, walls=walls)
