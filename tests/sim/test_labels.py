"""Ground readings snap to the labels of the mission's floor, in simulation as on the robot."""

import dataclasses

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from mercator_design.cli import cli
from mercator_design.config import shipped
from mercator_design.config.colours import COLOURS
from mercator_design.config.schema import FieldError
from mercator_design.designer import Designer
from mercator_design.errors import MissionError
from mercator_design.fsm import parse
from mercator_design.missions.mission import load_mission
from mercator_design.modules.perception import nearest_label
from mercator_design.robot.devices.settings import Settings, nearest
from mercator_design.show.text.summary import describe
from mercator_design.sim.checks.no_effect import dead_transitions
from mercator_design.sim.labels import robot_labels, simulated_labels
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.simulate import Simulator
from tests.sim.worlds import mission, simulator

MERCATOR = load_robot_model("mercator")
SEEK_RED = "--nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 6 --p0x0 1 --l0x0 2 --s1 1"
WANDER = "--nstates 1 --s0 0 --rwm0 20"


def with_ground(model, **changes):
    return dataclasses.replace(model, ground=dataclasses.replace(model.ground, **changes))


def floor(text):
    return mission(floor=text).floor


class TestInSimulation:
    def test_a_floor_of_gray_and_black_is_never_red(self):
        """Exact: the sum of noise would have to exceed 100 levels, twenty standard deviations."""
        world = Simulator(load_mission("aggregation"))
        for seed in range(5):
            outcome = world.run(parse(SEEK_RED), seed, record=True)
            assert not outcome.trace.states.any()
            assert set(np.unique(outcome.history.readings[..., 5:8])) == {0.0, 127.0}

    def test_noise_on_the_ground_changes_no_score(self):
        loaded = load_mission("aggregation")
        quiet, noisy = Simulator(loaded, with_ground(MERCATOR, noise=None)), Simulator(loaded)
        seek_black = parse("--nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 0 --p0x0 1 --s1 1")
        for pfsm in (parse(SEEK_RED), seek_black):
            for seed in range(10):
                assert quiet.run(pfsm, seed).score == noisy.run(pfsm, seed).score

    @pytest.mark.parametrize("name", ["mercator-argos", "mercator-chocolate"])
    def test_the_originals_models_have_no_labels(self, name):
        assert simulated_labels(load_mission("aggregation").floor, load_robot_model(name)) == ()

    @pytest.mark.parametrize("name", ["mercator", "mercator-pseudo-reality", "mercator-varied"])
    def test_ours_have_those_of_the_floor(self, name):
        assert simulated_labels(load_mission("aggregation").floor, load_robot_model(name)) == ("black", "gray")

    def test_several_sensors_count_as_the_label_of_their_mean(self):
        robot = with_ground(MERCATOR, noise=None, positions=((0.05, 0.0), (-0.05, 0.0), (-0.06, 0.0)))
        half = "{background: gray, zones: [{shape: half_plane, point: [0, 0], normal: [1, 0], color: black}]}"
        found = simulator(
            robot_model=robot, duration=0.1, floor=half, placement="{shape: poses, poses: [[0, 0, 0]]}"
        ).run(parse("--nstates 1 --s0 1"), 1, record=True)
        assert found.history.readings[0, 0, 5:8].tolist() == [127.0] * 3


class TestRobotAndSimulator:
    @pytest.mark.parametrize("model", ["mercator", "mercator-pseudo-reality"])
    @pytest.mark.parametrize("name", ["aggregation", "color_aggregation", "grid_exploration"])
    def test_the_same_raw_readings_give_the_same_labels(self, name, model):
        """The robot, with the labels that the race's fsm.txt tells it, reads what the simulated behaviour read."""
        world = Simulator(load_mission(name, ("duration=20",)), load_robot_model(model))
        header = Designer(world, budget=1500, seed=1).header()
        labels = Settings().labels_of(header)
        recording = world.run(parse(WANDER), 3, record=True).recording
        raw = recording.measure("ground_sensors")[:, :, 0]
        read = recording.measure("ground")
        for measured, found in zip(raw.reshape(-1, 3).tolist(), read.reshape(-1, 3).tolist(), strict=True):
            assert COLOURS[nearest(labels, tuple(measured))] == tuple(found)
        assert not np.array_equal(raw, read)  # there was noise

    def test_the_first_of_labels_as_near(self):
        assert nearest_label((255.0, 0.0, 0.0, 0.0, 255.0, 0.0), 0.0, 0.0, 0.0) == 0


