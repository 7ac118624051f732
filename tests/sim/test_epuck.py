"""The e-puck: a disc with near-sighted sensors that vote on the floor."""

import dataclasses
import math

import numpy as np
import pytest

from mercator_design.errors import MissionError
from mercator_design.fsm import parse
from mercator_design.sim.robot_model import load_robot_model
from tests.sim.test_lidar import distances_along, sides_of
from tests.sim.worlds import STOP, at, look, simulator

EPUCK = load_robot_model("epuck")
RADIUS, RING = 0.035, 0.036
ANGLES = np.array(EPUCK.proximity.angles)
REPORTED = np.array([np.cos(EPUCK.proximity.reported), np.sin(EPUCK.proximity.reported)]).T
QUIET = dataclasses.replace(
    EPUCK,
    drive=dataclasses.replace(EPUCK.drive, noise=None),
    proximity=dataclasses.replace(EPUCK.proximity, weight_noise=None),
    ground=dataclasses.replace(EPUCK.ground, noise=None),
    light=dataclasses.replace(EPUCK.light, noise=None),
)
BLIND = dataclasses.replace(QUIET, reference_model=QUIET.reference_model._replace(obstacle_threshold=2.0))
EXPLORE = parse("--nstates 1 --s0 0 --rwm0 20")


def weights(distances):
    """argos3-epuck: 298.701 d^2 - 36.8961 d + 1.08212 up to 5 cm, from 0 to 1."""
    near = np.minimum(distances, 1.0)
    law = 298.701 * near**2 - 36.8961 * near + 1.08212
    return np.where(distances <= 0.05, law, 0.0).clip(0, 1)


def read(placement, robot_model=QUIET, **world):
    return look(robot_model, placement=placement, **{"apothem": 1.0, **world}).history.readings[0]


def cut(vector):
    return vector / max(1.0, np.linalg.norm(vector))


class TestProximity:
    @pytest.mark.parametrize("gap", [0.0001, 0.002, 0.0023, 0.01, 0.02, 0.03, 0.044, 0.046, 0.05, 0.06])
    @pytest.mark.parametrize("heading", [0.0, 0.4, -2.0])
    def test_the_law(self, gap, heading):
        """Before one wall, at a gap from the robot's rim, which counts for other directions than the rays'."""
        towards = np.cos(ANGLES + heading)
        with np.errstate(divide="ignore"):
            distances = np.where(towards > 1e-9, (RADIUS + gap) / towards - RING, np.inf).clip(0)
        weighed = weights(distances)
        expected = cut(weighed @ REPORTED)
        found = read(at((1.0 - RADIUS - gap, 0, heading)), sides=4)[0, :2]
        assert found == pytest.approx(expected, abs=1e-4)  # at 2.268 mm the law reaches 1

    def test_robots_are_discs(self):
        """Rays at the rims of two other robots and a box, as cast at everything."""
        random = np.random.default_rng(7)
        seen = 0
        for _ in range(60):
            angles = random.uniform(-3, 3) + np.array([0.0, 2.0, 3.8])
            away = random.uniform(0.0705, 0.12, 3)
            others = np.column_stack([away * np.cos(angles), away * np.sin(angles)])
            others[2] *= 1.3  # the box
            turn = random.uniform(-3, 3)
            box = f"[{{center: {others[2].tolist()}, size: [0.05, 0.06], angle: {turn}}}]"
            corners = np.array([[0.025, 0.03], [-0.025, 0.03], [-0.025, -0.03], [0.025, -0.03]])
            c, s = math.cos(turn), math.sin(turn)
            corners = corners @ np.array([[c, s], [-s, c]]) + others[2]
            heading = random.uniform(-3, 3)
            placement = at((0, 0, heading), *((*each, 1.0) for each in others[:2].tolist()))
            if np.linalg.norm(corners, axis=1).min() < 0.06 or np.linalg.norm(others[0] - others[1]) < 0.0701:
                continue
            distances = np.array(
                [
                    distances_along(
                        np.array([angle + heading]),
                        RING * np.array([math.cos(angle + heading), math.sin(angle + heading)]),
                        sides_of(corners),
                        np.column_stack([others[:2], [RADIUS, RADIUS]]),
                    )[0]
                    for angle in ANGLES
                ]
            )
            expected = cut(weights(distances) @ REPORTED)
            found = read(placement, robots=3, obstacles=box)[0, :2]
            assert found == pytest.approx(expected, abs=1e-4)
            seen += 1
        assert seen > 20

    def test_sensors_of_robots_that_touch(self):
        """The ring lies 1 mm before the rim, so within the other robot: it is touched."""
        found = read(at((0, 0, ANGLES[0]), (-0.0701, 0, 0)), robots=2)
        assert np.hypot(*found[0, :2]) > 0.6

    def test_noise_is_on_readings_even_of_nothing(self):
        """Uniform within 0.05, cut at 0: of eight sensors that see nothing, 5000 times.

        Each reads 0 half of the time, else up to 0.05: mean 0.0125, and the vector's mean is the sum of the directions
        of the sensors, times that. Six standard errors; chance below 1e-8.
        """
        vectors = (
            simulator(robots=1, duration=500, robot_model=EPUCK, placement=at((0, 0, 0)))
            .run(STOP, 1, record=True)
            .history.readings[:, 0, :2]
        )
        variance = 0.05**2 / 6 - 0.0125**2
        for found, directions in zip(vectors.T, REPORTED.T, strict=True):
            sd = math.sqrt(variance * (directions**2).sum())
            assert found.mean() == pytest.approx(0.0125 * directions.sum(), abs=6 * sd / math.sqrt(5000))
            assert found.std() == pytest.approx(sd, rel=6 / math.sqrt(5000))


