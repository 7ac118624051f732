"""How robots perceive each other: by a camera that may err, or by the lidar."""

import dataclasses
import math

import numpy as np
import pytest

from mercator_design.fsm import parse
from mercator_design.modules.clustering import lidar_neighbours
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import Gaussian, LidarNeighbours, Neighbours, Uniform
from tests.sim.worlds import STOP, at, look, simulator

pytestmark = pytest.mark.together("kernels")  # compiled once

MERCATOR = load_robot_model("mercator")
NEAR = at((0, 0, 0), (0.5, 0, 0), (0, 0.6, 0), (-0.55, 0, 2))
ATTRACT = parse("--nstates 1 --s0 2 --att0 5")


def seeing(*, model=MERCATOR, constants=None, **settings):
    reference = model.reference_model._replace(**(constants or {}))
    return dataclasses.replace(model, neighbours=Neighbours(**settings), reference_model=reference)


def counts(model, robots=4, duration=0.1, seed=1, **world):
    """How many neighbours each robot has (cycles, robots), all standing."""
    world = {"apothem": 3.0, "placement": NEAR, **world}
    ready = simulator(robots=robots, duration=duration, robot_model=model, **world)
    return ready.run(STOP, seed, record=True).history.readings[..., 2]


class TestCamera:
    @pytest.mark.parametrize(("range_", "seen"), [(0.49, 0), (0.51, 1), (0.58, 2), (0.61, 3), (13.57, 3)])
    def test_its_range(self, range_, seen):
        assert counts(seeing(range=range_))[0, 0] == seen

    def test_the_reference_models_range_decides_too(self):
        assert counts(seeing(constants={"neighbour_range": 0.57}))[0, 0] == 2

    @pytest.mark.parametrize("occlusion", [False, True])
    def test_robots_hide_robots(self, occlusion):
        placement = at((0, 0, 0), (0.35, 0.02, 0.5), (0.7, 0, 0))
        found = counts(seeing(occlusion=occlusion), robots=3, placement=placement)[0]
        assert found.tolist() == ([1, 2, 1] if occlusion else [2, 2, 2])
        aside = at((0, 0, 0), (0.35, 0.3, 0.0), (0.7, 0, 0))
        assert counts(seeing(occlusion=occlusion), robots=3, placement=aside)[0].tolist() == [2, 2, 2]

    @pytest.mark.parametrize("occlusion", [False, True])
    def test_obstacles_hide_robots_however_low_they_are(self, occlusion):
        box = "[{center: [0.3, 0], size: [0.02, 0.4], height: 0.001}]"
        placement = at((0, 0, 0), (0.6, 0, 0))
        found = counts(seeing(occlusion=occlusion), robots=2, placement=placement, obstacles=box)[0]
        assert found.tolist() == ([0, 0] if occlusion else [1, 1])

    @pytest.mark.parametrize(("height", "hides"), [(0.08, False), (0.154, False), (0.155, True), (0.2, True)])
    @pytest.mark.parametrize("name", ["mercator-argos", "mercator-chocolate"])
    def test_a_camera_looks_over_what_is_lower(self, name, height, hides):
        """The original's, at 0.154 m: over a box of 8 cm and the robot behind it (11 cm), not over one of 20 cm."""
        box = f"[{{center: [0.25, 0], size: [0.02, 0.4], height: {height}}}]"
        world = {"robots": 3, "placement": at((0, 0, 0), (0.42, 0, 0), (0.73, 0, 0)), "obstacles": box}
        model = load_robot_model(name)
        assert counts(model, **world)[0].tolist() == ([0, 1, 1] if hides else [2, 2, 2])
        # The ray is not even cast where nothing is that high.
        assert simulator(robot_model=model, **world).instance(1).scene.neighbours.occlusion == hides
        floor = dataclasses.replace(model, neighbours=dataclasses.replace(model.neighbours, height=0.0))
        assert counts(floor, **world)[0].tolist() == [0, 1, 1]

    @pytest.mark.parametrize(("height", "hides"), [(0.08, False), (0.2, True)])
    def test_a_camera_looks_over_outer_walls_and_bodies_that_are_lower(self, height, hides):
        walls = "arena.walls={shape: polygon, vertices: [[-1, -1], [1, -1], [1, 1], [0, 0], [-1, 1]]}"
        placement = at((-0.3, 0.06, 0.78), (0.3, 0.06, -0.78), (0, -0.45, 0))
        model = seeing(occlusion=True, height=0.154)
        found = counts(model, robots=3, placement=placement, overrides=[walls, f"arena.wall_height={height}"])[0]
        assert found.tolist() == ([1, 1, 2] if hides else [2, 2, 2])
        tall = dataclasses.replace(model, body=dataclasses.replace(model.body, height=height))
        found = counts(tall, robots=3, placement=at((0, 0, 0), (0.35, 0, 0), (0.7, 0, 0)))[0]
        assert found.tolist() == ([1, 2, 1] if hides else [2, 2, 2])

    @pytest.mark.parametrize("occlusion", [False, True])
    def test_walls_of_an_arena_with_a_corner_inwards_hide_robots(self, occlusion):
        walls = "arena.walls={shape: polygon, vertices: [[-1, -1], [1, -1], [1, 1], [0, 0], [-1, 1]]}"
        placement = at((-0.3, 0.06, 0.78), (0.3, 0.06, -0.78), (0, -0.45, 0))
        found = counts(seeing(occlusion=occlusion), robots=3, placement=placement, overrides=[walls])[0]
        assert found.tolist() == ([1, 1, 2] if occlusion else [2, 2, 2])

    def test_a_disc_hides_what_is_behind_it(self):
        epuck = load_robot_model("epuck")
        model = seeing(model=epuck, range=0.7, occlusion=True, constants={"neighbour_count_memory": 0.0})
        for aside, seen in [(0.0, 1), (0.03, 1), (0.04, 2)]:
            placement = at((0, 0, 0), (0.2, aside, 0), (0.4, 0, 0))
            assert counts(model, robots=3, placement=placement)[0, 0] == seen

    @pytest.mark.parametrize("loss", [0.15, 0.85])
    def test_its_losses(self, loss):
        """2000 cycles of each robot's neighbours; six standard errors of a binomial share, chance below 1e-8 each."""
        trials = 2000 * counts(seeing())[0]
        share = counts(seeing(loss=loss), duration=200).sum(axis=0) / trials
        assert (np.abs(share - (1 - loss)) < 6 * np.sqrt(loss * (1 - loss) / trials)).all()

    def test_losses_of_cycles_and_robots_are_independent(self):
        """Correlations over 4000 cycles, six standard errors; chance below 1e-7 for all of them."""
        placement = at((0, 0, 0), (0.5, 0, 0))
        found = counts(seeing(loss=0.5), robots=2, duration=400, placement=placement)
        for one, other in [(found[:, 0], found[:, 1]), (found[1:, 0], found[:-1, 0])]:
            assert abs(np.corrcoef(one, other)[0, 1]) < 6 / math.sqrt(len(one))

    def test_losses_of_two_neighbours_are_independent(self):
        """One ahead, one at the left: correlations over 4000 cycles, up to two cycles apart; chance below 1e-7."""
        placement = at((0, 0, 0), (0.5, 0, 0), (0, 0.5, 0))
        ready = simulator(robots=3, duration=400, apothem=3.0, robot_model=seeing(loss=0.5), placement=placement)
        ahead, aside = ready.run(STOP, 1, record=True).history.readings[:, 0, 3:5].T > 0.1
        for lag in range(-2, 3):
            one, other = ahead[2 + lag : 3998 + lag], aside[2:3998]
            assert abs(np.corrcoef(one, other)[0, 1]) < 6 / math.sqrt(len(one))

    def test_all_or_nothing(self):
        assert counts(seeing(loss=1.0), duration=10).max() == 0
        assert counts(seeing(loss=0.0), duration=10)[:, 0].min() == 3

    def test_noise_is_a_vector_of_a_normal_share_of_the_distance_in_any_direction(self):
        """10 000 views of one robot 0.5 m to the right.

        A single neighbour's place follows from its vector, which is 1 / (1 + distance) long. Bounds are six standard
        errors, each exceeded with a chance below 1e-8.
        """
        sd, distance = 0.2, 0.5
        model = seeing(noise=Gaussian(sd=sd), constants={"neighbour_range": 100.0})
        placement = at((0, 0, math.pi / 2), (distance, 0, 0))
        ready = simulator(robots=2, duration=1000, apothem=3.0, robot_model=model, placement=placement)
        x, y = ready.run(STOP, 1, record=True).history.readings[:, 0, 3:5].T
        weight = np.hypot(x, y)
        away = 1 / weight - 1
        errors = np.stack([x, y]) / weight * away - np.array([[0.0], [-distance]])
        n = errors.shape[1]
        assert n == 10_000
        length = distance * sd  # of the vector: its root mean square
        assert (errors**2).sum(axis=0).mean() == pytest.approx(length**2, abs=6 * math.sqrt(2 / n) * length**2)
        # A component is r cos(a): variance length^2 / 2, fourth moment 3 length^4 * 3 / 8.
        for component in errors:
            assert component.mean() == pytest.approx(0, abs=6 * length / math.sqrt(2 * n))
            spread = math.sqrt(9 / 8 - 1 / 4) * length**2
            assert (component**2).mean() == pytest.approx(length**2 / 2, abs=6 * spread / math.sqrt(n))
        assert errors.prod(axis=0).mean() == pytest.approx(0, abs=6 * math.sqrt(3 / 8) * length**2 / math.sqrt(n))

    def test_noise_decides_who_is_in_range(self):
        """One at 0.74 m, of a range of 0.75: often missed with noise, and one at 0.76 m often seen."""
        model = seeing(noise=Gaussian(sd=0.1))
        for x in (0.74, 0.76):
            found = counts(model, robots=2, duration=100, placement=at((0, 0, 0), (x, 0, 0)))[:, 0]
            assert 0.2 < found.mean() < 0.8

    def test_what_else_is_sensed_and_drawn_does_not_change_its_draws(self):
        """Noise of other devices, and another camera's losses beside the noise, leave its draws as they are."""
        alone = seeing(noise=Uniform(half_width=0.1), loss=0.3)
        quiet = dataclasses.replace(alone, ground=None, proximity=None)
        noisy = dataclasses.replace(
            alone,
            proximity=dataclasses.replace(MERCATOR.proximity, noise=Gaussian(sd=0.1), weight_noise=Gaussian(sd=0.1)),
            drive=dataclasses.replace(MERCATOR.drive, noise=Gaussian(sd=0.1)),
        )
        world = {"robots": 4, "duration": 5, "apothem": 3.0, "placement": NEAR}
        read = [
            simulator(robot_model=model, **world).run(STOP, 1, record=True).history.readings[..., 2:5]
            for model in (alone, quiet, noisy)
        ]
        assert np.array_equal(read[0], read[1])
        assert np.array_equal(read[0], read[2])
        assert 0 < read[0][..., 0].mean() < 3


