"""What a robot model and a mission may say of sensors, heights, rooms and lights, and what is refused."""

import dataclasses

import pytest

from mercator_design.errors import FsmError, MissionError
from mercator_design.fsm import parse
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import LidarNeighbours, Neighbours
from tests.sim.worlds import at, look, mission, simulator

MERCATOR = load_robot_model("mercator")


@pytest.fixture
def model(tmp_path):
    """The robot model of a text on the base of Mercator."""

    def load(text, base="mercator"):
        file = tmp_path / "model.yaml"
        file.write_text(f"schema: 1\nbase: {base}\n{text}\n")
        return load_robot_model(str(file))

    return load


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("lidar: {range: [12, 0.1]}", r"lidar.range: expected .* the smaller first \[m\], found"),
        ("lidar: {range: [1, 1]}", "lidar.range: expected .* the smaller first"),
        ("proximity: {range: [2.0, 0.05]}", "proximity.range: expected .* the smaller first"),
        ("imu: {range: [3, -3]}", "imu.range: expected .* the smaller first"),
        ("ambient_light: {range: [5, 0]}", "ambient_light.range: expected .* the smaller first"),
        ("lidar: {range: [-0.1, 12]}", r"lidar.range\[0\]: expected a number >= 0"),
        ("lidar: {range: [0.1]}", "lidar.range: expected"),
        ("lidar: {beams: 7}", "lidar.beams: expected a whole number >= 8"),
        ("lidar: {beams: 719.5}", "lidar.beams: expected a whole number"),
        ("lidar: {height: 0}", "lidar.height"),
        ("lidar: {head_radius: -1}", "lidar.head_radius"),
        ("lidar: null\nneighbours: {device: lidar}", "neighbours.device: there is no lidar"),
        ("lidar: {head_radius: 0}\nneighbours: {device: lidar}", "neighbours.device: the lidar sees no robots"),
        ("neighbours: {device: lidar, loss: 0.5}", "neighbours.loss: unknown key"),
        ("neighbours: {device: radio}", "neighbours.device: expected one of camera, lidar, found .radio."),
        ("neighbours: {device: camera, loss: 1.01}", "neighbours.loss: expected a number >= 0 and <= 1"),
        ("neighbours: {device: camera, loss: -0.01}", "neighbours.loss: expected a number >= 0 and <= 1"),
        ("neighbours: {device: camera, occlusion: perhaps}", "neighbours.occlusion: expected true or false"),
        ("light: {device: lamp, height: 0.1}", "light.device: expected one of ring, camera, found .lamp."),
        ("light: {device: ring, height: 0.1}", "light.angles"),
        ("light: {device: ring, height: 0.1, angles: []}", "light.angles"),
        ("light: {device: camera, height: 0.1}", "light.range"),
        ("body: {shape: sphere}", "body.shape: expected one of box, disc, found .sphere."),
        ("body: {shape: disc, mass: 1}", "body.radius"),
        ("body: {shape: disc, mass: 1, radius: 0.1, width: 1}", "body.width: unknown key"),
        ("sonar: {range: [0, 1]}", "sonar: unknown key"),
        ("ground: {positions: []}", "ground.positions"),
        ("ground: {gray: 1}", "ground.gray: expected true or false"),
        (
            "ground: {noise: {distribution: normal, sd: 1}}",
            "ground.noise.distribution: expected one of gaussian, uniform",
        ),
        ("ground: {noise: {distribution: uniform, sd: 1}}", "ground.noise.sd: unknown key"),
        ("imu: {noise: {distribution: gaussian, sd: -1}}", "imu.noise.sd"),
        ("leds: {colors: [[0, 0, 0]]}", "leds.colors"),
        (
            "leds: {positions: [[0, 0]], colors: [[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 256]]}",
            r"leds.colors\[3\]\[2\]",
        ),
        ("reference_model: {ground_vote_cycles: 1.0e+9}", "reference_model.ground_vote_cycles"),
        ("reference_model: {ground_vote_cycles: -1}", "reference_model.ground_vote_cycles"),
    ],
)
def test_mistakes_in_a_robot_model_are_named(model, text, words):
    with pytest.raises(MissionError, match=words) as error:
        model(text)
    assert "model.yaml:" in str(error.value)


