"""What a user is told of though it is valid: settings, conditions and colours that make no difference."""

import dataclasses
import math
import statistics
from typing import Annotated

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from mercator_design.cli import cli
from mercator_design.config import shipped
from mercator_design.config.schema import Range
from mercator_design.fsm import parse
from mercator_design.missions.mission import load_mission
from mercator_design.modules.flavour import define_flavour
from mercator_design.modules.module import CONDITIONS, condition
from mercator_design.sim.checks.no_effect import (
    can_fire,
    dead_conditions,
    floor_warnings,
    model_warnings,
    no_effect_warnings,
)
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import Gaussian, Neighbours, Uniform
from tests.sim.worlds import mission

MERCATOR, EPUCK = load_robot_model("mercator"), load_robot_model("epuck")
SEEKER = parse("--nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 6 --p0x0 0.5 --l0x0 2 --s1 1")


def with_ground(**changes):
    return dataclasses.replace(MERCATOR, ground=dataclasses.replace(MERCATOR.ground, **changes))


def painted(*colours, background="gray", dynamics="[]"):
    zones = ", ".join(
        f"{{name: z{k}, shape: disc, center: [0, 0], radius: 0.3, color: {colour}}}" for k, colour in enumerate(colours)
    )
    return mission(robots=2, floor=f"{{background: {background}, zones: [{zones}], dynamics: {dynamics}}}")


def apart(model, *colours, **floor):
    """The colours that are named as one."""
    found = floor_warnings(painted(*colours, **floor), model)
    return [text.partition(" distinguishes ")[2] for text in found]


@pytest.mark.parametrize("name", shipped.missions())
def test_there_are_none_of_shipped_missions(name):
    loaded = load_mission(name)
    model = load_robot_model(loaded.robot_model)
    assert [*model_warnings(model), *floor_warnings(loaded, model)] == []


@pytest.mark.parametrize("name", shipped.robot_models())
def test_there_are_none_of_shipped_robot_models(name):
    assert list(model_warnings(load_robot_model(name))) == []


@pytest.mark.usefixtures("registries")
class TestFlavours:
    def test_constants_of_a_flavour_count(self):
        gray = painted("gray")
        text = "schema: 1\nbehaviours: {stop: 0}\nconditions: {black floor: 0}\n"
        define_flavour(text, "usual")
        define_flavour(f"{text}constants: {{black_highest: 200}}\n", "dark")
        assert dead_conditions(gray, MERCATOR, "usual") == ["black floor"]
        assert dead_conditions(gray, MERCATOR, "dark") == []

    def test_a_condition_of_other_parameters_than_beta_may_fire(self):
        @condition(reads={"ground"})
        def between(
            model,
            readings,
            memory,
            beta: Annotated[float, Range(0, 1)],
            low: Annotated[float, Range(0, 255)],
            high: Annotated[float, Range(0, 255)],
        ):
            return beta if low < readings.ground_red < high else 0.0

        define_flavour("schema: 1\nbehaviours: {stop: 0}\nconditions: {between: 0}\n", "levels")
        gray = painted("gray")
        assert dead_conditions(gray, MERCATOR, "levels") == []
        assert [*no_effect_warnings(gray, MERCATOR, "levels")] == []
        assert can_fire(gray, MERCATOR, CONDITIONS["between"], (1.0, 0.0, 200.0))
        assert not can_fire(gray, MERCATOR, CONDITIONS["between"], (1.0, 200.0, 255.0))


