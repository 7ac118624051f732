"""What of a mission cannot be, or is hardly meant: places that are out of reach, angles in degrees, equal scores."""

import dataclasses
import math
import re

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.cli import cli
from mercator_design.config import shipped
from mercator_design.designer import Designer
from mercator_design.errors import MissionError
from mercator_design.mission_sampler import sample_mission
from mercator_design.missions import plugins
from mercator_design.missions.floor import Disc, Floor, HalfPlane, PolygonZone, Rectangle, Ring
from mercator_design.missions.floor_kernels import zone_contains
from mercator_design.missions.mission import load_mission, parse_mission
from mercator_design.missions.trace import Trace
from mercator_design.missions.zone_distance import border_points, distance_to
from mercator_design.sim.checks.impossible import angle_warnings, mission_warnings
from mercator_design.sim.checks.reach import reach_of
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import LightRing
from mercator_design.sim.simulate import Simulator
from tests.tiers import some

MERCATOR, EPUCK = load_robot_model("mercator"), load_robot_model("epuck")

ROOMS = """schema: 1
robots: 3
duration: 20
arena:
  walls: {shape: polygon, vertices: [[-2, -1], [2, -1], [2, 1], [-2, 1]]}
  obstacles: [{center: [0.5, -0.55], size: [0.05, 0.9]}, {center: [0.5, 0.5], size: [0.05, 1.0]}]
floor:
  zones:
    - {name: nest, shape: disc, center: [-1.5, 0], radius: 0.3, color: black}
    - {name: source, shape: disc, center: [1.5, 0], radius: 0.3, color: white}
placement: {shape: rectangle, center: [-1, 0], size: [1.4, 1.4]}
objective: {name: robots_in_zone, zones: [nest], when: always, direction: maximise}
"""

LEFT_ROOM = [
    "arena.walls.vertices=[[-2, -1], [-0.2, -1], [-0.2, 1], [-2, 1]]",
    "arena.obstacles=[]",
    "floor.zones=[]",
]


def told(*overrides, text=ROOMS, model=MERCATOR):
    mission = parse_mission(text, name="m.yaml", overrides=overrides)
    return [(warning.message, warning.is_impossible) for warning in mission_warnings(mission, model)]


def opened(width):
    """The rooms with a door of this width [m] between them."""
    wall = (2.0 - width) / 2.0
    y = (1.0 + width / 2.0) / 2.0
    return (
        f"arena.obstacles=[{{center: [0.5, {-y}], size: [0.05, {wall}]}}, {{center: [0.5, {y}], size: [0.05, {wall}]}}]"
    )


@pytest.mark.swept
@pytest.mark.parametrize("name", some(shipped.missions(), 6))
def test_shipped_missions_can_be(name):
    mission = load_mission(name)
    assert mission_warnings(mission, load_robot_model(mission.robot_model)) == []


@pytest.mark.swept
@pytest.mark.parametrize("kind", some(["foraging", "homing", "aggregation-xor"], 1))
def test_random_missions_can_be(kind):
    for number in range(1, 6):
        mission = sample_mission(kind, seed=3, number=number)
        assert mission_warnings(mission, load_robot_model(mission.robot_model)) == []


