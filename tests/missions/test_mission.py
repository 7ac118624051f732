"""Mission files: the shipped ones, what must fit together, and how a name finds its file."""

import dataclasses
import functools
import pickle
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image as Pillow

from mercator_design import seeds
from mercator_design.config import shipped
from mercator_design.config.colours import COLOURS
from mercator_design.config.schema import FieldError
from mercator_design.config.writing import dump
from mercator_design.errors import MissionError, excerpt
from mercator_design.missions.arena import Arena, Box, Light, Polygon, RegularPolygon
from mercator_design.missions.floor import (
    Disc,
    Dynamics,
    Floor,
    HalfPlane,
    PolygonZone,
    Rectangle,
    Ring,
    Tiles,
)
from mercator_design.missions.mission import (
    Mission,
    Objective,
    load_mission,
    parse_mission,
)
from mercator_design.missions.placement import (
    DiscPlacement,
    DrawnPlacement,
    FixedPlacement,
    HalfPlaneLimit,
    RectanglePlacement,
    candidates,
)
from mercator_design.missions.trace import Trace, every_nth
from mercator_design.missions.walls import walls_above
from mercator_design.sim.simulate import Simulator
from tests.fsm.strategies import OF_NAME, WORD

SHIPPED = shipped.missions()
shipped_mission = functools.cache(load_mission)
TEXT = SHIPPED["aggregation"].read_text()


def instance(mission, seed=1, robots=None):
    """A trace of robots that jump about at random."""
    robots = robots or mission.robots
    rng = seeds.generator(seed, "test")
    poses = rng.uniform(-1.2, 1.2, (mission.cycles + 1, robots, 3))
    return Trace(
        poses=poses,
        states=np.zeros((mission.cycles, robots), dtype=np.int8),
        floor=mission.floor.realise(rng),
        zone_rows=mission.floor.zone_rows(),
        control_period=mission.control_period,
        measure=lambda _, every=1: poses[1:][every_nth(mission.cycles, every), :, np.newaxis, :2] + 0.5,  # a beam each
        walls=walls_above(mission.arena, 0.154),
    )


def test_the_missions_of_the_paper_are_shipped():
    assert {"aggregation", "color_aggregation", "grid_exploration", "foraging", "aac"} <= set(SHIPPED)


@pytest.mark.parametrize("name", SHIPPED)
def test_british_and_american_spelling_are_read_alike(name):
    text = SHIPPED[name].read_text()
    pairs = (("color", "colour"), ("gray", "grey"), ("center", "centre"), ("imise", "imize"))
    for american, british in pairs:
        text = re.sub(rf"(?<![/\w]){american}|(?<=_){american}|{american}(?=s?:)|(?<=min|max){american}", british, text)
    other, mission = parse_mission(text, name=name, folder=SHIPPED[name].parent), shipped_mission(name)
    assert text != SHIPPED[name].read_text()
    described = {"description": mission.description, "source": mission.source}
    assert dataclasses.replace(other, **described).digest == mission.digest
    assert dump(dataclasses.replace(other, **described)) == dump(mission)


@pytest.mark.parametrize("name", SHIPPED)
class TestShipped:
    def test_it_says_what_it_is(self, name):
        mission = shipped_mission(name)
        assert mission.name == name
        assert mission.description
        assert mission.source
        assert SHIPPED[name].read_text().startswith("# ")

    def test_its_resolved_text_is_the_same_mission(self, name):
        mission = shipped_mission(name)
        assert parse_mission(dump(mission)) == mission

    @pytest.mark.thorough
    def test_a_trace_gets_a_finite_score(self, name):
        mission = shipped_mission(name)
        trace = instance(mission)
        assert all(np.isfinite(one(trace)) for one in mission.all_objectives)

    def test_robots_can_start(self, name):
        mission = shipped_mission(name)
        rng = seeds.generator(1, "placement")
        poses = np.vstack([candidates(mission.placement, rng, robot, 1) for robot in range(mission.robots)])
        assert np.isfinite(poses).all()

    def test_it_travels_to_workers(self, name):
        mission = shipped_mission(name)
        assert pickle.loads(pickle.dumps(mission)) == mission  # noqa: S301 - our own  # noqa: S301 - our own


