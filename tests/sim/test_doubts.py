"""What a user is told of though it is valid: settings, conditions and colours that make no difference."""

import dataclasses

import pytest

from mercator_design import shipped
from mercator_design.fsm import parse
from mercator_design.missions.mission import load_mission
from mercator_design.sim.doubts import doubts, doubts_of_floor, doubts_of_model
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import Gaussian, Neighbours
from tests.sim.worlds import mission

MERCATOR, EPUCK = load_robot_model("mercator"), load_robot_model("epuck")
SEEKER = parse("--nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 6 --p0x0 0.5 --l0x0 2 --s1 1")


def painted(*colours, background="gray", dynamics="[]"):
    zones = ", ".join(
        f"{{name: z{k}, shape: disc, center: [0, 0], radius: 0.3, color: {colour}}}" for k, colour in enumerate(colours)
    )
    return mission(robots=2, floor=f"{{background: {background}, zones: [{zones}], dynamics: {dynamics}}}")


def apart(model, *colours, **floor):
    """The colours that are named as one."""
    found = doubts_of_floor(painted(*colours, **floor), model)
    return [text.partition(" tells ")[2].removesuffix(" apart") for text in found]


@pytest.mark.parametrize("name", shipped.missions())
def test_there_are_none_of_shipped_missions(name):
    loaded = load_mission(name)
    model = load_robot_model(loaded.robot_model)
    assert [*doubts_of_model(model), *doubts_of_floor(loaded, model)] == []


@pytest.mark.parametrize("name", shipped.robot_models())
def test_there_are_none_of_shipped_robot_models(name):
    assert list(doubts_of_model(load_robot_model(name))) == []


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
        (text,) = doubts_of_floor(load_mission("color_aggregation"), EPUCK)
        assert "gray, green, red" in text

    def test_flavours_have_their_own_conditions(self):
        text = list(doubts(painted("red", "green"), MERCATOR, "chocolate"))
        assert text == ["mission:8: floor: no condition of robot mercator tells gray, green apart"]
        assert list(doubts(painted("red", "green"), MERCATOR, "watermelon")) == []

    def test_a_robot_without_ground_sensors_is_not_asked(self):
        assert apart(dataclasses.replace(EPUCK, ground=None), "red") == []


class TestModules:
    def test_a_condition_on_colours_never_holds_without_them(self):
        (text,) = doubts(painted("black"), EPUCK, "watermelon", SEEKER)
        assert text == (
            "state 0, transition 0: floor colour never fires: robot epuck sees only how bright the ground is"
        )
        assert list(doubts(painted("red"), MERCATOR, "watermelon", SEEKER)) == []


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
        found = list(doubts_of_model(dataclasses.replace(MERCATOR, neighbours=camera)))
        assert bool(found) is told
        assert all("neighbours.range: 0.76 m changes nothing" in text and "within 0.75 m" in text for text in found)
