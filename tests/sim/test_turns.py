"""Turns of the lidar and samples of odometry, against walls by hand, and how the odometry drifts."""

import dataclasses
import math

import numpy as np
import pytest

from mercator_design.errors import SimulationError
from mercator_design.fsm import parse
from mercator_design.mapping.readers.simulation import logs_of
from mercator_design.sim.devices import Recording
from mercator_design.sim.kernels.swarm import new_history
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import Imu, Locator, Uniform
from mercator_design.sim.turns import odometry_of, turns_of
from tests.sim.worlds import STOP, at, mission, simulator

pytestmark = pytest.mark.together("kernels")  # compiled once

MERCATOR = load_robot_model("mercator")
EXACT = dataclasses.replace(MERCATOR, lidar=dataclasses.replace(MERCATOR.lidar, noise=None))
TALL = ("arena.wall_height=0.3",)
EXPLORE = parse("--nstates 1 --s0 0 --rwm0 20")
PERIOD = 0.1
TURNING = 4.0  # [rad/s]


def moved(poses, robot_model=EXACT, **world):
    """A recording of robots that were at poses (cycles + 1, robots, 3)."""
    history = new_history(len(poses) - 1, poses.shape[1], everything=False)
    history.poses[:] = poses
    scene = simulator(robot_model=robot_model, **world).instance(0).scene
    keys = np.arange(1, 1 + poses.shape[1], dtype=np.uint64)
    return Recording(robot_model, scene, history, keys, PERIOD)


def spinning(rate, cycles=20, x=0.3, y=-0.2):
    """Poses of a robot that turns on the spot [rad/s]."""
    times = PERIOD * np.arange(cycles + 1)
    return np.column_stack([np.full(cycles + 1, x), np.full(cycles + 1, y), rate * times])[:, np.newaxis]


def square(side=2.0):
    return {"sides": 4, "apothem": 0.5 * side, "overrides": TALL}


@pytest.mark.parametrize("rate", [TURNING, -TURNING])
def test_a_beam_leaves_at_its_own_time_from_where_its_robot_then_is(rate):
    turns = turns_of(moved(spinning(rate), **square()))
    for start, ranges in zip(turns.starts[:, 0], turns.ranges[:, 0], strict=True):
        heading = rate * (start + turns.times) + turns.angles
        ends = np.array([0.3, -0.2]) + ranges[:, np.newaxis] * np.column_stack([np.cos(heading), np.sin(heading)])
        assert np.abs(ends).max(axis=1) == pytest.approx(np.ones(len(ends)), abs=1e-9)
        as_if_at_rest = rate * (start + 0.5 * turns.times[-1]) + turns.angles
        skewed = [0.3, -0.2] + ranges[:, np.newaxis] * np.column_stack([np.cos(as_if_at_rest), np.sin(as_if_at_rest)])
        assert np.abs(np.abs(skewed).max(axis=1) - 1.0).max() > 0.1


def test_turns_are_clockwise_of_the_models_duration_and_begin_at_a_time_of_each_robot():
    turns = turns_of(moved(np.repeat(spinning(0.0), 3, axis=1), robots=3, **square()))
    assert turns.angles[0] == 0.0
    assert (np.diff(turns.angles) < 0.0).all()
    assert turns.times[-1] < MERCATOR.lidar.turn == pytest.approx(719 / 5000)
    assert np.diff(turns.starts, axis=0) == pytest.approx(np.full((len(turns.starts) - 1, 3), MERCATOR.lidar.turn))
    assert len(np.unique(turns.starts[0])) == 3
    assert turns.starts.min() >= 0.0
    assert (turns.starts + turns.times[-1]).max() <= 2.0


def test_at_rest_a_turn_is_a_scan_in_the_other_sense():
    world = mission(
        robots=3,
        duration=1,
        obstacles="[{center: [0.2, 0.5], size: [0.3, 0.2], height: 0.2}]",
        placement=at((-0.5, 0.0, 0.4), (0.5, 0.1, 2.0), (0.0, -0.6, -1.0)),
        overrides=TALL,
    )
    first = dataclasses.replace(EXACT, lidar=dataclasses.replace(EXACT.lidar, first_angle=0.0))
    recording = simulator(robot_model=first).__class__(world, first).run(STOP, 1).recording
    scan, turn = recording.measure("lidar")[-1], turns_of(recording).ranges[-1]
    assert turn[:, 0] == pytest.approx(scan[:, 0], abs=1e-9)
    same = np.abs(turn[:, :0:-1] - scan[:, 1:]) < 1e-9
    assert same.mean() > 0.99  # all but beams at an edge, whose angles differ in the last bit
    assert (turn < 1.0).any()


def test_the_head_of_another_robot_is_a_disc_where_it_then_is():
    still, passing = spinning(0.0, x=0.0, y=0.0), spinning(0.0)
    passing[:, 0, 0], passing[:, 0, 1] = -0.5, 0.3 * PERIOD * np.arange(len(passing))
    turns = turns_of(moved(np.concatenate([still, passing], axis=1), robots=2, sides=4, apothem=3.0))
    for start, ranges in zip(turns.starts[:, 0], turns.ranges[:, 0], strict=True):
        seen = ranges > 0.0
        assert 8 <= seen.sum() <= 17  # the walls are too low
        times, angles = (start + turns.times)[seen], turns.angles[seen]
        x, y = ranges[seen] * np.cos(angles), ranges[seen] * np.sin(angles)
        assert np.hypot(x + 0.5, y - 0.3 * times) == pytest.approx(np.full(seen.sum(), 0.035), abs=1e-6)