class TestSettingsOfTheOriginals:
    """As in the ARGoS missions for Mercator (argos3-rvr, experiments-loop-functions)."""

    @pytest.mark.parametrize("name", ["aggregation", "color_aggregation", "grid_exploration", "foraging", "aac"])
    def test_three_robots_for_two_minutes_in_the_dodecagon(self, name):
        mission = load_mission(name)
        assert (mission.robots, mission.cycles, mission.control_period) == (3, 1200, 0.1)
        assert mission.arena == Arena(walls=RegularPolygon(sides=12, apothem=1.226))
        assert mission.placement == DiscPlacement(radius=1.2)

    def test_scores_of_hand_drawn_traces(self):
        """Everybody at the origin, or at a place that counts, all the time."""

        def score(name, *place):
            mission = load_mission(name)
            trace = instance(mission)
            poses = np.tile([*place, 0.0], (*trace.poses.shape[:2], 1))
            return mission.objective(dataclasses.replace(trace, poses=poses))

        assert score("aggregation", 0.0, 0.5) == 3.0
        assert score("aggregation", 0.0, 0.501) == 0.0
        assert score("aac", 0.0, 0.6) == 3600.0
        assert score("aac", 0.0, -0.6) == 0.0
        assert score("grid_exploration", 9.0, 9.0) == 719_400.0
        assert score("foraging", 0.0, 0.0) == 0.0

    def test_a_colour_counts_where_it_lies(self):
        mission = load_mission("color_aggregation")
        trace = instance(mission)
        assert len(trace.floor.zones) == 12
        best = [row[1:3] for row in trace.floor.zones if tuple(row[6:]) == COLOURS["yellow"]]
        assert len(best) == 4
        poses = np.zeros_like(trace.poses)
        poses[-1, :, :2] = best[:3]
        assert mission.objective(dataclasses.replace(trace, poses=poses)) == 6.0

    def test_foraging_trips(self):
        mission = load_mission("foraging", ["duration=0.4"])
        trace = instance(mission)
        poses = np.zeros_like(trace.poses)
        poses[:, 0, :2] = [[0, 0], [-0.6, 0], [0, -0.6], [0.75, 0.25], [0.1, -1]]
        poses[:, 1, :2] = [[0, 0], [-0.4, 0], [0, -0.6], [0.75, 0.26], [0.1, -1]]
        assert mission.objective(dataclasses.replace(trace, poses=poses)) == 2.0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("radius: 0.5", "raduis: 0.5", "m:25: floor.zones[0].raduis: unknown key; did you mean 'radius'?"),
        ("schema: 1", "schema: 2", 'm:4: schema: expected 1, found "2"'),
        ("schema: 1", "", "schema: missing key; expected 1"),
        ("robots: 3", "robots: 0", "robots: expected a whole number >= 1 and <= 1000"),
        ("robots: 3", "robots: 1001", "robots: expected a whole number >= 1 and <= 1000"),
        (
            "duration: 120",
            "duration: 120.05",
            "m:10: duration: expected a whole number of control periods (0",
        ),
        ("duration: 120", "duration: 0.04", "duration: expected a whole number of control periods"),
        ("duration: 120", "duration: 0", "duration: expected a number > 0"),
        ("control_period: 0.1", "control_period: 0", "control_period: expected a number >= 0.001"),
        ("[spot]", "[spto]", "m:35: objective.zones[0]: no zone is called 'spto'; did you mean 'spot'?"),
        ("[spot]", "[]", "objective.zones: expected a list of at least 1"),
        ("name: spot ", "name: here ", "no zone is called 'spot'; known: here"),
        ("when: end", "when: ned", "objective.when: expected one of end, always"),
        ("when: end", "wen: end", "objective.wen: unknown key; did you mean 'when'?"),
        ("maximise", "maximum", "maximise, minimise, found \"maximum\"; did you mean 'maximise'?"),
        ("robots_in_zone", "robots_in_zones", "did you mean 'robots_in_zone'?"),
        ("  radius: 1.2", "  center: [5, 0]\n  radius: 1.2", "m:31: duplicate key 'center'"),
        ("  radius: 1.2", "  radius: -1.2", "placement.radius: expected a number > 0"),
        ("color: black", "color: blak", "floor.zones[0].color: expected one of black, white, gray"),
        ("sides: 12", "sides: 2", "arena.walls.sides: expected a whole number >= 3 and <= 360"),
        ("apothem: 1.226", "apothem: 1e9", "arena.walls.apothem: expected a number > 0 and <= 1000"),
    ],
)
def test_a_mistake_in_a_mission(old, new, message):
    assert old in TEXT
    with pytest.raises(MissionError, match=re.escape(message)):
        parse_mission(TEXT.replace(old, new, 1), name="m")


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("robbots=20", "--set robbots=20: robbots: unknown key; did you mean 'robots'?"),
        (
            "placement.center=[5, 0]",
            "--set placement.center=[5, 0]: placement.center: lies outside the walls",
        ),
        ("placement={shape: poses, poses: [[0, 0, 0]]}", "placement.poses: expected a pose for each of 3"),
        ("placement.waiting=[[0, 0, 0]]", "placement.waiting: expected a pose for each of 3 robots"),
        ("placement.half_plane={point: [0, 5], normal: [0, 1]}", "placement.half_plane: lies outside the walls"),
        ("placement.uniform_in=angle", "placement.uniform_in: expected one of area, radius"),
        ("placement={shape: one_of, regions: []}", "placement.regions: expected a list of at least 1"),
        ("placement={shape: poses, poses: [[0,0,0], [2,0,0], [1,0,0]]}", "placement.poses[1]: lies outside"),
        ("arena.walls={shape: polygon, vertices: [[0,0],[1,1],[1,0],[0,1]]}", "walls.vertices[2]: the wall"),
        ("arena.walls={shape: polygon, vertices: [[0,0],[1,1]]}", "walls.vertices: expected a list of at"),
        ("floor.image={path: nowhere.png, size: [1, 1]}", "floor.image.path: no such file"),
        (
            "duration=86400",
            "duration: expected at most 10000000 cycles of robots, found 1000 robots x 864000",
        ),
        ("arena.obstacles=[{center: [5, 0], size: [1, 1]}]", "arena.obstacles[0].center: lies outside the walls"),
        ("floor.zones=[]", "objective.zones[0]: no zone is called 'spot'; known: none"),
        ("objective={name: color_value, direction: maximise, values: {}}", "objective.values: expected a"),
        ("objective={name: color_value, direction: maximise, values: {rde: 1}}", "did you mean 'red'?"),
        ("objective={name: cell_age, direction: minimise, side: 1, cells: 0}", "objective.cells: expected a"),
        ("name=../../etc", "name: expected text: letters, digits"),
        ("name='a\u202eb'", "name: expected text: letters, digits"),
    ],
)
def test_a_mistake_on_the_command_line(override, message):
    first = ["robots=1000"] if "duration" in override else []
    with pytest.raises(MissionError, match=re.escape(message)):
        load_mission("aggregation", [*first, override])


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("robots=2", "robots=3"),
        ("robots=2", " robots = 2"),
        ("floor.zones[0].color=red", "floor.zones[0].colour=blue"),
        ("floor.zones[0].radius=0.4", "floor.zones[00].radius=0.3"),
        (
            "floor.zones[0].radius=0.4",
            "floor.zones=[{name: spot, shape: disc, center: [0, 0], radius: 0.5, color: red}]",
        ),
        ("floor={background: white}", "floor.zones=[]"),
    ],
)
def test_an_override_is_given_once(first, second):
    """The one that was not obeyed would be missing without a word."""
    expected = f"--set {excerpt(second)}: sets what --set {excerpt(first)} sets, too; give one of them"
    with pytest.raises(MissionError, match=re.escape(expected)):
        load_mission("aggregation", [first, "duration=3", second])