class TestMemory:
    """Robot 0 drives past robot 1 and loses it from sight."""

    def seen(self, memory, **constants):
        cycles = float(memory)  # as all constants are: another type would compile the engine anew
        constants = {"neighbour_memory": cycles, "neighbour_count_memory": cycles, "neighbour_range": 0.5} | constants
        model = seeing(constants=constants)
        world = simulator(
            robots=2, duration=20, apothem=3.0, robot_model=model, placement=at((0, 0, 0), (-0.42, 0, math.pi))
        )
        outcome = world.run(parse("--nstates 1 --s0 0 --rwm0 1"), 1, record=True)
        away = np.linalg.norm(outcome.trace.poses[1:, 0, :2] - outcome.trace.poses[1:, 1, :2], axis=1)
        return outcome.history.readings[:, 0, 2], outcome.history.readings[:, 0, 3:5], away

    @pytest.mark.parametrize("memory", [0, 1, 3, 10])
    def test_a_robot_stays_a_neighbour_for_so_many_cycles(self, memory):
        found, vectors, away = self.seen(memory)
        last = np.flatnonzero(away < 0.5)[-1]
        assert last < 50
        assert found[: last + memory + 1].all()
        assert not found[last + memory + 1 :].any()
        # It is remembered where it was, seen from the robot.
        assert (vectors[last : last + memory + 1] == vectors[last]).all()

    def test_it_may_pull_once_for_each_time_that_it_was_seen(self):
        """The robots hardly move in the first cycles."""
        found, vectors, away = self.seen(2, neighbour_repeats=1.0)
        assert vectors[0, 0] < 0.0
        assert vectors[1, 0] == pytest.approx(2.0 * vectors[0, 0], rel=0.01)
        last = np.flatnonzero(away < 0.5)[-1]
        assert vectors[last + 1, 0] == pytest.approx(vectors[last, 0] * 2.0 / 3.0, rel=0.05)
        assert vectors[last + 3, 0] == 0.0
        assert found.max() == 1.0

    def test_it_may_pull_longer_than_it_counts(self):
        found, vectors, away = self.seen(5, neighbour_count_memory=0.0)
        last = np.flatnonzero(away < 0.5)[-1]
        assert not found[last + 1 :].any()
        assert (vectors[last : last + 6] == vectors[last]).all()
        assert not vectors[last + 6 :].any()

    def test_a_robot_counts_once_however_often_it_was_seen(self):
        """Three robots to see for 20 s, and ten cycles of memory."""
        model = seeing(loss=0.5, constants={"neighbour_count_memory": 10.0})
        found = counts(model, duration=20)
        assert found.max() == 3

    def test_how_often_a_neighbour_is_forgotten(self):
        """When it was missed in this cycle and the ten before, in 25 000 cycles of four robots.

        What is missed in one cycle is missed in the next too: with one of 20 cycles counted, the bound is above ten
        standard errors; chance below 1e-8.
        """
        loss = 0.85
        model = seeing(loss=loss, constants={"neighbour_count_memory": 10.0})
        found = counts(model, duration=2500)[11:]
        near = counts(seeing())[0]
        assert found.sum() / (len(found) * near.sum()) == pytest.approx(1 - loss**11, rel=0.05)