class TestReach:
    NO_WAY = (
        "m.yaml:10: floor.zones[1]: no robot can reach zone 'source': from where they start, there is no way for the "
        "centre of a robot that is 0.286 m wide",
        False,
    )

    @pytest.mark.parametrize("width", [0.02, 0.1, 0.2])
    def test_a_door_that_is_too_narrow(self, width):
        assert told(opened(width)) == [self.NO_WAY]

    @pytest.mark.parametrize("width", [0.286, 0.29, 0.5])
    def test_a_door_that_is_wide_enough(self, width):
        """As wide as the robot, exactly, is too: what can be reached is never said to be out of reach."""
        assert told(opened(width)) == []

    def test_a_smaller_robot_comes_through(self):
        assert told(model=EPUCK) == []
        small = dataclasses.replace(MERCATOR, vary={"body.width": (0.05, 0.286)})
        assert told(model=small) == []

    @pytest.mark.parametrize(
        "placement",
        [
            "{shape: poses, poses: [[-1, 0, 0], [-1, 0.5, 0], [1, 0, 0]]}",
            "{shape: one_of, regions: [{shape: disc, center: [-1, 0], radius: 0.5}, "
            "{shape: disc, center: [1, 0], radius: 1e-6}]}",
            "{shape: disc, radius: 2}",
        ],
    )
    def test_one_robot_that_starts_there_is_enough(self, placement):
        assert told(f"placement={placement}") == []

    def test_a_limit_keeps_robots_on_one_side(self):
        assert told("placement={shape: disc, radius: 2, half_plane: {point: [0, 0], normal: [-1, 0]}}") == [self.NO_WAY]

    def test_a_zone_at_the_wall_that_centres_do_not_come_to(self):
        strip = "floor.zones[1]={shape: rectangle, center: [0, 0.98], size: [3, 0.03], color: white}"
        (found,) = told(opened(1.0), strip)
        assert "no robot can reach this zone" in found[0]
        assert told(opened(1.0), strip.replace("0.03", "0.3")) == []

    def test_a_zone_smaller_than_a_cell_is_found(self):
        assert told(opened(1.0), "floor.zones[1].radius=0.0001") == []
        assert told(opened(1.0), "floor.zones[0].radius=0.0001") == []

    def test_robots_too_small_for_their_arena_are_let_be(self):
        far = "arena.walls={shape: regular_polygon, sides: 4, apothem: 100}"
        mission = parse_mission(ROOMS, overrides=[far])
        assert reach_of(mission, MERCATOR) is None
        assert told(far) == []

    def test_zones_that_a_plugin_may_move_are_let_be(self, monkeypatch):
        monkeypatch.setattr("mercator_design.sim.checks.impossible.is_ours", lambda _: False)
        assert told("floor.dynamics=[{name: visited, zones: [nest], color: red}]") == []


class TestWalls:
    @pytest.mark.parametrize(("zone", "is_impossible"), [(0, True), (1, False)])
    def test_a_zone_beyond_them(self, zone, is_impossible):
        found = told(opened(1.0), f"floor.zones[{zone}].center=[5, 0]")
        assert found[0][1] is is_impossible
        assert f"m.yaml:{9 + zone}: floor.zones[{zone}]: zone" in found[0][0]
        assert "lies outside the walls" in found[0][0]

    def test_half_planes_and_what_ends_at_a_wall_are_let_be(self):
        assert told(opened(1.0), "floor.zones[1]={shape: half_plane, point: [1, 0], normal: [1, 0], color: red}") == []
        assert told(opened(1.0), "floor.zones[0].center=[-1.72, 0]") == []
        (found,) = told(opened(1.0), "floor.zones[1]={shape: half_plane, point: [9, 0], normal: [1, 0], color: red}")
        assert found[0].startswith("--set floor.zones[1]={shape: half_plane, point: [9")
        assert found[0].endswith(": floor.zones[1]: this zone lies outside the walls")

    @pytest.mark.parametrize(
        ("zone", "x", "is_told"), [(0, -1.75, False), (0, -1.9, True), (1, 1.9, False), (1, 2.1, True)]
    )
    def test_a_zone_across_them(self, zone, x, is_told):
        """More strictly if the objective counts on it; others are often painted beyond a wall."""
        found = told(opened(1.0), f"floor.zones[{zone}].center=[{x}, 0]")
        assert bool(found) is is_told
        assert all("% of zone" in message and not impossible for message, impossible in found)