def test_overrides():
    mission = load_mission("aggregation", ["robots=20", "floor.zones[0].radius=0.3", "objective.when=always"])
    assert mission.robots == 20
    assert mission.floor.zones[0].radius == 0.3
    assert mission.objective.parameters == {"zones": ("spot",), "when": "always", "share": False}


def test_direction():
    maximise, minimise = load_mission("aggregation"), load_mission("grid_exploration")
    assert (maximise.cost(2.0), minimise.cost(2.0)) == (-2.0, 2.0)
    assert maximise.score(maximise.cost(2.0)) == 2.0
    assert minimise.score(minimise.cost(2.0)) == 2.0
    assert str(maximise.score(maximise.cost(0.0))) == "0.0"


class TestFinding:
    def test_a_path(self, tmp_path, monkeypatch):
        (tmp_path / "my mission (1).yaml").write_text(TEXT)
        mission = load_mission(tmp_path / "my mission (1).yaml")
        assert mission.name == "my mission _1_"
        assert parse_mission(dump(mission)) == mission
        monkeypatch.chdir(tmp_path)
        assert load_mission("my mission (1).yaml") == mission
        (tmp_path / "plain").write_text(TEXT)
        assert load_mission("plain").name == "plain"

    def test_a_folder_of_the_same_name_does_not_hide_a_shipped_mission(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "aggregation").mkdir()
        assert load_mission("aggregation").name == "aggregation"

    @pytest.mark.parametrize(
        ("name", "message"),
        [
            ("agregation", "agregation: no such mission; did you mean 'aggregation'?"),
            ("zzz", "zzz: no such mission; shipped are: aac, "),
            ("", "no such mission; shipped are"),
            ("x" * 3_000, "no such mission"),
            ("zzz.yaml", "zzz.yaml: no such file"),
            ("./aggregation", "aggregation: no such file"),
            ("..", "no such mission"),
        ],
    )
    def test_a_name_that_leads_nowhere(self, name, message):
        with pytest.raises(MissionError, match=re.escape(message)):
            load_mission(name)

    def test_the_folder_in_an_installed_package_comes_first(self, tmp_path, monkeypatch):
        monkeypatch.setattr(shipped, "PACKAGE", tmp_path / "package")
        (tmp_path / "scenarios").mkdir()
        (tmp_path / "scenarios" / "beside.yaml").write_text(TEXT)
        assert list(shipped.missions()) == ["beside"]
        (tmp_path / "package" / "scenarios").mkdir(parents=True)
        (tmp_path / "package" / "scenarios" / "only.yaml").write_text(TEXT)
        assert load_mission("only").name == "only"

    def test_a_robot_model_is_a_name_or_sought_beside_the_mission(self, tmp_path):
        for written, found in (
            ("mercator", "mercator"),
            ("my.yaml", str(tmp_path / "my.yaml")),
            ("../other/my.yaml", str(tmp_path / "../other/my.yaml")),
        ):
            (tmp_path / "m.yaml").write_text(TEXT.replace("robot_model: mercator", f"robot_model: {written}"))
            assert load_mission(tmp_path / "m.yaml").robot_model == found

    def test_a_picture_is_sought_beside_the_mission_and_kept(self, tmp_path):
        Pillow.new("RGB", (2, 2), (9, 8, 7)).save(tmp_path / "floor.png")
        (tmp_path / "m.yaml").write_text(TEXT.replace("floor:", "floor:\n  image: {path: floor.png, size: [2, 2]}"))
        mission = load_mission(tmp_path / "m.yaml")
        assert mission.floor.image.path == str(tmp_path / "floor.png")
        assert parse_mission(dump(mission), folder=tmp_path.parent) == mission
        (tmp_path / "floor.png").unlink()
        there = pickle.loads(pickle.dumps(mission))  # noqa: S301 - our own
        assert there.floor.realise(seeds.generator(1, "floor")).image[0, 0].tolist() == [9, 8, 7]


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("robot_in_zone", {}),
        ("cell_age", {"side": 1.0}),
        ("cell_age", {"side": 1.0, "cells": 2, "zones": ()}),
    ],
)
def test_an_objective_made_in_python_is_checked_too(name, parameters):
    with pytest.raises(FieldError):
        Objective(name=name, direction="maximise", parameters=parameters)