def floor(colour, x=None):
    """All of one colour; or white to the left of a line 30 mm ahead, `x` metres aside, and that colour to its right."""
    if x is None:
        return f"{{background: {colour}}}"
    return f"{{background: white, zones: [{{shape: half_plane, point: [0, {x}], normal: [0, -1], color: {colour}}}]}}"


class TestGround:
    def levels(self, robot_model=QUIET, duration=1.0, **world):
        ready = simulator(duration=duration, robot_model=robot_model, placement=at((0, 0, 0)), **world)
        readings = ready.run(STOP, 1, record=True).history.readings[:, 0, 5:8]
        assert (readings == readings[:, :1]).all()
        return readings[:, 0]

    @pytest.mark.parametrize(("colour", "level"), [("black", 0.0), ("gray", 127.5), ("white", 255.0)])
    def test_more_than_ten_of_the_latest_fifteen_readings_decide(self, colour, level):
        """Three a cycle: nothing is known before the fourth."""
        assert self.levels(floor=floor(colour)).tolist() == [127.5] * 3 + [level] * 7

    @pytest.mark.parametrize(("aside", "level"), [(-0.005, 127.5), (0.005, 127.5), (0.01, 0.0), (-0.01, 255.0)])
    def test_two_of_three_sensors_are_not_enough(self, aside, level):
        """Sensors at 9, 0 and -9 mm to the left; 10 of 15 readings are black, or white."""
        assert self.levels(floor=floor("black", aside))[-1] == level

    def test_the_vote_follows_the_floor_four_cycles_late(self):
        """A robot that drives at 12 mm a cycle over an edge to black."""
        edge = "{background: white, zones: [{shape: half_plane, point: [0.15, 0], normal: [1, 0], color: black}]}"
        outcome = simulator(duration=3.0, robot_model=QUIET, placement=at((0, 0, 0)), floor=edge).run(
            EXPLORE, 1, record=True
        )
        over = np.flatnonzero(outcome.trace.poses[1:, 0, 0] + 0.03 > 0.15)[0]
        levels = outcome.history.readings[:, 0, 5]
        assert levels[3 : over + 1].tolist() == [255.0] * (over - 2)
        assert levels[over + 1 : over + 3].tolist() == [127.5] * 2
        assert (levels[over + 3 :] == 0.0).all()

    def test_noise_on_black(self):
        """A reading is below 0.03 with chance (0.05 + 0.03) / 0.1 = 0.8; black is what more than 10 of 15 say.

        That is a chance of 0.836 (binomial). One of five cycles is independent: 4000 of them, six standard errors.
        """
        levels = self.levels(EPUCK, duration=2000, floor=floor("black"))[4::5]
        chance = sum(math.comb(15, k) * 0.8**k * 0.2 ** (15 - k) for k in range(11, 16))
        assert chance == pytest.approx(0.836, abs=1e-3)
        assert set(levels) == {0.0, 127.5}
        assert (levels == 0.0).mean() == pytest.approx(chance, abs=6 * math.sqrt(chance * (1 - chance) / 4000))

    def test_noise_is_not_enough_to_mistake_gray_and_white(self):
        assert (self.levels(EPUCK, duration=50, floor=floor("gray")) == 127.5).all()
        assert (self.levels(EPUCK, duration=50, floor=floor("white"))[3:] == 255.0).all()

    def test_colours_are_their_brightness(self):
        """Without a vote, the mean of the sensors: of green, 0.587 * 255."""
        model = dataclasses.replace(QUIET, reference_model=QUIET.reference_model._replace(ground_vote_cycles=0.0))
        green = 0.587 * 255
        assert self.levels(model, floor=floor("green")) == pytest.approx(np.full(10, green))
        assert self.levels(model, floor=floor("green", 0.005))[0] == pytest.approx((2 * green + 255) / 3)
        colours = dataclasses.replace(model, ground=dataclasses.replace(model.ground, gray=False))
        assert read(at((0, 0, 0)), colours, floor=floor("green"))[0, 5:8].tolist() == [0, 255, 0]

    def test_votes_of_part_of_a_cycle_are_those_of_a_whole_one(self):
        """A model that is drawn at random may ask for this."""
        model = dataclasses.replace(QUIET, reference_model=QUIET.reference_model._replace(ground_vote_cycles=0.5))
        assert (self.levels(model, floor=floor("black")) == 127.5).all()
        model = dataclasses.replace(model, reference_model=model.reference_model._replace(ground_majority=2.0))
        assert (self.levels(model, floor=floor("black")) == 0.0).all()