def test_a_body_must_have_a_shape(tmp_path):
    file = tmp_path / "model.yaml"
    drive = "{tread_distance: 0.1, maximum_speed: 0.1, force: 1, torque: 1}"
    file.write_text(f"schema: 1\nbody: {{mass: 1, radius: 0.1}}\ndrive: {drive}\n")
    with pytest.raises(MissionError, match=r"model.yaml:2: body.shape"):
        load_robot_model(str(file))


def test_neighbours_by_lidar(model):
    """Nothing of the base's camera is left; a lidar below the top plates sees bodies, so needs no heads."""
    assert model("neighbours: {device: lidar}").neighbours == LidarNeighbours()
    assert model("neighbours: {device: lidar}", base="mercator-pseudo-reality").neighbours == LidarNeighbours()
    assert model("neighbours: {device: lidar}", base="mercator-argos").neighbours == LidarNeighbours()
    assert model("neighbours: {device: camera, range: 2}").neighbours == Neighbours(range=2.0)


def test_a_range_that_shrinks_reaches_the_controller():
    """The reference model weighs obstacles up to 0.4 m; sensors that reach 0.2 m see none at 0.3 m."""
    world = {"sides": 4, "apothem": 2.0, "placement": at((2.0 - 0.143 - 0.3, 0, 0))}
    assert look(MERCATOR, **world).history.readings[0, 0, 0] > 0.04
    short = dataclasses.replace(MERCATOR, proximity=dataclasses.replace(MERCATOR.proximity, range=(0.05, 0.2)))
    assert look(short, **world).history.readings[0, 0, 0] == 0.0
    assert look(short, **{**world, "placement": at((2.0 - 0.143 - 0.19, 0, 0))}).history.readings[0, 0, 0] > 0.04


@pytest.mark.parametrize(
    ("fsm", "flavour", "missing"),
    [
        ("--nstates 1 --s0 2", "chocolate", "light"),
        ("--nstates 1 --s0 2 --att0 1", "watermelon", "neighbours"),
        ("--nstates 1 --s0 0 --rwm0 1", "watermelon", "proximity"),
    ],
)
def test_a_controller_that_needs_what_the_robot_lacks_is_refused(fsm, flavour, missing):
    without = dataclasses.replace(MERCATOR, **{missing: None})
    with pytest.raises(FsmError, match=f"needs .*{missing}.*, which robot mercator does not perceive"):
        simulator(robot_model=without).run(parse(fsm, flavour=flavour), 1)


def test_robot_models_that_perceive_what_is_missing_are_named():
    with pytest.raises(FsmError, match=r"the robot_model of a mission that does: epuck, .*mercator-chocolate"):
        simulator().check(parse("--nstates 1 --s0 2", flavour="chocolate"))


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("arena.wall_height=0", "arena.wall_height"),
        ("arena.obstacles=[{center: [0, 0], size: [0.1, 0.1], height: -1}]", r"arena.obstacles\[0\].height"),
        ("arena.room={shape: regular_polygon, sides: 4, apothem: 1}", "arena.room: does not contain the arena's walls"),
        ("arena.room={shape: regular_polygon, sides: 12, apothem: 1.2}", "arena.room: does not contain"),
        (
            "arena.room={shape: polygon, vertices: [[-2, -2], [2, -2], [2, 2], [0.1, 2], [0, 1], [-0.1, 2], [-2, 2]]}",
            "arena.room: does not contain",
        ),
        (
            "arena.room={shape: polygon, vertices: [[-2, -2], [2, -2], [2, 0], [-1.9, 0], [2, 0.1], [2, 2], [-2, 2]]}",
            "arena.room: does not contain",
        ),
        ("lights=[{position: [0, 0, 1], intensity: -1}]", r"lights\[0\].intensity"),
        ("lights=[{position: [0, 0], intensity: 1}]", r"lights\[0\].position"),
        (
            "lights=[{position: [0, 0, 1], intensity: 1, seen_by: [0, 3]}]",
            r"lights\[0\].seen_by\[1\]: expected a robot's",
        ),
        ("lights=[{position: [0, 0, 1], intensity: 1, seen_by: []}]", r"lights\[0\].seen_by"),
        ("lights=[{position: [0, 0, 1], intensity: 1, seen_by: [-1]}]", r"lights\[0\].seen_by\[0\]"),
    ],
)
def test_mistakes_in_a_mission_are_named(override, words):
    with pytest.raises(MissionError, match=words):
        mission(robots=3, overrides=[override])


def test_a_room_is_larger_than_the_arena():
    assert mission(overrides=["arena.room={shape: regular_polygon, sides: 12, apothem: 1.3}"]).arena.room
