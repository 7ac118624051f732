"""Floors that change: each kind by hand, in the engine, and played again from a trace."""

import dataclasses
import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest

from mercator_design import seeds
from mercator_design.config.colours import COLOURS
from mercator_design.config.writing import dump
from mercator_design.errors import MissionError
from mercator_design.fsm import parse
from mercator_design.missions.dynamics import change_floor
from mercator_design.missions.floor import Disc, Dynamics, Floor, Rectangle, Tiles
from mercator_design.missions.floor_kernels import colour_at
from mercator_design.missions.mission import load_mission, parse_mission
from mercator_design.missions.plugins import DYNAMICS
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.simulate import Simulator
from tests.tiers import some

pytestmark = pytest.mark.together("kernels")  # compiled once

SPOT = Disc(center=(0.0, 0.0), radius=0.5, color="black", name="spot")
SQUARE = Rectangle(center=(2.0, 0.0), size=(1.0, 1.0), color="gray", name="square")
NOBODY = np.full((1, 3), 9.0)
NAMES = {rgb: name for name, rgb in COLOURS.items()}
EXPLORE = "--nstates 1 --s0 0 --rwm0 5"


def changing(*dynamics):
    return Floor(
        zones=(SPOT, SQUARE), dynamics=tuple(Dynamics(name=name, parameters=given) for name, given in dynamics)
    )


def table(*dynamics):
    return realised(changing(*dynamics))


def realised(floor, seed=1):
    return floor.realise(seeds.generator(seed, "floor"))


def seen(floor, poses, time, row=0):
    """The colour of a zone after a cycle."""
    change_floor(floor, np.asarray(poses, dtype=float).reshape(-1, 3), time)
    return NAMES[tuple(floor.zones[row, 6:])]


def test_a_floor_without_dynamics_stays_as_it_is():
    floor = table()
    assert seen(floor, NOBODY, 1e9) == "black"
    assert (len(floor.changes), floor.numbers.size) == (0, 0)


SCHEDULE = {"zones": ("spot",), "times": (0.2, 0.4), "colors": ("white", "red"), "every": None}
DRAWN = {"zones": ("spot",), "colors": ("white", "red"), "earliest": 0.0, "latest": 0.0}


class TestSchedule:
    def test_colours_come_at_their_times(self):
        floor = table(("schedule", SCHEDULE))
        times = [0.1 * cycle for cycle in range(1, 8)]  # 0.30000000000000004 and the like
        assert [seen(floor, NOBODY, time) for time in times] == ["black", "white", "white", *["red"] * 4]

    def test_and_come_again(self):
        floor = table(("schedule", {**SCHEDULE, "every": 0.5}))
        found = [seen(floor, NOBODY, 0.1 * cycle) for cycle in range(1, 13)]
        assert found == ["black", *["white"] * 2, *["red"] * 3, *["white"] * 2, *["red"] * 3, "white"]

    @pytest.mark.parametrize("times", [(0.0, 0.95), (0.02, 0.05)])
    def test_of_changes_in_one_cycle_the_last_one_stays(self, times):
        floor = table(("schedule", {**SCHEDULE, "times": times, "every": 1.0}))
        found = {seen(floor, NOBODY, 0.1 * cycle) for cycle in range(1, 35)}
        assert found == {"white" if times[0] == 0 else "red"}

    def test_time_zero_is_the_first_cycle(self):
        floor = table(("schedule", {**SCHEDULE, "times": (0.0, 9.0)}))
        assert seen(floor, NOBODY, 0.1) == "white"

    @pytest.mark.parametrize(
        ("given", "message"),
        [
            ("zones: [spt], times: [1], colors: [red]", "floor.dynamics[0].zones[0]: no zone is called 'spt'; did"),
            ("zones: [spot], times: [1, 2], colors: [red]", "dynamics[0].colors: expected one for each of 2 times"),
            ("zones: [spot], times: [2, 1], colors: [red, red]", "dynamics[0].times: expected each later than"),
            ("zones: [spot], times: [1, 3], colors: [red, red], every: 2", "dynamics[0].every: expected more than"),
            ("zones: [spot], times: [1], colors: [rde]", "dynamics[0].colors[0]: expected one of"),
            ("zones: [spot], time: [1], colors: [red]", "dynamics[0].time: unknown key; did you mean 'times'?"),
        ],
    )
    def test_a_mistake(self, given, message):
        with pytest.raises(MissionError) as caught:
            load_mission("aggregation", [f"floor.dynamics=[{{name: schedule, {given}}}]"])
        assert message in str(caught.value)


class TestDrawnColors:
    def test_every_colour_comes_as_often(self):
        """Of 2000 instances; chance of failing by luck 5e-8."""
        floor = changing(("drawn_colors", DRAWN))
        drawn = [seen(realised(floor, seed), NOBODY, 0.1) for seed in range(2000)]
        assert set(drawn) == {"white", "red"}
        assert abs(drawn.count("red") - 1000) < 5.5 * (2000 * 0.25) ** 0.5

    def test_the_time_is_drawn_too(self):
        floor = changing(("drawn_colors", {**DRAWN, "earliest": 10.0, "latest": 20.0}))
        floors = [realised(floor, seed) for seed in range(50)]
        assert all(10.0 <= floor.numbers[0, 0] < 20.0 for floor in floors)
        assert len({float(floor.numbers[0, 0]) for floor in floors}) == 50

    def test_tiles_are_dealt_as_without_it(self):
        tiles = Tiles(centers=((0.0, 0.0), (1.0, 0.0), (2.0, 0.0)), size=0.1, colors={"red": 1, "blue": 2})
        plain = Floor(zones=(SPOT, tiles))
        drawn = dataclasses.replace(plain, dynamics=(Dynamics(name="drawn_colors", parameters=DRAWN),))
        for seed in range(5):
            a, b = (floor.realise(seeds.generator(seed, "floor")) for floor in (plain, drawn))
            assert np.array_equal(a.zones, b.zones)