def test_noise_and_losses_are_the_models():
    lidar = dataclasses.replace(EXACT.lidar, noise=Uniform(half_width=0.01), loss=0.02)
    poses = spinning(1.0, cycles=100)
    exact = turns_of(moved(poses, **square())).ranges
    noisy = turns_of(moved(poses, dataclasses.replace(EXACT, lidar=lidar), **square())).ranges
    lost = noisy == 0.0
    n, p = lost.size, 0.02  # binomial: six standard deviations, by luck once in 5e8
    assert lost.sum() == pytest.approx(n * p, abs=6 * math.sqrt(n * p * (1 - p)))
    off = (noisy - exact)[~lost]
    assert 0.0099 < np.abs(off).max() <= 0.01
    assert off.mean() == pytest.approx(0.0, abs=6 * 0.01 / math.sqrt(3 * n))


def drifting(**changes):
    """Mercator with an odometry that drifts."""
    scale = changes.pop("scale_errors", (0.0, 0.0))
    return dataclasses.replace(
        MERCATOR, imu=Imu(range=(-4.0, 4.0), **changes), locator=Locator(range=(-99.0, 99.0), scale_errors=scale)
    )


def test_without_drift_odometry_is_the_true_motion_from_the_start():
    recording = simulator(robots=2, duration=5).run(EXPLORE, 1).recording
    odometry, poses = odometry_of(recording), recording.history.poses
    assert odometry.times == pytest.approx(np.repeat(0.05 * np.arange(101)[:, np.newaxis], 2, axis=1), abs=0.005)
    assert np.abs(np.diff(odometry.times, axis=0) - 0.05).max() > 0.001
    c, s = np.cos(poses[0, :, 2]), np.sin(poses[0, :, 2])
    x, y = np.moveaxis(poses[..., :2] - poses[0, :, :2], -1, 0)
    expected = np.stack([c * x + s * y, c * y - s * x, poses[..., 2] - poses[0, :, 2]], axis=-1)
    assert odometry.poses[::2] == pytest.approx(expected, abs=1e-9)
    assert odometry.poses[1::2] == pytest.approx(0.5 * (expected[1:] + expected[:-1]), abs=1e-9)


def test_ways_are_too_long_or_too_short_by_the_scale_of_each_robot():
    robots = 40
    poses = np.zeros((11, robots, 3))
    poses[..., 0] = 0.03 * np.arange(11)[:, np.newaxis]
    measured = odometry_of(moved(poses, drifting(scale_errors=(0.03, 0.05)))).poses
    off = measured[-1, :, 0] / 0.3 - 1.0
    assert ((np.abs(off) >= 0.03) & (np.abs(off) <= 0.05)).all()
    assert 0 < (off > 0.0).sum() < robots  # by luck once in 5e11
    assert measured[..., 1:] == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("changes", "step", "sd"),
    [
        ({"walk_by_way": 0.02}, (0.02, 0.0), 0.02 * math.sqrt(0.02 * 100)),
        ({"walk_by_turn": 0.01}, (0.0, 0.3), 0.01 * math.sqrt(0.3 * 100)),
        ({"bias": 0.001}, (0.0, 0.0), 0.001 * PERIOD * 100),
    ],
)
def test_the_yaw_drifts_as_the_model_says(changes, step, sd):
    robots = 400
    poses = np.zeros((101, robots, 3))
    poses[..., 0], poses[..., 2] = (each * np.arange(101)[:, np.newaxis] for each in step)
    found = odometry_of(moved(poses, drifting(**changes))).poses[-1, :, 2] - poses[-1, 0, 2]
    assert found.mean() == pytest.approx(0.0, abs=6 * sd / math.sqrt(robots))
    assert found.std() == pytest.approx(sd, rel=6 / math.sqrt(2 * robots))  # six standard errors: once in 5e8


def test_the_place_goes_astray_with_the_yaw():
    """A way of many steps, added up along the measured yaw."""
    model = drifting(walk_by_way=0.2)
    recording = simulator(robots=1, duration=20, robot_model=model).run(EXPLORE, 1, record=True).recording
    poses, imu, locator = (
        recording.history.poses[:, 0],
        recording.measure("imu")[:, 0, 2],
        recording.measure("locator")[:, 0],
    )
    off = np.concatenate([[0.0], np.unwrap(imu - poses[1:, 2])])
    off -= 2 * math.pi * np.round(off[0] / (2 * math.pi))
    assert np.abs(off).max() > 0.05
    steps, middle = np.diff(poses[:, :2], axis=0), 0.5 * (off[1:] + off[:-1])
    c, s = np.cos(middle), np.sin(middle)
    turned = np.column_stack([c * steps[:, 0] - s * steps[:, 1], s * steps[:, 0] + c * steps[:, 1]])
    assert locator == pytest.approx(np.cumsum(turned, axis=0), abs=1e-9)


def test_a_log_has_turns_odometry_and_the_truth():
    model = load_robot_model("mercator-drifting")
    recording = simulator(robots=2, duration=5, robot_model=model, overrides=TALL).run(EXPLORE, 1).recording
    turns, odometry = turns_of(recording), odometry_of(recording)
    for i, log in enumerate(logs_of(recording)):
        assert len(log.turns) == len(turns.starts)
        assert log.turns[3].times[0] == turns.starts[3, i]
        assert np.array_equal(log.turns[3].ranges, turns.ranges[3, i])
        assert np.array_equal(log.odometry, odometry.poses[:, i])
        assert np.array_equal(log.truth, recording.history.poses[:, i])
        assert log.start is None


@pytest.mark.parametrize("part", ["lidar", "imu", "locator"])
def test_robots_without_the_device(part):
    model = dataclasses.replace(MERCATOR, neighbours=None, **{part: None})
    recording = simulator(robot_model=model).run(STOP, 1).recording
    with pytest.raises(SimulationError, match=f"robot mercator has no {part}"):
        logs_of(recording)