_point = st.tuples(st.floats(-5, 5), st.floats(-5, 5))
_within = st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))  # of any walls below
_size = st.floats(0.01, 5)
_color = st.sampled_from(sorted(COLOURS)) | st.tuples(*[st.integers(0, 255)] * 3)
_walls = st.builds(RegularPolygon, sides=st.integers(3, 360), apothem=st.floats(1, 9), rotation=st.floats(-9, 9))
_zones = st.lists(
    st.builds(Disc, center=_point, radius=_size, color=_color)
    | st.builds(Rectangle, center=_point, size=st.tuples(_size, _size), angle=st.floats(-9, 9), color=_color)
    | st.builds(HalfPlane, point=_point, normal=st.tuples(_size, st.floats(-1, 1)), color=_color)
    | st.builds(Ring, center=_point, radius=st.floats(1, 2), inner_radius=st.floats(0.1, 0.9), color=_color)
    | st.just(PolygonZone(vertices=((0.0, 0.0), (1.0, 0.25), (0.5, 3.0)), color="red"))
    | st.just(Tiles(centers=((1.0, 0.0), (0.5, 2e-17)), size=0.3, colors={"red": 1, "blue": 1}, name="tiles")),
    max_size=3,
    unique_by=lambda zone: zone.name or id(zone),
)
CHANGING = Floor(
    zones=(Disc(center=(0.0, 0.0), radius=0.5, color="red", name="spot"),),
    dynamics=(
        Dynamics(name="visited", parameters={"zones": ("spot",), "color": (1, 2, 3), "lasts": 2.5}),
        Dynamics(
            name="schedule",
            parameters={"zones": ("spot",), "times": (1.0, 2.0), "colors": ("red", (4, 5, 6)), "every": None},
        ),
    ),
)
_heading = st.just("uniform") | st.floats(-9, 9)
_missions = st.builds(
    Mission,
    schema=st.just(1),
    name=st.builds("{}{}".format, WORD, st.text(OF_NAME, max_size=9)),
    description=st.sampled_from(["", "two\nlines\n", "a: b # c", "no"]),
    robots=st.integers(1, 3),
    robot_model=st.sampled_from(["mercator", "/robots/mine.yaml"]),
    duration=st.sampled_from([0.5, 120.0, 7.5]),
    control_period=st.sampled_from([0.1, 0.5, 0.05]),
    arena=st.builds(
        Arena,
        walls=_walls | st.just(Polygon(vertices=((-1.0, -1.0), (1.0, -1.0), (0.0, 2.5)))),
        obstacles=st.lists(st.builds(Box, center=_within, size=st.tuples(_size, _size)), max_size=2).map(tuple),
    ),
    floor=st.builds(Floor, background=_color, zones=_zones.map(tuple)) | st.just(CHANGING),
    lights=st.lists(st.builds(Light, position=st.tuples(*[_size] * 3), intensity=_size), max_size=2).map(tuple),
    placement=st.builds(DiscPlacement, radius=st.floats(0.1, 2), heading=_heading)
    | st.builds(RectanglePlacement, size=st.tuples(_size, _size), heading=_heading)
    | st.builds(
        DiscPlacement,
        radius=st.just(1.0),
        inner_radius=st.floats(0, 0.9),
        uniform_in=st.sampled_from(["area", "radius"]),
        half_plane=st.none() | st.builds(HalfPlaneLimit, point=_within, normal=st.tuples(_size, _size)),
        waiting=st.sampled_from([(), ((0.0, -0.4, 0.0), (0.4, -0.6, 0.0), (0.4, -0.6, 1.5))]),
    )
    | st.builds(
        DrawnPlacement,
        regions=st.lists(
            st.builds(DiscPlacement, radius=st.floats(0.1, 1))
            | st.builds(RectanglePlacement, size=st.just((1.0, 2.0))),
            min_size=1,
            max_size=3,
        ).map(tuple),
        heading=_heading,
    )
    | st.just(FixedPlacement(poses=((0.0, 0.0, 1e-9), (0.5, 0.0, 3.0), (-0.5, 0.0, 3.0)))),
    objective=st.builds(
        Objective,
        name=st.just("color_value"),
        direction=st.sampled_from(["maximise", "minimise"]),
        parameters=st.fixed_dictionaries(
            {
                "values": st.dictionaries(st.sampled_from(sorted(COLOURS)), st.floats(-9, 9), min_size=1).filter(
                    lambda values: any(values.values())
                ),
                "when": st.sampled_from(["end", "always"]),
            }
        ),
    ),
)