class TestAngles:
    def test_of_a_mission(self):
        found = told(
            "arena.obstacles[0].angle=90",
            "placement={shape: poses, poses: [[-1, 0, 180], [-1, 0.5, 6.2], [1, 0, -6.2]]}",
            "objective={name: gate_crossings, width: 1, angle: -90, direction: maximise}",
        )
        places = ("arena.obstacles[0].angle", "placement.poses[0][2]", "objective.angle")
        assert len(found) == len(places)
        for (message, _), place in zip(found, places, strict=True):
            assert f": {place}: " in message
        assert "90 rad is more than a whole turn; angles are in radians, 90 degrees are 1.571" in found[0][0]
        assert not any(impossible for _, impossible in found)

    @pytest.mark.parametrize("angle", [0.0, math.pi, -2.0 * math.pi, 2.0 * math.pi])
    def test_a_turn_is_none(self, angle):
        (found,) = told(f"arena.obstacles[0].angle={angle:.17f}")
        assert found == TestReach.NO_WAY or angle == 0.0

    @pytest.mark.parametrize(
        ("angle", "is_told"),
        [("5", True), ("-4.0", True), ("6", True), ("3", False), ("-1", False), ("4.5", False), ("5.0001", False)],
    )
    def test_small_degrees_are_told_where_they_are_whole_numbers_beyond_half_a_turn(self, angle, is_told):
        doors = opened(1.0).replace("size: [0.05", f"angle: {angle}, size: [0.05", 1)
        found = [message for message, _ in told(doors) if "angles are in radians" in message]
        assert len(found) == is_told
        if is_told:
            number = f"{float(angle):g}"
            what = f"{number} rad is more than half a turn, and a whole number; angles are in radians, {number} degrees"
            assert f": arena.obstacles[0].angle: {what} are " in found[0]

    def test_of_a_robot_model(self):
        ring = LightRing(angles=(0.0, 45.0), height=0.1)
        (found,) = angle_warnings(dataclasses.replace(MERCATOR, light=ring))
        assert found.message.startswith("robot model mercator: light.angles[1]: 45 rad is") or (
            ": light.angles[1]: 45 rad is" in found.message
        )

    @pytest.mark.parametrize("name", shipped.robot_models())
    def test_shipped_robot_models_have_none(self, name):
        assert list(angle_warnings(load_robot_model(name))) == []