class TestColours:
    def test_a_robot_that_sees_them(self):
        assert apart(MERCATOR, "black", "white", "red", "green", "blue", "yellow") == []
        assert apart(MERCATOR, "magenta", "cyan", "black") == ["gray, magenta"]
        assert apart(MERCATOR, "[250, 0, 0]", "red") == ["[250, 0, 0], red"]

    def test_a_robot_that_sees_brightness(self):
        assert apart(EPUCK, "black", "white") == []
        assert apart(EPUCK, "red", "black") == ["gray, red"]
        assert apart(EPUCK, "yellow", "white", background="black") == ["yellow, white"]

    def test_readings_that_vote_have_no_colours(self):
        voting = MERCATOR.reference_model._replace(ground_vote_cycles=5.0, ground_majority=2.0)
        ground = dataclasses.replace(MERCATOR.ground, labels=None)
        robot = dataclasses.replace(MERCATOR, reference_model=voting, ground=ground)
        assert apart(robot, "red", "black") == ["gray, red"]

    def test_a_colour_written_in_two_ways_is_one(self):
        assert apart(EPUCK, "[127, 127, 127]", "black") == []

    def test_colours_that_zones_take_later(self):
        later = "[{name: schedule, zones: [z0], times: [1], colors: [blue]}, {name: visited, zones: [z0], color: red}]"
        assert apart(EPUCK, "black", dynamics=later) == ["gray, blue, red"]
        assert apart(MERCATOR, "black", dynamics=later) == []

    def test_tiles(self):
        (text,) = floor_warnings(load_mission("color_aggregation"), EPUCK)
        assert "gray, green, red" in text

    def test_flavours_have_their_own_conditions(self):
        text = list(no_effect_warnings(painted("red", "green"), MERCATOR, "chocolate"))
        assert text == ["mission:8: floor: no condition of robot mercator distinguishes gray, green"]
        assert list(no_effect_warnings(painted("red", "green"), MERCATOR, "watermelon")) == []

    def test_a_robot_without_ground_sensors_is_not_asked(self):
        assert apart(dataclasses.replace(EPUCK, ground=None), "red") == []


class TestLabels:
    """Of a robot model's own, against the colours of a floor."""

    @pytest.mark.parametrize(
        ("labels", "facts"),
        [
            (("orange",), "are orange: black counts as orange; gray counts as orange; orange is not on the floor"),
            (("red", "black"), "are black, red: gray counts as black; red is not on the floor"),
            (("gray",), "are gray: black counts as gray"),
            (
                ("black", "white", "gray", "red"),
                "are black, white, gray, red: white, red are not on the floor",
            ),
        ],
    )
    def test_that_are_not_those_of_the_floor_are_told_once(self, labels, facts):
        (text,) = floor_warnings(painted("black"), with_ground(labels=labels))
        assert text == f"{MERCATOR.where('ground.labels')}: the floor of mission has black, gray, the labels {facts}"

    @pytest.mark.parametrize("labels", [("gray", "black"), ("black", "gray"), "floor", None])
    def test_that_are_those_of_the_floor(self, labels):
        assert list(floor_warnings(painted("black"), with_ground(labels=labels))) == []

    def test_what_else_is_wrong_with_the_floor_is_reported(self):
        found = floor_warnings(painted("black", "[250, 0, 0]", "red"), with_ground(labels=("black", "gray")))
        assert [text.rpartition(": ")[2] for text in found] == [
            "red counts as gray",
            "no condition of robot mercator distinguishes [250, 0, 0], red",
        ]

    @pytest.mark.parametrize(
        "arguments", [("validate",), ("evaluate", "--fsm-config", "--nstates 1 --s0 1", "-n", "1")]
    )
    def test_a_user_is_warned(self, tmp_path, arguments):
        (tmp_path / "robot.yaml").write_text("base: mercator\nground: {labels: [orange]}\n")
        text = (
            shipped.missions()["aggregation"].read_text().replace("robot_model: mercator", "robot_model: ./robot.yaml")
        )
        (tmp_path / "m.yaml").write_text(text)
        verb, *more = arguments
        file = ["--mission", str(tmp_path / "m.yaml")] if more else [str(tmp_path / "m.yaml")]
        result = CliRunner().invoke(cli, [verb, *file, *more])
        assert result.exit_code == 0, result.output
        assert result.stderr.count("orange is not on the floor") == 1
        assert "apart" not in result.stderr