class TestPlaces:
    """What is found wrong after a file was read still has file, line and key."""

    TEXT = """schema: 1
robots: 2
duration: 1
robot_model: mercator
arena:
  walls: {shape: polygon, vertices: [[-1, -1], [1, -1], [1, 1], [-1, 1]]}
placement:
  shape: poses
  poses:
    - [0, 0, 0]
    - [0.5, 0.5, 0]
objective:
  {name: pair_distance, direction: minimise}
"""

    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            ("robots: 2", "robots: 600", "m.yaml:2: robots: the robots do not fit: 600 of them need"),
            ("[0.5, 0.5, 0]", "[0.1, 0.1, 0]", r"m.yaml:11: placement.poses\[1\]: a robot there touches"),
            ("mercator", "mercatr", "m.yaml:4: robot_model: mercatr: no such robot model; did you mean 'mercator'"),
            ("mercator", "./r.yaml", r"m.yaml:4: robot_model: \S+r.yaml:1: body.mass: expected a number"),
            ("mercator", "./none.yaml", r"m.yaml:4: robot_model: \S+none.yaml: no such file"),
            (
                "[1, 1], [-1, 1]",
                "[1, 1], [-0.699, 1], [-0.7, -0.9], [-0.701, 1], [-1, 1]",
                "m.yaml:6: arena.walls: the wall",
            ),
            ("mercator", "./s.yaml", r"s.yaml:2: physics.time_step: a corner travels"),
            ("mercator", "./v.yaml", r"v.yaml:2: vary: body.mass: expected a number >= 0.001 and <= 1000 \[kg\]"),
        ],
    )
    def test_in_a_mission_or_its_robot(self, tmp_path, old, new, message):
        (tmp_path / "r.yaml").write_text("{base: mercator, body: {mass: x}}\n")
        (tmp_path / "s.yaml").write_text("base: mercator\nphysics: {time_step: 0.1}\ndrive: {maximum_speed: 9}\n")
        (tmp_path / "v.yaml").write_text("base: mercator\nvary: {body.mass: [0, 1]}\n")
        text = self.TEXT.replace("  poses:\n", "  poses:\n" + "    - [0, 0, 0]\n" * 598 * ("600" in new))
        (tmp_path / "m.yaml").write_text(text.replace(old, new))
        with pytest.raises(MissionError, match=message):
            Simulator(load_mission(tmp_path / "m.yaml")).instance(1)

    def test_of_an_override(self, tmp_path):
        (tmp_path / "m.yaml").write_text(self.TEXT)
        with pytest.raises(MissionError, match=r"^--set robot_model=x: robot_model: x: no such robot model"):
            Simulator(load_mission(tmp_path / "m.yaml", ["robot_model=x"]))

    def test_of_a_mission_made_in_python(self):
        mission = dataclasses.replace(parse_mission(self.TEXT), tree=None, robot_model="x")
        with pytest.raises(MissionError, match=r"^mission mission: robot_model: x: no such robot model"):
            Simulator(mission)

    def test_a_copy_keeps_its_place(self):
        changed = dataclasses.replace(parse_mission(self.TEXT), duration=2.0)
        mission = pickle.loads(pickle.dumps(changed))  # noqa: S301 - our own
        assert mission.where("placement.poses[1]") == "mission:11: placement.poses[1]"
        assert mission.where("placement.radius") == "mission:7: placement.radius"

    def test_all_that_is_wrong_with_one_part_is_reported(self):
        text = self.TEXT + (
            "floor:\n  zones: [{name: a, shape: disc, center: [0, 0], radius: 1, color: red}]\n"
            "  dynamics:\n"
            "    - {name: schedule, zones: [a], times: [2, 1], colors: [red]}\n"
            "    - {name: visited, zones: [b], color: red}\n"
        )
        with pytest.raises(MissionError) as caught:
            parse_mission(text)
        assert [message.split(": ")[1] for message in caught.value.messages] == [
            "floor.dynamics[0].colors",
            "floor.dynamics[0].times",
            "floor.dynamics[1].zones[0]",
        ]

    def test_all_that_does_not_fit_together_is_reported_at_once(self):
        text = self.TEXT.replace("duration: 1", "duration: 1.05").replace("[0.5, 0.5, 0]", "[5, 5, 0]")
        text = text.replace("{name: pair_distance", "{name: robots_in_zone, zones: [a, b]")
        text += "lights: [{position: [0, 0, 1], seen_by: [0, 7]}]\n"
        with pytest.raises(MissionError) as caught:
            parse_mission(text)
        assert [message.partition(": ")[2].partition(": ")[0] for message in caught.value.messages] == [
            "duration",
            "placement.poses[1]",
            "objective.zones[0]",
            "objective.zones[1]",
            "lights[0].seen_by[1]",
        ]