LIDAR = dataclasses.replace(MERCATOR, neighbours=LidarNeighbours())
QUIET_LIDAR = dataclasses.replace(LIDAR, lidar=dataclasses.replace(LIDAR.lidar, noise=None))


def clusters(scan, model, reference):
    lidar = model.lidar
    rows = [[0.0] * len(scan) for _ in range(3)]
    n = lidar_neighbours(reference, scan.tolist(), lidar.first_angle, 2 * math.pi / lidar.beams, *rows)
    return np.array(rows)[:, :n].T


class TestLidar:
    @pytest.mark.parametrize("model", [QUIET_LIDAR, LIDAR], ids=["without noise", "with noise"])
    def test_neighbours_are_where_the_robots_are(self, model):
        """Random scenes in which no head hides another.

        The mean of a head's readings lies between its front, 3.5 cm nearer than its centre, and its centre. The mean
        angle is off by half a beam, for the beams are a grid, and by half of those that noise or the curve of the head
        put out on one side only, three at most: two beams, of 0.5 degrees.
        """
        noise = 0.005 if model is LIDAR else 0.0
        world = simulator(robots=5, duration=0.1, apothem=2.0, robot_model=model)
        checked = 0
        for seed in range(60):
            outcome = world.run(STOP, seed, record=True)
            poses = outcome.trace.poses[1]
            scans = outcome.recording.measure("lidar")[0]
            for i, (x, y, heading) in enumerate(poses):
                to = np.delete(poses[:, :2], i, axis=0) - (x, y)
                away = np.hypot(*to.T)
                bearings = np.arctan2(to[:, 1], to[:, 0]) - heading
                apart = np.abs((bearings[:, None] - bearings + math.pi) % (2 * math.pi) - math.pi)
                if (apart + 9 * np.eye(4)).min() < 0.3 or (np.abs(away - 0.765) < 0.03).any():
                    continue
                near = away < 0.75
                found = clusters(scans[i], model, model.reference_model)
                assert len(found) == near.sum() == outcome.history.readings[0, i, 2]
                for distance, x_, y_ in found:
                    off = (math.atan2(y_, x_) - bearings[near] + math.pi) % (2 * math.pi) - math.pi
                    k = np.argmin(np.abs(off))
                    assert abs(off[k]) < 2 * math.radians(0.5)
                    assert -0.035 - noise <= distance - away[near][k] <= noise
                    checked += 1
                pull = (found[:, 1:] / (1 + found[:, :1])).sum(axis=0)
                assert outcome.history.readings[0, i, 3:5] == pytest.approx(pull)
        assert checked > 60

    def test_walls_are_neighbours_where_the_lidar_sees_them_from_near(self):
        placement = at((0.9, 0, 0), (-0.5, 0, 0))
        assert look(LIDAR, robots=2, sides=4, apothem=1.5, placement=placement).history.readings[0, :, 2].max() == 0
        tall = ["arena.wall_height=0.5"]
        read = look(LIDAR, robots=2, sides=4, apothem=1.5, placement=placement, overrides=tall).history.readings[0]
        assert read[0, 2] >= 1
        assert read[1, 2] == 0

    @pytest.mark.parametrize("seed", [1, 2])
    def test_compiled_engine_referee_and_plain_python_agree(self, seed, monkeypatch):
        world = simulator(robots=4, duration=3, apothem=1.0, robot_model=LIDAR, placement="{shape: disc, radius: 0.7}")
        compiled = world.run(ATTRACT, seed, record=True)
        referee = world.run(ATTRACT, seed, record=True, referee=True)
        monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
        plain = world.run(ATTRACT, seed, record=True)
        assert compiled.history.readings[..., 2].mean() > 0.3
        for name in compiled.history._fields:
            for other in (referee, plain):
                assert np.array_equal(getattr(compiled.history, name), getattr(other.history, name)), name

    def test_the_lidar_costs_no_draws_and_recording_changes_nothing(self):
        world = simulator(robots=4, duration=10, robot_model=LIDAR)
        alone, recorded = world.run(ATTRACT, 3), world.run(ATTRACT, 3, record=True)
        assert np.array_equal(alone.trace.poses, recorded.trace.poses)
        assert np.array_equal(alone.recording.measure("lidar"), recorded.recording.measure("lidar"))