class TestVisited:
    IN, OUT = (0.3, 0.0, 0.0), (1.0, 0.0, 0.0)

    def test_once_visited_for_ever(self):
        floor = table(("visited", {"zones": ("spot", "square"), "color": "white", "lasts": None}))
        assert seen(floor, [self.OUT, self.OUT], 0.1) == "black"
        assert seen(floor, [self.OUT, self.IN], 0.2) == "white"
        assert seen(floor, [self.OUT, self.OUT], 99.0) == "white"
        assert seen(floor, NOBODY, 99.1, row=1) == "gray"

    def test_until_some_time_after_the_last_has_left(self):
        floor = table(("visited", {"zones": ("spot",), "color": "white", "lasts": 1.0}))
        assert seen(floor, [self.IN, self.IN], 1.0) == "white"
        assert seen(floor, [self.IN, self.OUT], 2.0) == "white"
        assert seen(floor, [self.OUT, self.OUT], 2.9) == "white"
        assert seen(floor, [self.OUT, self.OUT], 3.0) == "black"
        assert seen(floor, [self.OUT, self.IN], 4.0) == "white"


def test_several_dynamics_keep_their_own_numbers():
    floor = table(
        ("visited", {"zones": ("square",), "color": "white", "lasts": None}),
        ("schedule", {"zones": ("spot", "square"), "times": (1.0,), "colors": ("red",), "every": None}),
    )
    assert floor.changes[:, 1:].tolist() == [[0, 1], [1, 3]]
    assert seen(floor, [(2.0, 0.0, 0.0)], 0.5, row=1) == "white"
    assert seen(floor, NOBODY, 1.0, row=1) == "red"
    assert NAMES[tuple(floor.zones[0, 6:])] == "red"


def test_a_changing_floor_is_read_back_from_a_file():
    mission = load_mission("cleaning")
    assert parse_mission(dump(mission)) == mission
    assert [dynamics.name for dynamics in mission.floor.dynamics] == ["visited"]


CHANGING = ["cleaning", "changing_decision", "stop_signal", "gianduja_decision"]


def digest(outcome):
    return outcome.score, hashlib.sha256(outcome.trace.poses.tobytes()).hexdigest()


@pytest.mark.swept
@pytest.mark.parametrize("name", some(CHANGING, 1))
def test_engine_and_referee_agree_to_the_last_bit(name):
    mission = load_mission(name)
    if mission.robots > 3:
        mission = load_mission(name, ["duration=20"])
    simulator = Simulator(mission)
    flavour = "chocolate" if mission.robot_model == "epuck" else "watermelon"
    pfsm = parse(
        "--nstates 2 --s0 0 --rwm0 5 --n0 1 --n0x0 0 --c0x0 2 --p0x0 1 --s1 1 --n1 1 --n1x0 0 --c1x0 0 --p1x0 1",
        flavour,
    )
    first = digest(simulator.run(pfsm, 3))
    assert digest(simulator.run(pfsm, 3, referee=True)) == first
    assert digest(simulator.run(pfsm, 3)) == first  # the instance's floor was its own


SCRIPT = """
import hashlib
from mercator_design.fsm import parse
from mercator_design.missions.mission import load_mission
from mercator_design.sim.simulate import Simulator
o = Simulator(load_mission({name!r}, ["duration=8", "floor.dynamics[0].times=[4]"][:{given}])).run(parse({fsm!r}), 3)
print(o.score, hashlib.sha256(o.trace.poses.tobytes()).hexdigest())
"""


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "given"), [("cleaning", 1), ("changing_decision", 2)])
def test_plain_python_agrees_too(name, given):
    overrides = ["duration=8", "floor.dynamics[0].times=[4]"][:given]
    here = digest(Simulator(load_mission(name, overrides)).run(parse(EXPLORE), 3))
    script = SCRIPT.format(name=name, given=given, fsm=EXPLORE)
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == [str(here[0]), here[1]]


@pytest.mark.parametrize("name", ["cleaning", "changing_decision"])
def test_a_trace_shows_the_floor_that_the_robots_sensed(name):
    """Ground readings without noise, against the floor played again from the poses."""
    mission = load_mission(name)
    model = load_robot_model("mercator-argos")
    outcome = Simulator(mission, model).run(parse(EXPLORE), 5, record=True)
    trace, floor = outcome.trace, outcome.trace.floor.copy()
    start = floor.zones.copy()
    ahead, aside = model.ground.positions[0]
    colors = trace.zone_colors(tuple(trace.zone_rows))
    for cycle in range(trace.cycles):
        poses = trace.poses[cycle + 1]
        change_floor(floor, poses, (cycle + 1) * trace.control_period)
        rows = [row for zone in trace.zone_rows.values() for row in zone]
        assert np.array_equal(colors[cycle], floor.zones[rows, 6:])
        for robot, (x, y, heading) in enumerate(poses):
            c, s = np.cos(heading), np.sin(heading)
            sensed = outcome.history.readings[cycle, robot, 5:8]
            assert tuple(sensed) == colour_at(floor, x + c * ahead - s * aside, y + s * ahead + c * aside)
    assert not np.array_equal(start, floor.zones)
    assert np.array_equal(trace.floor.zones, start)


def test_every_dynamic_is_tried_here():
    assert set(DYNAMICS) == {"schedule", "drawn_colors", "visited"}