@pytest.mark.parametrize(
    ("objective", "message"),
    [
        (
            "name: seen_area, side: 1, cells: 2000",
            r"m:\d+: objective.cells: expected cells of at least 0.001 m",
        ),
        ("name: trips, sources: [spot], nests: [spot]", r"m:\d+: objective.nests\[0\]: 'spot' is a source too"),
        ("name: colour_value, values: {black: 0, red: 0}", r"m:\d+: objective.values: expected one that is not 0"),
        ("name: zone_value, values: {spot: 0}", r"m:\d+: objective.values: expected one that is not 0"),
        ("name: zone_value, values: {}", r"m:\d+: objective.values: expected a mapping of keys of at least 1"),
        (
            "name: zone_value, values: {spto: 2}",
            r"m:\d+: objective.values.spto: no zone is called 'spto'; did you mean",
        ),
        ("name: zone_value, values: {spot: 2e6}", r"m:\d+: objective.values.spot: expected a number >= -1"),
        ("name: zone_difference, zones: [spot]", r"m:\d+: objective.zones: expected a list of at least 2"),
        ("name: robots_evenly_in_zones, zones: [spot]", r"m:\d+: objective.zones: expected a list of at least 2"),
        (
            "name: trips, sources: [spot], nests: [ring], values: {ring: 2}",
            r"m:\d+: objective.values.ring: 'ring' is not among the sources",
        ),
        (
            "name: trips, sources: [spot], nests: [ring], values: {spot: 0}",
            r"m:\d+: objective.values: expected a source whose value is not 0",
        ),
    ],
)
def test_parameters_of_an_objective_are_checked_when_it_is_read(objective, message):
    text = TEXT.partition("objective:")[0] + f"objective: {{{objective}, direction: maximise}}\n"
    with pytest.raises(MissionError, match=message):
        parse_mission(text, name="m")


@pytest.mark.parametrize("name", ["foraging", "color_aggregation", "gianduja_decision"])
def test_workers_receive_the_same_mission(name):
    mission = load_mission(name)
    assert pickle.loads(pickle.dumps(mission)) == mission  # noqa: S301 - our own


@given(_missions)
def test_any_mission_is_read_back_as_it_was_written(mission):
    assert parse_mission(dump(mission), name="other") == mission