class TestScores:
    SAME = "; so every score is the same, whatever the robots do"

    def test_of_zones_out_of_reach(self):
        """The cause is told once, with what follows."""
        assert told("objective.zones=[source]") == [(TestReach.NO_WAY[0] + self.SAME, True)]

    def test_trips_to_a_place_out_of_reach(self):
        found = told("objective={name: trips, sources: [source], nests: [nest], direction: maximise}")
        assert found == [(TestReach.NO_WAY[0] + self.SAME, True)]

    def test_zones_outside_the_walls(self):
        outside = "m.yaml:10: floor.zones[1]: zone 'source' lies outside the walls, and the objective counts on it"
        away = [opened(1.0), "floor.zones[1].center=[5, 0]"]
        ((message, is_impossible),) = told(*away, "objective.zones=[source]")
        assert (message, is_impossible) == (outside + self.SAME, True)
        assert told(*away, "objective.zones=[source, nest]") == [(outside, True)]

    def test_two_zones_out_of_reach_are_two_causes(self):
        found = told("floor.zones[0].center=[5, 0]", "objective.zones=[nest, source]")
        assert [impossible for _, impossible in found] == [True, True]
        assert all(message.endswith(self.SAME) for message, _ in found)

    def test_another_objective_on_a_zone_out_of_reach(self):
        shared = "objective={name: network_share, zones: [source], radius: 0.5, sight: 0.1, direction: maximise}"
        ((message, is_impossible),) = told(shared)
        assert message == (
            TestReach.NO_WAY[0] + "; so in 49 made-up experiments every score was the same, whatever the robots did"
        )
        assert not is_impossible

    def test_a_zone_that_is_everywhere(self):
        everywhere = "{name: nest, shape: half_plane, point: [-5, 0], normal: [1, 0], color: red}"
        (found,) = told(opened(1.0), f"floor.zones[0]={everywhere}")
        assert found[0].endswith("m.yaml:12: objective: every score is the same, whatever the robots do")
        assert found[1]
        assert told(opened(1.0), f"floor.zones[0]={everywhere.replace('-5', '-1.8')}") == []

    def test_a_robot_that_counts_the_same_in_and_outside_the_zones(self):
        same = "objective={name: zone_value, values: {nest: 2, source: 2}, outside: 2, direction: maximise}"
        (found,) = told(opened(1.0), same)
        assert found[0].endswith(": every score is the same, whatever the robots do")
        assert found[1]

    @pytest.mark.parametrize("objective", ["zone_difference", "robots_evenly_in_zones"])
    def test_zones_that_are_compared_but_out_of_reach(self, objective):
        """Of one that can be reached the score differs still."""
        call = f"objective={{name: {objective}, zones: [nest, source], direction: maximise}}"
        assert [impossible for _, impossible in told(call)] == [False]
        assert any(impossible for _, impossible in told(call, "floor.zones[0].center=[1.2, 0.5]"))

    def test_a_zone_outside_the_walls_that_has_a_value(self):
        call = "objective={name: zone_value, values: {nest: 2, source: -2}, direction: maximise}"
        ((message, is_impossible),) = told(opened(1.0), call, "floor.zones[0].center=[-5, 0]")
        assert message.endswith("floor.zones[0]: zone 'nest' lies outside the walls, and the objective counts on it")
        assert is_impossible

    def test_source_and_nest_in_one_place(self):
        trips = "objective={name: trips, sources: [source], nests: [nest], direction: maximise}"
        assert told(opened(1.0), trips) == []
        (shared,) = told(opened(1.0), trips, "floor.zones[1].center=[-1.5, 0]")
        words = "the nests are sources, too: a robot there is at a source, and brings nothing home"
        assert shared[0].endswith(f": objective.nests: {words}{self.SAME}")
        assert shared[1]
        (half,) = told(opened(1.0), trips, "floor.zones[1].center=[-1.2, 0]")
        assert "% of the nests are sources, too" in half[0]
        assert not half[1]

    @pytest.mark.parametrize(
        ("objective", "overrides"),
        [
            ("name: pair_distance", ["robots=1"]),
            ("name: nearest_distance", ["robots=1"]),
            ("name: network_diameter", ["robots=1"]),
            ("name: color_value, values: {red: 1}", []),
            (
                "name: cells_visited, side: 0.01, cells: 1",
                ["arena.walls.vertices=[[-2, -1], [-0.2, -1], [-0.2, 1], [-2, 1]]"],
            ),
            ("name: zones_in_color, zones: [nest], color: black", []),
            ("name: robots_where_told, signal: nest, places: {white: source}", []),
        ],
    )
    def test_of_other_objectives_is_reported_alone(self, objective, overrides):
        doors = (
            [opened(1.0)]
            if not any("walls" in each for each in overrides)
            else ["arena.obstacles=[]", "floor.zones=[]"]
        )
        found = told(*doors, *overrides, f"objective={{{objective}, direction: minimise}}")
        ((message, is_impossible),) = found
        assert message.endswith(": in 49 made-up experiments every score was the same, whatever the robots did")
        assert not is_impossible

    @pytest.mark.parametrize(
        "objective",
        [
            "name: pair_distance",
            "name: path_length",
            "name: color_value, values: {black: 1}",
            "name: robots_in_emptiest_zone, zones: [nest, source]",
            "name: robots_in_fullest_zone, zones: [nest, source], share: true",
            "name: robots_evenly_in_zones, zones: [nest, source], share: true",
            "name: zone_difference, zones: [nest, source]",
            "name: zone_value, values: {nest: 1, source: 1}, outside: -1",
            "name: zone_value, values: {nest: 0}, outside: -1",
            "name: trips, sources: [source], nests: [nest], values: {source: -1}",
            "name: stop_when_found, zones: [nest]",
            "name: gate_crossings, width: 0.02",
            "name: network_share, zones: [nest], radius: 2",
            "name: cell_age, side: 2, cells: 10",
        ],
    )
    def test_of_those_that_can_differ_nothing_is_reported(self, objective):
        assert told(opened(1.0), f"objective={{{objective}, direction: minimise}}") == []

    def test_a_signal_that_changes_late_counts(self):
        """The made-up experiments are as long as the mission's."""
        assert (
            told(
                opened(1.0),
                "floor.dynamics=[{name: schedule, zones: [nest], times: [15], colors: [white]}]",
                "objective={name: robots_where_told, signal: nest, places: {white: source}, direction: maximise}",
            )
            == []
        )

    def test_many_zones_that_must_all_have_robots(self):
        centres = [(x / 4.0, y / 4.0) for x in range(-6, 2) for y in (-2, -1, 0, 1)][:20]
        zones = ", ".join(
            f"{{name: z{k}, shape: disc, center: [{x}, {y}], radius: 0.05, color: red}}"
            for k, (x, y) in enumerate(centres)
        )
        names = ", ".join(f"z{k}" for k in range(20))
        emptiest = f"objective={{name: robots_in_emptiest_zone, zones: [{names}], direction: maximise}}"
        assert told(f"floor.zones=[{zones}]", "robots=20", emptiest, model=EPUCK) == []
        (found,) = told(f"floor.zones=[{zones}]", "robots=19", emptiest, model=EPUCK)
        assert found[1]

    def test_what_is_said_of_an_objective_is_so(self):
        """The score of one that is `by_zones` stays when robots move within the same zones."""
        draw = np.random.default_rng(1)
        calls = {
            "robots_in_zone": "zones: [nest, source]",
            "robots_in_fullest_zone": "zones: [nest, source]",
            "robots_in_emptiest_zone": "zones: [nest, source]",
            "robots_evenly_in_zones": "zones: [nest, source]",
            "trips": "sources: [source], nests: [nest], values: {source: -0.5}",
            "zone_difference": "zones: [nest, source], when: always",
            "zone_value": "values: {nest: 2, source: -1}, outside: 0.5, when: always",
        }
        assert {name for name, function in plugins.OBJECTIVES.items() if plugins.is_by_zones(function)} == set(calls)
        for name, parameters in calls.items():
            mission = parse_mission(ROOMS, overrides=[f"objective={{name: {name}, {parameters}, direction: maximise}}"])
            table, rows = mission.realise_floor(draw), mission.floor.zone_rows()
            which = draw.integers(3, size=(40, 5))
            scores = set()
            for _ in range(5):
                middle = np.array([[-1.5, 0.0], [1.5, 0.0], [0.0, 0.0]])[which]
                poses = np.dstack([middle + draw.uniform(-0.2, 0.2, middle.shape), draw.uniform(-3, 3, which.shape)])
                states = draw.integers(4, size=(39, 5)).astype(np.int8)
                trace = Trace(poses=poses, states=states, floor=table, zone_rows=rows, control_period=0.5)
                scores.add(mission.objective(trace))
            assert len(scores) == 1