class TestLabelsOfAFloor:
    def test_named_colours_in_the_order_of_the_table(self):
        painted = "{background: orange, zones: [{shape: disc, center: [0, 0], radius: 0.3, color: black}]}"
        assert simulated_labels(floor(painted), MERCATOR) == ("black", "orange")

    def test_colours_that_zones_take_later(self):
        labels = simulated_labels(load_mission("gianduja_decision").floor, MERCATOR)
        assert labels == ("black", "white", "gray")

    def test_levels_count_as_the_nearest(self):
        painted = (
            "{background: [120, 130, 125], zones: [{shape: disc, center: [0, 0], radius: 1, color: [200, 20, 9]}]}"
        )
        assert simulated_labels(floor(painted), MERCATOR) == ("gray", "red")

    def test_pixels_count_as_the_nearest(self, tmp_path):
        pixels = np.zeros((4, 4, 3), dtype=np.uint8)
        pixels[0, 0] = (250, 240, 235)
        Image.fromarray(pixels).save(tmp_path / "floor.png")
        painted = f"{{background: gray, image: {{path: {tmp_path / 'floor.png'}, size: [2, 2]}}}}"
        assert simulated_labels(floor(painted), MERCATOR) == ("black", "white", "gray")

    def test_a_models_own(self):
        model = with_ground(MERCATOR, labels=("red", "black"))
        for labels in (simulated_labels, robot_labels):
            assert labels(load_mission("aggregation").floor, model) == ("black", "red")

    def test_robots_have_labels_where_their_simulation_has_none(self):
        model = load_robot_model("mercator-argos")
        assert robot_labels(load_mission("aggregation").floor, model) == ("black", "gray")

    def test_an_empty_list_is_refused(self, tmp_path):
        (tmp_path / "robot.yaml").write_text("base: mercator\nground:\n  labels: []\n")
        with pytest.raises(MissionError) as error:
            load_robot_model(str(tmp_path / "robot.yaml"))
        assert str(error.value) == (
            f"{tmp_path / 'robot.yaml'}:3: ground.labels: expected at least one colour, found []; null keeps readings "
            "as measured"
        )

    @pytest.mark.parametrize(
        "changes", [{"gray": True}, {"gray": True, "labels": ("black", "white")}], ids=["floor", "own"]
    )
    def test_sensors_without_colours_have_none(self, changes):
        with pytest.raises(FieldError, match="no colours"):
            with_ground(MERCATOR, **changes)


class TestWhatNeverFires:
    def test_validate_names_it(self):
        assert told("validate", "aggregation").stdout.endswith("120 s; never fires there: white floor, floor colour\n")

    def test_labels_of_a_condition_that_may_fire(self):
        """Green is gray, and yellow white, by brightness."""
        assert told("validate", "color_aggregation").stdout.endswith("there: black floor, floor colour blue\n")

    def test_one_robot_has_no_neighbours(self, tmp_path):
        text = shipped.missions()["aggregation"].read_text().replace("robots: 3", "robots: 1")
        (tmp_path / "alone.yaml").write_text(text)
        assert "one robot has no neighbours" in told("validate", tmp_path / "alone.yaml").stderr

    def test_evaluate_names_the_transition(self, tmp_path):
        (tmp_path / "fsm.txt").write_text(f"{SEEK_RED}\n")
        warned = told("evaluate", tmp_path / "fsm.txt", "--mission", "aggregation", "-n", 1).stderr
        assert (
            "never fires on aggregation, whose robots see black, gray: state 0, transition 0 (floor colour)" in warned
        )

    def test_a_summary_names_it(self):
        world = Simulator(load_mission("aggregation"))
        pfsm = parse(SEEK_RED)
        dead = dead_transitions(world.mission, MERCATOR, pfsm)
        assert describe(pfsm, dead)[1].endswith("label red), which never fires on this mission")
        assert dead_transitions(world.mission, load_robot_model("mercator-argos"), pfsm) == [(0, 0)]
        assert dead_transitions(world.mission, with_ground(MERCATOR, labels=None), pfsm) == []  # noise shows red


def told(*arguments):
    result = CliRunner().invoke(cli, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return result
