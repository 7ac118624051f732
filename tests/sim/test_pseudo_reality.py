"""Robot models made from others, and models that differ from instance to instance."""

import dataclasses

import numpy as np
import pytest

from mercator_design.errors import MissionError
from mercator_design.fsm import parse
from mercator_design.missions.mission import load_mission
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import Gaussian, Uniform
from mercator_design.sim.simulate import Simulator

MERCATOR = load_robot_model("mercator")
EXPLORE = parse("--nstates 1 --s0 0 --rwm0 20")


@pytest.fixture
def model(tmp_path):
    def load(text, name="other"):
        file = tmp_path / f"{name}.yaml"
        file.write_text("schema: 1\n" + text)
        return load_robot_model(str(file))

    return load


def test_what_is_not_said_is_as_in_the_base(model):
    other = model("base: mercator\nground: {noise: {sd: 9}}\n")
    assert other.ground.noise == Gaussian(sd=9.0)
    ground = dataclasses.replace(MERCATOR.ground, noise=Gaussian(sd=9.0))
    assert other == dataclasses.replace(MERCATOR, name="other", description="", ground=ground)


def test_another_kind_takes_nothing_over(model):
    other = model("base: mercator\nground: {noise: {distribution: uniform, half_width: 3}}\n")
    assert other.ground.noise == Uniform(half_width=3.0)
    other = model("base: mercator\nbody: {shape: disc, radius: 0.1, mass: 1}\n")
    assert other.body.corner == 0.1


def test_a_base_may_be_a_file_beside_it_and_have_a_base(model):
    model("base: mercator\ndrive: {maximum_speed: 0.2}\n", name="slow")
    other = model("base: ./slow.yaml\ndrive: {force: 3}\n")
    assert (other.drive.maximum_speed, other.drive.force, other.drive.torque) == (0.2, 3.0, 1.5)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("base: mercater\n", r"other.yaml:2: base: mercater: no such robot model; did you mean 'mercator'"),
        ("base: ./other.yaml\n", "is based on itself"),
        ("base: [mercator]\n", "base: expected text"),
        ("base: mercator\ngrund: {}\n", "grund: unknown key; did you mean 'ground'"),
        (
            "base: mercator\nvary: {drive.maximum_sped: [0.1, 0.2]}\n",
            "drive.maximum_sped: the robot model has no real number there",
        ),
        ("base: mercator\nvary: {drive: [0.1, 0.2]}\n", "drive: the robot model has no real number there"),
        ("base: mercator\nvary: {drive.maximum_speed: [0.3, 0.2]}\n", "expected the lower bound first"),
        ("base: mercator\nvary: {drive.maximum_speed: [-1, 0.2]}\n", "drive.maximum_speed: expected a number >= 0.01"),
        (
            "base: mercator-varied\nvary: {neighbours.loss: [0, 1.5]}\n",
            "neighbours.loss: expected a number >= 0 and <= 1",
        ),
    ],
)
def test_mistakes_are_named(model, text, words):
    with pytest.raises(MissionError, match=words):
        model(text)


def test_drawn_models_lie_between_the_bounds():
    varied = load_robot_model("mercator-varied")
    drawn = [varied.drawn(np.random.default_rng(seed)) for seed in range(50)]
    speeds = [one.drive.maximum_speed for one in drawn]
    assert 0.27 <= min(speeds) < 0.28
    assert 0.32 < max(speeds) <= 0.33
    assert len({one.reference_model.neighbour_range for one in drawn}) == 50
    assert all(one.physics == varied.physics for one in drawn)


def test_each_instance_has_its_own_robots():
    mission = load_mission("aggregation", ["robots=1", "duration=3", "arena.walls.apothem=5"])
    quiet = dataclasses.replace(MERCATOR, vary={"drive.maximum_speed": (0.1, 0.3)})
    simulator = Simulator(mission, quiet)
    moved = []
    for seed in range(6):
        poses = simulator.run(EXPLORE, seed).trace.poses[:, 0, :2]
        moved.append(np.linalg.norm(poses[-1] - poses[-2]) / 0.1)
        assert np.array_equal(poses, simulator.run(EXPLORE, seed).trace.poses[:, 0, :2])
    assert len({round(speed, 6) for speed in moved}) == 6
    assert all(0.1 <= speed <= 0.3 for speed in moved)


def test_shipped_pseudo_realities_differ_in_what_they_say():
    noisy = load_robot_model("mercator-pseudo-reality")
    assert (noisy.ground.noise, noisy.neighbours.noise) == (Gaussian(sd=20.0), Gaussian(sd=0.9))
    assert (noisy.body, noisy.reference_model) == (MERCATOR.body, MERCATOR.reference_model)
    epuck = load_robot_model("epuck-pseudo-reality")
    assert (epuck.light.noise, epuck.drive.noise.sd) == (Uniform(half_width=0.9), 0.15)
    assert epuck.proximity == load_robot_model("epuck").proximity