class TestRefused:
    """What cannot be is refused by all that race, in one place: where a designer is made."""

    OUTSIDE = "floor.zones[0].center=[5, 0]"
    WHAT = "floor.zones[0]: zone 'spot' lies outside the walls, and the objective counts on it"

    def test_by_a_designer(self):
        simulator = Simulator(load_mission("aggregation", [self.OUTSIDE]))
        with pytest.raises(MissionError, match=re.escape(self.WHAT)):
            Designer(simulator, budget=100, seed=1)

    @pytest.mark.parametrize("verb", [("race", "--budget", "60"), ("export", "irace", "-o", "there")])
    def test_on_the_command_line(self, tmp_path, monkeypatch, verb):
        monkeypatch.chdir(tmp_path)
        text = shipped.missions()["aggregation"].read_text()
        (tmp_path / "m.yaml").write_text(
            text.replace("center: [0, 0]\n      radius: 0.5", "center: [5, 0]\n      radius: 1")
        )
        with pytest.raises(MissionError, match=re.escape(f"m.yaml:22: {self.WHAT}")):
            CliRunner().invoke(cli, [*verb, "m.yaml"], catch_exceptions=False)
        assert [each.name for each in tmp_path.iterdir()] == ["m.yaml"]

    def test_what_is_no_more_than_odd_is_a_warning_of_an_export(self, tmp_path):
        odd = ["--set", "placement.heading=90", "--budget", "60", "-o", str(tmp_path / "there")]
        done = CliRunner().invoke(cli, ["export", "irace", "aggregation", *odd])
        assert done.exit_code == 0, done.output
        assert "Warning: --set placement.heading=90: placement.heading: 90 rad is more than a whole turn" in done.output

    def test_when_a_race_is_resumed(self, tmp_path, monkeypatch):
        """As one that a version began which did not look."""
        folder = str(tmp_path / "run")
        mission = ["--set", "duration=1", "--set", self.OUTSIDE]
        with monkeypatch.context() as patch:
            patch.setattr(Simulator, "refuse_impossible", lambda _: None)
            begun = CliRunner().invoke(
                cli, ["race", "aggregation", *mission, "--budget", "30", "-o", folder, "-j", "1"]
            )
        assert begun.exit_code == 0, begun.output
        with pytest.raises(MissionError, match=re.escape(f"{folder}/mission.yaml:22: {self.WHAT}")):
            CliRunner().invoke(cli, ["race", "--resume", folder, "--budget", "60", "-j", "1"], catch_exceptions=False)