class TestLevelsBetweenLabels:
    def told(self, *colours, model=MERCATOR, background="black"):
        return list(floor_warnings(painted(*colours, background=background), model))

    def test_the_share_that_flips(self):
        """Normal noise of 5 a channel across the middle of black and gray, 63.5: 0.87 away, as 42.7 or 43.1 %."""
        for level, label, other in ((64, "gray", "black"), (63, "black", "gray")):
            (text,) = self.told("gray", f"[{level}, {level}, {level}]")
            place = f"mission:8: floor: [{level}, {level}, {level}] counts as {label}, but as {other} in "
            assert text.startswith(place)
            assert text.endswith(" % of readings, because of the noise of robot mercator")
            share = float(text.removeprefix(place).split()[0])
            expected = 100.0 * (1.0 - statistics.NormalDist().cdf(0.5 * math.sqrt(3.0) / 5.0))
            assert abs(share - expected) < 6.0  # drawn once for all: 1.1 points are one standard deviation

    def test_colours_that_noise_does_not_reach(self):
        assert self.told("gray") == []
        assert self.told("[80, 80, 80]", "gray") == [
            "mission:8: floor: no condition of robot mercator distinguishes [80, 80, 80], gray"
        ]

    def test_a_robot_without_noise(self):
        assert "no condition" in self.told("gray", "[64, 64, 64]", model=with_ground(noise=None))[0]

    def test_several_sensors_see_better(self):
        one, many = (with_ground(noise=Gaussian(sd=5.0), positions=((0.0, 0.0),) * number) for number in (1, 16))
        assert "% of readings" in self.told("gray", "[70, 70, 70]", model=one)[0]
        assert "% of readings" not in self.told("gray", "[70, 70, 70]", model=many)[0]

    def test_uniform_noise_with_a_mean(self):
        """All of a level of 60 is read between 62 and 72."""
        (text,) = self.told("gray", "[60, 60, 60]", model=with_ground(noise=Uniform(mean=7.0, half_width=5.0)))
        assert "[60, 60, 60] counts as black, but as gray in " in text
        assert float(text.partition(" as gray in ")[2].split()[0]) > 90.0

    def test_a_picture_whose_colours_are_between_labels(self, tmp_path):
        def told_of(shades):
            pixels = np.repeat(np.resize(np.array(shades, dtype=np.uint8), (20, 20))[..., np.newaxis], 3, axis=2)
            Image.fromarray(pixels).save(tmp_path / "floor.png")
            image = f"{{background: white, image: {{path: {tmp_path / 'floor.png'}, size: [2, 2]}}}}"
            return list(floor_warnings(mission(robots=2, floor=image), MERCATOR))

        assert told_of([0, 127, 20, 100]) == []
        (text,) = told_of([0, 127, 64, 127])
        assert "floor.image: " in text
        assert "% of the readings of the image count as another colour than they should" in text


class TestModules:
    def test_a_condition_on_colours_never_holds_without_them(self):
        (text,) = no_effect_warnings(painted("black"), EPUCK, "watermelon", SEEKER)
        assert text == (
            "state 0, transition 0: floor colour never fires: robot epuck sees only how bright the ground is"
        )
        assert list(no_effect_warnings(painted("red"), MERCATOR, "watermelon", SEEKER)) == []


class TestRanges:
    @pytest.mark.parametrize(
        ("camera", "told"),
        [
            (Neighbours(), False),
            (Neighbours(range=0.75), False),
            (Neighbours(range=0.5), False),
            (Neighbours(range=0.76), True),
            (Neighbours(range=0.76, noise=Gaussian(sd=0.1)), False),  # what is farther may seem nearer
        ],
    )
    def test_a_range_beyond_what_counts(self, camera, told):
        found = list(model_warnings(dataclasses.replace(MERCATOR, neighbours=camera)))
        assert bool(found) is told
        assert all("neighbours.range: 0.76 m changes nothing" in text and "within 0.75 m" in text for text in found)


def test_only_a_condition_that_reads_the_ground_alone_is_known_never_to_fire():
    on_gray = mission()
    white = CONDITIONS["white floor"]
    assert not can_fire(on_gray, MERCATOR, white, (1.0,))
    assert can_fire(on_gray, MERCATOR, dataclasses.replace(white, reads=white.reads | {"neighbours"}), (1.0,))
