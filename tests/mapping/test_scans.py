"""De-skewing, clusters and normals, on walls whose place is known."""

import numpy as np
import pytest

from mercator_design.mapping import poses
from mercator_design.mapping.front import scans
from mercator_design.mapping.logs import RobotLog
from tests.mapping import analytic


def distances_to_walls(walls, points):
    start, end = walls[:, :2], walls[:, 2:]
    along = (points[:, np.newaxis] - start) @ np.eye(2)
    part = np.clip(np.einsum("nwk,wk->nw", along, end - start) / np.sum((end - start) ** 2, axis=1), 0, 1)
    return np.hypot(*np.moveaxis(along - part[..., np.newaxis] * (end - start), 2, 0)).min(axis=1)


def spinning(rate):
    return lambda times: np.column_stack([0.1 + 0.25 * times, 0.2 - 0.1 * times, 0.4 + rate * np.asarray(times)])


def scan_of(pose_at, turn, **log):
    times = np.arange(-0.3, 0.6, 0.05)
    return scans.Preparation(RobotLog("robot", [turn], times, pose_at(times), **log)).scan(0)


def error_of(scan, pose_at, walls=analytic.ROOM):
    return distances_to_walls(walls, poses.transform(pose_at(np.array([scan.time]))[0], scan.points)).max()


@pytest.mark.parametrize("rate", [4.0, -4.0])
@pytest.mark.parametrize("lidar", [(0.0, 0.0, 0.0), (0.05, -0.02, 0.3)])
def test_a_fast_turn_lies_on_the_walls(rate, lidar):
    pose_at = spinning(rate)
    turn = analytic.turn(analytic.ROOM, pose_at, 0.0, lidar=lidar)
    scan = scan_of(pose_at, turn, lidar_pose=np.array(lidar))
    assert len(scan.points) > 150
    # Odometry is linear between its samples, which this motion is.
    assert error_of(scan, pose_at) < 0.001


@pytest.mark.parametrize("rate", [4.0, -4.0])
def test_the_wrong_order_of_beams_does_not(rate):
    pose_at = spinning(rate)
    turn = analytic.turn(analytic.ROOM, pose_at, 0.0)
    wrong = turn._replace(angles=turn.angles[::-1], ranges=turn.ranges[::-1])
    assert error_of(scan_of(pose_at, wrong), pose_at) > 0.1


def test_both_faces_of_a_thin_wall_have_normals_towards_the_lidar():
    wall = analytic.box(-1.0, 0.0, 1.0, 0.06)
    for y, up in ((-1.0, -1.0), (1.06, 1.0)):
        pose_at = lambda times, y=y: np.tile([0.0, y, 0.0], (len(times), 1))  # noqa: E731
        scan = scan_of(pose_at, analytic.turn(wall, pose_at, 0.0))
        assert len(scan.normals) > 40
        assert scan.normals[:, 1] * up == pytest.approx(1.0)


def test_points_are_thinned():
    pose_at = spinning(1.0)
    scan = scan_of(pose_at, analytic.turn(analytic.ROOM, pose_at, 0.0))
    assert np.hypot(*np.diff(scan.points, axis=0).T).min() >= 0.025


def head(x, y, radius=0.035):
    angles = 2 * np.pi * np.arange(32) / 32
    corners = np.array([x, y]) + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    return np.hstack([corners, np.roll(corners, -1, axis=0)])


def test_a_head_is_a_cluster_and_a_wall_is_not():
    pose_at = spinning(2.0)
    turn = analytic.turn(np.vstack([analytic.ROOM, head(1.0, -0.5), head(-0.9, 0.6)]), pose_at, 0.0)
    scan = scan_of(pose_at, turn)
    found = poses.transform(pose_at(np.array([scan.time]))[0], scan.clusters[:, :2])
    assert len(found) == 2
    for place in ((1.0, -0.5), (-0.9, 0.6)):
        assert np.hypot(*(found - place).T).min() < 0.035
    assert error_of(scan, pose_at) < 0.001  # no point of the heads is left


def test_a_lost_beam_does_not_hide_a_head_and_a_dark_ground_is_no_evidence():
    pose_at = spinning(0.0)
    turn = analytic.turn(np.vstack([analytic.ROOM, head(1.0, -0.5)]), pose_at, 0.0)
    middle = int(scan_of(pose_at, turn).clusters[0, 2])
    lost = turn.ranges.copy()
    lost[middle] = 0.0
    assert len(scan_of(pose_at, turn._replace(ranges=lost)).clusters) == 1
    beside = np.where(turn.ranges < turn.ranges[middle] + 0.1, turn.ranges, 0.0)
    assert len(scan_of(pose_at, turn._replace(ranges=beside)).clusters) == 0


def test_a_turn_of_nothing():
    pose_at = spinning(1.0)
    turn = analytic.turn(analytic.ROOM, pose_at, 0.0)
    scan = scan_of(pose_at, turn._replace(ranges=np.zeros(len(turn.ranges))))
    assert len(scan.points) == len(scan.clusters) == 0