_point = st.tuples(st.floats(-2, 2), st.floats(-2, 2))
_size = st.floats(0.05, 2)


@given(
    st.one_of(
        st.builds(Disc, center=_point, radius=_size, color=st.just("red")),
        st.builds(Ring, center=_point, radius=st.floats(1, 2), inner_radius=st.floats(0.1, 0.9), color=st.just("red")),
        st.builds(Rectangle, center=_point, size=st.tuples(_size, _size), angle=st.floats(-4, 4), color=st.just("red")),
        st.builds(HalfPlane, point=_point, normal=st.tuples(st.floats(0.1, 1), st.floats(-1, 1)), color=st.just("red")),
        st.just(PolygonZone(vertices=((0.0, 0.0), (1.0, 0.25), (0.5, 1.0), (0.5, 0.5)), color="red")),
    ),
    st.integers(0, 10**6),
)
def test_distances_are_those_of_the_zones_that_sensors_see(zone, seed):
    """0 in the zone and nowhere else; and no point of the zone is nearer."""
    draw = np.random.default_rng(seed)
    table = Floor(zones=(zone,)).realise(draw)
    points = draw.uniform(-3, 3, (60, 2))
    distances = distance_to(table, 0, points)
    inside = np.array([zone_contains(table, 0, x, y) for x, y in points])
    assert (inside == (distances == 0.0))[abs(distances) > 1e-9].all()
    assert (distances[inside] < 1e-9).all()
    for point, distance in zip(points[~inside], distances[~inside], strict=True):
        away = draw.uniform(0, 2 * math.pi, 20)
        near = point + 0.99 * distance * np.column_stack([np.cos(away), np.sin(away)])
        assert not any(zone_contains(table, 0, x, y) for x, y in near)
    assert (distance_to(table, 0, border_points(table, 0)) < 1e-9).all()


class TestWallsThatLidarsLookOver:
    """Usual walls are 0.08 m high; a Mercator's lidar is at 0.154 m."""

    SEEN_WALLS = "objective={name: seen_walls, direction: maximise}"
    SEEN_AREA = "objective={name: seen_area, side: 2, cells: 10, direction: maximise}"

    HIGH_BOXES = opened(1.0).replace("]}", "], height: 0.2}")

    def test_if_all_are_the_objective_has_no_score(self):
        ((message, is_impossible),) = told(opened(1.0), self.SEEN_WALLS)
        assert message == (
            "m.yaml:4: arena.wall_height: walls are 0.08 m high, and the lidar of mercator, at 0.154 m, looks over "
            "them: the objective needs walls or boxes that lidars see; expected more than 0.154 m"
        )
        assert is_impossible
        with pytest.raises(MissionError, match="looks over them"):
            Simulator(parse_mission(ROOMS, name="m.yaml", overrides=[opened(1.0), self.SEEN_WALLS])).refuse_impossible()

    def test_heads_of_robots_are_all_that_is_seen_of_an_area(self):
        ((message, is_impossible),) = told(opened(1.0), self.SEEN_AREA)
        assert "looks over them: lidars see no wall; expected more than 0.154 m" in message
        assert not is_impossible
        room = "arena.room={shape: regular_polygon, sides: 4, apothem: 3}"
        assert told(opened(1.0), self.SEEN_AREA, room) == []

    def test_those_that_are_do_not_count(self):
        ((message, is_impossible),) = told(opened(1.0), self.SEEN_WALLS, "arena.wall_height=0.3")
        assert (
            "arena.obstacles[0].height and 1 more: boxes do not count, as the lidar of mercator, at 0.154 m" in message
        )
        assert not is_impossible
        ((message, _),) = told(self.HIGH_BOXES, self.SEEN_WALLS)
        assert "arena.wall_height: walls do not count" in message

    def test_nothing_is_said_where_all_are_seen_or_nobody_looks(self):
        assert told(self.HIGH_BOXES, self.SEEN_WALLS, "arena.wall_height=0.2") == []
        assert told(opened(1.0)) == []

    def test_robots_without_a_lidar(self):
        ((message, is_impossible),) = told(opened(1.0), self.SEEN_WALLS, model=EPUCK)
        assert message.endswith("objective: seen_walls needs robots with a lidar, and epuck has none")
        assert is_impossible
