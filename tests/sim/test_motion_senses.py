"""Heading, odometry and ranges: sensed through the robot's devices where they are read, and nowhere else."""

import dataclasses
import math

import numpy as np
import pytest

from mercator_design.errors import FsmError
from mercator_design.fsm import parse
from mercator_design.modules.perception import ring_order
from mercator_design.modules.reference import N_RANGES, Actions, Readings, first_reading, n_readings, sense_of
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import Gaussian
from tests.own_modules import entered
from tests.sim.worlds import simulator

pytestmark = pytest.mark.together("kernels")  # compiled once

MERCATOR = load_robot_model("mercator")
NOISY = dataclasses.replace(
    MERCATOR,
    imu=dataclasses.replace(MERCATOR.imu, noise=Gaussian(sd=0.1)),
    locator=dataclasses.replace(MERCATOR.locator, noise=Gaussian(mean=0.02, sd=0.05), range=(-0.3, 0.4)),
    proximity=dataclasses.replace(MERCATOR.proximity, noise=Gaussian(sd=0.01)),
)
FIRST = first_reading("heading")
EXPLORE = parse("--nstates 1 --s0 0 --rwm0 20")


def remembers(model, readings, memory, u):
    """Drive in a curve, and remember what is perceived of the robot's motion and surroundings."""
    memory[0] = readings.heading
    memory[1] = readings.odometry_x
    memory[2] = readings.ranges_0
    return Actions(0.4 + 0.1 * readings.heading, 0.5 + 0.1 * readings.odometry_x, -1.0, 0.0)


DRIFTING = load_robot_model("mercator-drifting")


@pytest.mark.parametrize("robot_model", [MERCATOR, NOISY, DRIFTING], ids=["quiet", "noisy", "drifting"])
def test_readings_are_those_of_the_devices(robot_model):
    outcome = simulator(robots=3, duration=20, robot_model=robot_model).run(EXPLORE, 1, record=True)
    found, measure = outcome.history.readings[..., FIRST : FIRST + 3 + N_RANGES], outcome.recording.measure
    start = outcome.history.poses[0]
    off = found[..., 0] - measure("imu")[..., 2] + start[:, 2]
    assert np.abs(np.arctan2(np.sin(off), np.cos(off))).max() < 1e-9
    assert np.abs(found[..., 0]).max() <= math.pi
    c, s = np.cos(start[:, 2]), np.sin(start[:, 2])
    x, y = np.moveaxis(measure("locator"), -1, 0)
    assert found[..., 1] == pytest.approx(c * x + s * y)
    assert found[..., 2] == pytest.approx(c * y - s * x)
    weights = measure("proximity_weights")
    assert np.array_equal(found[..., 3:], weights[..., [1, 0, 7, 6, 5, 4, 3, 2]])
    assert weights.any()


def test_single_sensors_of_an_e_puck():
    """Light sensors counter-clockwise from the front, ground sensors from left to right."""
    light = "lights=[{position: [0, -1, 0.5], intensity: 5}]"
    world = simulator(robots=3, duration=5, robot_model=load_robot_model("epuck"), overrides=[light])
    outcome = world.run(parse("--nstates 1 --s0 0 --rwm0 20"), 1, record=True)
    found, measure = outcome.history.readings, outcome.recording.measure
    lights, grounds = (
        slice(first_reading(name), first_reading(name) + n_readings(name)) for name in ("lights", "grounds")
    )
    assert np.array_equal(found[..., lights], measure("light_sensors")[..., [7, 0, 1, 2, 3, 4, 5, 6]])
    assert found[..., grounds] == pytest.approx(measure("ground_sensors")[..., [2, 1, 0], 0])
    assert found[..., lights].any()


@pytest.mark.parametrize("referee", [False, True])
def test_they_are_sensed_where_they_are_read(referee):
    world = simulator(robots=2, duration=5)
    with entered(remembers, reads={"heading", "odometry", "ranges"}, memory=3) as flavour:
        used = world.run(parse("--nstates 1 --s0 0", flavour.name), 1, referee=referee).history
        recorded = world.run(parse("--nstates 1 --s0 0", flavour.name), 1, record=True).history
    assert np.array_equal(used.poses, recorded.poses)
    turning = np.abs(recorded.wheels[..., 0] - recorded.wheels[..., 1] + 0.1)
    assert turning.max() > 0.01
    with entered(remembers, memory=3) as flavour:
        blind = world.run(parse("--nstates 1 --s0 0", flavour.name), 1).history
        steps = np.linalg.norm(np.diff(blind.poses[:, 0, :2], axis=0), axis=1)
    assert steps[4:10] == pytest.approx(0.45 * 0.3 * 0.1, rel=0.01)  # as if nothing were perceived


def test_ranges_by_themselves_leave_proximity_neutral():
    def only(model, readings, memory, u):
        """Drive by what is near, as far as proximity says nothing."""
        return Actions(readings.ranges_0, readings.proximity_x, -1.0, 0.0)

    world = simulator(robots=4, duration=5, apothem=0.5, placement="{shape: disc, radius: 0.3}")
    with entered(only, reads={"ranges"}) as flavour:
        used = world.run(parse("--nstates 1 --s0 0", flavour.name), 3).history
        turns = np.diff(used.poses[..., 2], axis=0)
    assert (turns <= 1e-12).all()  # the right tread rests
    assert turns.min() < -0.01


@pytest.mark.parametrize(
    ("sense", "lacking"),
    [
        ("heading", {"imu": None}),
        ("odometry", {"locator": None}),
        ("ranges", {"proximity": None}),
        ("ranges", {"proximity": dataclasses.replace(MERCATOR.proximity, angles=(0.0, 1.0))}),
    ],
)
def test_robots_without_the_device_are_refused(sense, lacking):
    model = dataclasses.replace(MERCATOR, **lacking)
    assert MERCATOR.senses - model.senses >= {sense}
    world = simulator(robot_model=model)
    with entered(remembers, reads={sense}, memory=3) as flavour:
        software = parse("--nstates 1 --s0 0", flavour.name)
        with pytest.raises(FsmError, match=f"needs {sense}, which robot mercator does not perceive"):
            world.run(software, 1)
    readings = world.run(parse("--nstates 1 --s0 1"), 1, record=True).history.readings
    places = [k for k, name in enumerate(Readings._fields) if sense_of(name) == sense]
    assert (readings[..., places] == 0.0).all()


def test_the_order_of_ranges_is_by_angle():
    assert ring_order(MERCATOR.proximity.angles) == [1, 0, 7, 6, 5, 4, 3, 2]
    slightly_off = [angle - 0.02 for angle in MERCATOR.proximity.angles]
    assert ring_order(slightly_off) == [1, 0, 7, 6, 5, 4, 3, 2]
    assert len(ring_order(MERCATOR.proximity.angles)) == N_RANGES
