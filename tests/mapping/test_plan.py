"""The map that is made of keyframes: cells, pieces of walls and lines against true walls."""

from dataclasses import replace

import numpy as np
import pytest

from mercator_design.mapping import poses
from mercator_design.mapping.front.scans import CLUSTERED, NOTHING, RETURN
from mercator_design.mapping.merit.occupancy import agreement, distances_to
from mercator_design.mapping.merit.trajectories import robot_error
from mercator_design.mapping.plan.occupancy import sharp_keyframes, trace
from mercator_design.mapping.plan.pieces import lines_of
from mercator_design.mapping.plan.plans import messages_of, plans_of
from mercator_design.mapping.swarm import map_swarm
from tests.mapping import analytic

WALLS = analytic.ROOM


@pytest.fixture(scope="module")
def log():
    return analytic.log(seconds=25.0)


@pytest.fixture(scope="module")
def swarm(log):
    """With the robot's true start, so that the map is in the frame of the walls."""
    rows = log.odometry_times > log.turns[0].times[0] - 0.01  # before the first turn, only odometry has the pose
    log = replace(log, odometry_times=log.odometry_times[rows], odometry=log.odometry[rows])
    start = poses.interpolate(log.truth_times, log.truth, log.odometry_times[:1])[0]
    return map_swarm([replace(log, start=start)])


@pytest.fixture(scope="module")
def plan(swarm):
    (plan,) = plans_of(swarm, 0.05)
    return plan


def test_the_way_is_that_of_the_robot(plan, log):
    (way,) = plan.ways
    true = poses.interpolate(log.truth_times, log.truth, way.times)
    assert robot_error(way.poses, true).rmse < 0.003
    assert way.shares.min() > 0.8
    assert np.abs(np.diff(way.poses[:, 2])).max() < 1.0  # unwrapped


@pytest.mark.parametrize("resolution", [0.05, 0.025])
def test_occupied_cells_are_walls(swarm, resolution):
    """Some faces of the boxes are hidden, so a part of the walls has no cells."""
    (plan,) = plans_of(swarm, resolution)
    found = agreement(plan.occupancy.centres, WALLS, resolution)
    assert found.precision > 0.99
    assert found.recall > 0.8
    assert not (plan.occupancy.occupied & plan.occupancy.free).any()


def test_cells_that_the_robot_drove_through_are_free(plan):
    (way,), grid = plan.ways, plan.occupancy
    columns, rows = ((way.poses[:, :2] - grid.corner) / grid.resolution).astype(int).T
    assert grid.free[rows, columns].mean() > 0.99


def test_pieces_lie_on_the_walls(plan):
    (way,) = plan.ways
    true = poses.interpolate(way.log.truth_times, way.log.truth, way.times)
    frame = robot_error(way.poses, true).alignment  # a turn errs by as much, and the start has the frame by one
    away = distances_to(WALLS, poses.transform(frame, plan.pieces[:, :2]))
    assert np.median(away) < 0.004
    assert np.mean(away < 0.01) > 0.97
    assert np.hypot(plan.pieces[:, 2], plan.pieces[:, 3]) == pytest.approx(1.0, abs=1e-6)


def test_lines_lie_on_the_walls_and_have_the_free_side_on_the_left(plan):
    middles = 0.5 * (plan.lines[:, :2] + plan.lines[:, 2:])
    lengths = np.hypot(*(plan.lines[:, 2:] - plan.lines[:, :2]).T)
    assert distances_to(WALLS, middles).max() < 0.01
    assert lengths[lengths > 1.0].sum() > 9.0  # of 11.4 m around the room
    way = plan.ways[0].poses[:, :2].mean(axis=0)
    longest = plan.lines[np.argsort(-lengths)[:4]]
    direction, to_robot = longest[:, 2:] - longest[:, :2], way - longest[:, :2]
    assert (direction[:, 0] * to_robot[:, 1] > direction[:, 1] * to_robot[:, 0]).all()


def test_lines_of_nothing():
    assert lines_of(np.zeros((0, 5))).shape == (0, 4)


def test_beams_are_followed_cell_by_cell():
    """Also beams that are not returned, which say nothing, and clusters, behind which nothing is known."""
    ends = np.array([[0.95, 0.05], [0.05, 0.95], [0.75, 0.75], [0.45, 0.05]])
    kinds = np.array([RETURN, NOTHING, CLUSTERED, RETURN])
    hits, crossings = np.zeros((2, 12, 12), np.int64)
    trace(np.zeros(3), np.full((4, 2), 0.05), ends, kinds, np.zeros(2), 0.1, hits, crossings)
    assert hits[0, 9] == hits[0, 4] == hits.sum() - 1 == 1
    assert crossings[0, :9].tolist() == [3, 2, 2, 2, 1, 1, 1, 1, 1]
    assert crossings[2:, 0].sum() == 0
    assert crossings[7, 7] == 0 < crossings[6, 6]


def test_a_robot_that_always_turns_has_a_map_of_its_slowest_turns(swarm):
    track = replace(swarm.tracks[0], rates=np.linspace(1.0, 3.0, len(swarm.tracks[0].rates)))
    (plan,) = plans_of(replace(swarm, tracks=(track,)))
    assert 0 < sharp_keyframes(plan.ways[0]).mean() < 0.5
    assert plan.occupancy.occupied.any()


def test_messages(log, swarm):
    assert messages_of(swarm.tracks) == []
    gap = replace(log, turns=[one for one in log.turns if not 5 < one.middle < 13])
    blind = replace(log, turns=[one._replace(ranges=0 * one.ranges) for one in log.turns])
    said = messages_of(map_swarm([gap, blind, replace(log, turns=[])]).tracks)
    assert "robot: no turn of its lidar for 8.1 s, from 4.9 s on." in said
    assert any("saw no walls" in one for one in said)
    assert any("has no turns" in one for one in said)
    late = replace(log, turns=[one._replace(times=one.times + 0.03) for one in log.turns])
    (message,) = messages_of(map_swarm([late]).tracks)
    assert message.startswith("robot: the times of its lidar are 0.03")
