"""What a robot at a known place perceives, against hand-made geometry."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.fsm import Readings, parse
from mercator_design.sim.kernels.sight import distance_to_box, distance_to_wall
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import Gaussian, Ground, Neighbours, Uniform
from tests.sim.worlds import at, simulator

STOP = parse("--nstates 1 --s0 1")
MERCATOR = load_robot_model("mercator")
QUIET = dataclasses.replace(MERCATOR, ground=Ground(positions=((0.05, 0.0),)), neighbours=Neighbours())
AS_MEASURED = dataclasses.replace(MERCATOR.ground, labels=None)
HALF = 0.143


def perceived(robot=0, **world):
    """The readings of a standing robot, after one cycle."""
    outcome = simulator(duration=0.1, robot_model=QUIET, **world).run(STOP, 1, record=True)
    return Readings(*outcome.history.readings[0, robot].tolist())


def weight(distance):
    return (1 / distance - 2.5) / 17.5


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, math.pi, -math.pi / 2])
def test_a_wall_straight_ahead(heading):
    """Square room; the robot looks at each of its walls from 0.3 m."""
    gap = 0.3
    x = 2.0 - HALF - gap
    r = perceived(sides=4, apothem=2.0, placement=at((x * math.cos(heading), x * math.sin(heading), heading)))
    diagonal = (2.0 - x) * math.sqrt(2) - HALF
    expected = weight(gap) + (2 * weight(diagonal) / math.sqrt(2) if diagonal < 0.4 else 0)
    assert r.proximity_x == pytest.approx(expected)
    assert r.proximity_y == pytest.approx(0.0, abs=1e-9)


def test_a_wall_at_the_left_and_behind():
    r = perceived(sides=4, apothem=2.0, placement=at((0, 2.0 - HALF - 0.1, 0)))
    assert r.proximity_y > 0.3
    assert r.proximity_x == pytest.approx(0.0, abs=1e-12)
    r = perceived(sides=4, apothem=2.0, placement=at((0, 2.0 - HALF - 0.1, -math.pi / 2)))
    assert r.proximity_x < -0.3
    assert r.proximity_y == pytest.approx(0.0, abs=1e-9)


def test_nothing_near():
    r = perceived(apothem=3.0, placement=at((0, 0, 0.3)))
    assert (r.proximity_x, r.proximity_y, r.neighbours, r.neighbours_x) == (0, 0, 0, 0)


def test_a_box_and_a_robot_look_the_same():
    box = "[{center: [0.45, 0], size: [0.286, 0.286], angle: 0.3}]"
    seen_box = perceived(apothem=3.0, obstacles=box, placement=at((0, 0, 0)))
    seen_robot = perceived(apothem=3.0, robots=2, placement=at((0, 0, 0), (0.45, 0, 0.3)))
    assert seen_box.proximity_x == pytest.approx(seen_robot.proximity_x)
    assert seen_box.proximity_y == pytest.approx(seen_robot.proximity_y)
    assert seen_box.proximity_x > 0.05
    assert (seen_box.neighbours, seen_robot.neighbours) == (0, 1)


def test_the_proximity_vector_is_never_longer_than_one():
    r = perceived(apothem=3.0, robots=2, placement=at((0, 0, 0), (0.29, 0, 0)))
    assert math.hypot(r.proximity_x, r.proximity_y) == pytest.approx(1.0)


@pytest.mark.parametrize(("distance", "n"), [(0.749, 1), (0.751, 0)])
def test_neighbours_are_robots_within_range(distance, n):
    bearing, heading = 2.0, 0.7
    other = (distance * math.cos(bearing), distance * math.sin(bearing), 0)
    r = perceived(apothem=3.0, robots=2, placement=at((0, 0, heading), other))
    assert r.neighbours == n
    if n:
        assert r.neighbours_x == pytest.approx(math.cos(bearing - heading) / (1 + distance))
        assert r.neighbours_y == pytest.approx(math.sin(bearing - heading) / (1 + distance))


def test_neighbour_vectors_add_up():
    r = perceived(apothem=3.0, robots=3, placement=at((0, 0, 0), (0.5, 0, 0), (0, 0.6, 1)))
    assert r.neighbours == 2
    assert (r.neighbours_x, r.neighbours_y) == (pytest.approx(1 / 1.5), pytest.approx(1 / 1.6))


def test_the_ground_sensor_looks_ahead():
    floor = "{background: white, zones: [{shape: half_plane, point: [0.04, 0], normal: [1, 0], color: red}]}"
    assert perceived(floor=floor, placement=at((0, 0, 0)))[5:8] == (255, 0, 0)
    assert perceived(floor=floor, placement=at((0, 0, 1.5)))[5:8] == (255, 255, 255)


WALL = (np.array([[1.0, -1.0, 0.0, 2.0, -1.0, 0.0]]), 0)


@given(st.floats(-1.4, 1.4), st.floats(-0.9, 0.9), st.floats(-3, 0.9))
def test_rays_meet_a_wall_where_geometry_says(angle, y, x):
    hit = y + (1 - x) * math.tan(angle)
    distance = distance_to_wall(x, y, math.cos(angle), math.sin(angle), *WALL)
    if abs(hit) < 0.999:
        assert distance == pytest.approx((1 - x) / math.cos(angle))
    elif abs(hit) > 1.001:
        assert distance == math.inf


def test_a_ray_that_starts_on_or_just_beyond_the_wall_touches_it():
    assert distance_to_wall(1.003, 0.0, 1.0, 0.0, *WALL) == 0.0
    assert distance_to_wall(1.1, 0.0, 1.0, 0.0, *WALL) == math.inf
    assert distance_to_wall(0.5, 0.0, -1.0, 0.0, *WALL) == math.inf
    assert distance_to_wall(0.99, 0.0, -1.0, 0.0, *WALL) == math.inf
    assert distance_to_wall(0.5, 0.0, 0.0, 1.0, *WALL) == math.inf


@given(st.floats(-3.2, 3.2), st.floats(-2, 2), st.floats(-2, 2))
def test_rays_meet_a_box_where_its_four_sides_say(angle, x, y):
    c, s = math.cos(angle), math.sin(angle)
    a, b = 0.5, 0.3
    sides = np.array(
        # Clockwise: their left is outside.
        [[a, b, 0, -2 * b, 0, 0], [-a, b, 2 * a, 0, 0, 0], [-a, -b, 0, 2 * b, 0, 0], [a, -b, -2 * a, 0, 0, 0]]
    )
    found = distance_to_box(x, y, c, s, a, b)
    if abs(x) < a - 0.03 and abs(y) < b - 0.03:
        assert found == 0.0
    elif max(abs(x) - a, abs(y) - b) > 0.03:
        by_sides = min(distance_to_wall(x, y, c, s, sides, k) for k in range(4))
        # A ray that grazes a corner may count either way.
        if min(abs(abs((px - x) * s - (py - y) * c)) for px in (a, -a) for py in (b, -b)) > 1e-9:
            assert found == pytest.approx(by_sides)


class TestNoise:
    """Noise has the distribution that the robot model asks for.

    120 000 draws; bounds of six standard errors of mean and standard deviation, each exceeded with chance < 1e-8.
    """

    FLOOR = "{background: gray}"

    def readings(self, **changes):
        model = dataclasses.replace(MERCATOR, **changes)
        world = simulator(
            robots=4,
            duration=1000,
            apothem=3.0,
            floor=self.FLOOR,
            robot_model=model,
            placement=at((0, 0, 0), (0.5, 0, 0), (-1, 0, 0), (-1, 0.5, 0)),
        )
        return world.run(STOP, 3, record=True).history.readings

    def test_ground_as_shipped(self):
        channels = self.readings(ground=AS_MEASURED)[..., 5:8].ravel()
        assert np.array_equal(channels, np.round(channels))
        n = len(channels)
        assert n == 120_000
        assert channels.mean() == pytest.approx(127, abs=6 * 5 / math.sqrt(n))
        sd = math.sqrt(25 + 1 / 12)  # rounding adds its own variance
        assert channels.std() == pytest.approx(sd, abs=6 * sd / math.sqrt(2 * n))

    def test_uniform(self):
        ground = Ground(positions=((0.05, 0.0),), noise=Uniform(half_width=20.0, mean=3.0))
        channels = self.readings(ground=ground)[..., 5:8].ravel()
        assert channels.min() >= 110
        assert channels.max() <= 150
        sd = 40 / math.sqrt(12)
        assert channels.mean() == pytest.approx(130, abs=6 * sd / math.sqrt(len(channels)))
        assert channels.std() == pytest.approx(sd, rel=0.02)

    def test_proximity(self):
        proximity = dataclasses.replace(MERCATOR.proximity, noise=Gaussian(sd=0.02))
        noisy = self.readings(proximity=proximity)
        quiet = self.readings()
        assert quiet[:, 0, 0].std() < 1e-12
        assert noisy[:, 0, 0].std() > 0.003
        assert np.hypot(noisy[..., 0], noisy[..., 1]).max() <= 1 + 1e-12

    def test_noise_may_bring_an_obstacle_into_range(self):
        """A wall at 0.41 m, 0.01 m beyond what counts, is 0.02 m nearer or farther: about a third of the readings."""
        proximity = dataclasses.replace(MERCATOR.proximity, noise=Gaussian(sd=0.02))
        model = dataclasses.replace(MERCATOR, proximity=proximity)
        placement = at((2.0 - HALF - 0.41, 0, 0))
        world = simulator(duration=100, sides=4, apothem=2.0, robot_model=model, placement=placement)
        seen = world.run(STOP, 3, record=True).history.readings[:, 0, 0] > 0.0
        assert 0.2 < seen.mean() < 0.42  # 0.31, with a standard error of 0.015

    def test_what_is_nearer_than_a_sensor_measures_is_too_near(self):
        proximity = dataclasses.replace(MERCATOR.proximity, angles=(0.0,), range=(0.3, 2.0))
        model = dataclasses.replace(MERCATOR, proximity=proximity)
        for gap, reading in ((0.2, 1.0), (0.35, weight(0.35))):
            placement = at((2.0 - HALF - gap, 0, 0))
            world = simulator(duration=0.1, sides=4, apothem=2.0, robot_model=model, placement=placement)
            found = world.run(STOP, 3, record=True).history.readings[0, 0, 0]
            assert found == pytest.approx(reading)

    def test_nothing_hit_stays_nothing(self):
        """Noise is on what was measured: no robot or wall within range, no vector."""
        proximity = dataclasses.replace(MERCATOR.proximity, noise=Gaussian(sd=0.5))
        model = dataclasses.replace(MERCATOR, proximity=proximity)
        world = simulator(duration=20, apothem=3.0, robot_model=model, placement=at((0, 0, 0)))
        assert not world.run(STOP, 3, record=True).history.readings[..., :2].any()

    def test_draws_of_robots_and_channels_are_independent(self):
        """Correlations of 10 000 values: six standard errors, chance < 1e-8 for each of the 66 pairs."""
        ground = self.readings(ground=AS_MEASURED)[..., 5:8].reshape(-1, 12)
        correlation = np.corrcoef(ground.T) - np.eye(12)
        assert np.abs(correlation).max() < 6 / math.sqrt(len(ground))