def test_its_speed():
    """12 cm/s, and as fast on the spot: 0.24 / 0.053 rad/s."""
    poses = simulator(duration=5, robot_model=QUIET, placement=at((-0.5, 0, 0))).run(EXPLORE, 1).trace.poses[:, 0]
    assert np.diff(poses[5:, 0]) == pytest.approx(0.012)
    outcome = simulator(duration=20, apothem=0.3, robot_model=QUIET, placement=at((0, 0, 0))).run(EXPLORE, 1)
    turns = np.diff(outcome.trace.poses[:, 0, 2]) / 0.1
    assert np.abs(turns).max() == pytest.approx(0.24 / 0.053, rel=1e-3)


def test_a_disc_pushes_against_a_wall_and_stays_within():
    """Contacts act once bodies overlap: by what is covered in a sub-step, 1.2 mm."""
    poses = simulator(duration=8, sides=4, apothem=0.5, robot_model=BLIND, placement=at((0, 0, 0.3))).run(EXPLORE, 1)
    beyond = poses.trace.poses[:, 0, 0] + RADIUS - 0.5
    assert -0.001 < beyond[-10:].max() < 0.0013
    assert beyond.max() < 0.0013


def test_discs_push_each_other_and_stay_apart():
    """Two drive at each other's edges: they touch 7 cm apart, wherever, and slip past."""
    world = simulator(
        robots=2, duration=15, apothem=1.0, robot_model=BLIND, placement=at((-0.4, 0, 0), (0.4, 0.03, math.pi))
    )
    poses = world.run(EXPLORE, 1).trace.poses[..., :2]
    away = np.linalg.norm(poses[:, 0] - poses[:, 1], axis=1)
    assert 2 * RADIUS - 0.0025 < away.min() < 2 * RADIUS + 0.001
    assert np.abs(poses[:, 0, 1]).max() > 0.005  # pushed aside
    crowd = simulator(robots=12, duration=30, apothem=0.3, robot_model=BLIND, placement="{shape: disc, radius: 0.25}")
    poses = crowd.run(EXPLORE, 2).trace.poses[..., :2]
    away = np.linalg.norm(poses[:, :, None] - poses[:, None], axis=-1) + np.eye(12)
    assert 2 * RADIUS - 0.005 < away.min() < 2 * RADIUS
    assert np.linalg.norm(poses, axis=-1).max() < 0.3 / math.cos(math.pi / 12) - RADIUS + 0.005


def test_placement_of_discs():
    """Apart from each other, walls and boxes, and as near as discs allow: 40 of them, where boxes would not fit."""
    box = "[{center: [0, 0], size: [0.2, 0.1], angle: 0.4}]"
    world = simulator(
        robots=40,
        duration=0.1,
        sides=6,
        apothem=0.4,
        robot_model=EPUCK,
        obstacles=box,
        placement="{shape: disc, radius: 0.4}",
    )
    nearest = []
    for seed in range(20):
        poses = world.run(STOP, seed).trace.poses[0]
        x, y = poses[:, 0], poses[:, 1]
        away = np.hypot(x[:, None] - x, y[:, None] - y) + 9 * np.eye(40)
        assert away.min() >= 2 * RADIUS
        normals = np.arange(6) * math.pi / 3
        assert (np.outer(x, np.cos(normals)) + np.outer(y, np.sin(normals))).max() <= 0.4 - RADIUS
        u, v = math.cos(0.4) * x + math.sin(0.4) * y, math.cos(0.4) * y - math.sin(0.4) * x
        assert np.hypot((np.abs(u) - 0.1).clip(0), (np.abs(v) - 0.05).clip(0)).min() >= RADIUS
        nearest.append(away.min())
    assert min(nearest) < 2 * RADIUS * 1.02


def test_discs_that_touch_at_fixed_poses_are_refused():
    def place(x):
        return simulator(robots=2, robot_model=EPUCK, placement=at((0, 0, 0), (x, 0, 0))).run(STOP, 1)

    place(0.0701)
    with pytest.raises(MissionError, match=r"placement.poses\[1\]"):
        place(0.0699)
