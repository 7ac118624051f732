"""Each seeded fault of a PFSM is found, and nothing else."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import pytest

from mercator_design.config.schema import Range
from mercator_design.fsm.pfsm import Pfsm, State, Transition
from mercator_design.fsm.text import parse
from mercator_design.fsm.words.names import state_names
from mercator_design.missions.mission import load_mission
from mercator_design.modules.flavour import enter_flavour, flavour_from
from mercator_design.modules.module import condition
from mercator_design.sim.checks.lint import lint
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import Uniform
from tests.fsm.strategies import FLAVOURS

PUBLISHED = json.loads((Path(__file__).parents[1] / "data" / "published_fsms.json").read_text())
MISSION = load_mission("aggregation", ["robots=5"])  # its floor is gray and black
MERCATOR, EPUCK = (load_robot_model(name) for name in ("mercator", "epuck"))


def by(condition, *parameters, to=1):
    return Transition(condition, parameters, to)


BACK = by("fixed probability", 0.2, to=0)


def found(*states, mission=None, model=None, flavour="watermelon", lenient=False):
    pfsm = Pfsm(states, flavour, any_domain=lenient)
    return {(one.code, one.place.partition(" (")[0], "transition" in one.place) for one in lint(
        pfsm, state_names(pfsm), mission, model or (MERCATOR if mission else None)
    )}  # fmt: skip


def search(*transitions):
    return State("exploration", (20.0,), transitions)


REST = State("stop", (), (BACK,))
GO = by("black floor", 0.5)


@pytest.mark.usefixtures("registries")
def test_conditions_on_other_senses_are_not_judged():
    """Lint tries grounds and numbers of neighbours; of what else a robot may perceive it knows nothing."""
    text = "schema: 1\nbehaviours: {stop: 0}\nconditions: {obstacle: 0, light: 1}\n"
    enter_flavour(flavour_from(text, "near.yaml"))
    edges = (Transition("obstacle", (1.0,), 1), Transition("light", (1.0,), 1))
    pfsm = Pfsm((State("stop", (), edges), State("stop", (), (Transition("obstacle", (1.0,), 0),))), "near")
    assert lint(pfsm, ("a", "b")) == []


@pytest.mark.usefixtures("registries")
def test_own_conditions_on_the_ground_are_judged_where_all_readings_are_known():
    @condition(reads={"ground"})
    def pale(model, readings, memory, beta: Annotated[float, Range(0, 1)]):
        return beta if 100.0 < readings.ground_red < 110.0 else 0.0

    enter_flavour(flavour_from("schema: 1\nbehaviours: {stop: 0}\nconditions: {pale: 0}\n", "own.yaml"))
    rest = State("stop", (), (by("pale", 0.5, to=0),))
    states = (State("stop", (), (by("pale", 0.5),)), rest)
    assert found(*states, flavour="own") == set()
    assert ("never-fires", "state 0", True) in found(*states, mission=MISSION, flavour="own")


@pytest.mark.usefixtures("registries")
def test_the_constants_of_the_flavour_count():
    text = "schema: 1\nbehaviours: {stop: 0}\nconditions: {white floor: 0, fixed probability: 1}\n"
    enter_flavour(flavour_from(text, "usual.yaml"))
    enter_flavour(flavour_from(f"{text}constants: {{white_lowest: 100}}\n", "bright.yaml"))
    states = (State("stop", (), (by("white floor", 0.5),)), REST)
    assert ("never-fires", "state 0", True) in found(*states, mission=MISSION, flavour="usual")
    assert found(*states, mission=MISSION, flavour="bright") == set()


def test_a_sound_pfsm_has_no_findings():
    assert found(search(GO), REST) == set()
    assert found(search(GO), REST, mission=MISSION) == set()
    assert found(State("stop")) == set()


@pytest.mark.parametrize(
    ("code", "edges", "mission"),
    [
        ("never-fires", [by("black floor", 0.0)], None),
        ("never-fires", [by("fixed probability", 1e-7)], None),
        ("never-fires", [by("white floor", 0.5)], MISSION),
        ("never-fires", [by("floor colour", 0.5, 2.0)], MISSION),
        ("never-fires", [by("neighbours count", 10.0, 20.0)], MISSION),
        ("never-fires", [by("neighbours count", 3.0, 6.0)], replace(MISSION, robots=1)),
        ("always-fires", [by("fixed probability", 1.0)], None),
        ("always-fires", [by("inverted neighbours count", 9.0, 10.0)], MISSION),
        ("always-fires", [by("inverted neighbours count", 5.0, 10.0)], replace(MISSION, robots=1)),
        ("duplicate", [GO], None),
        ("duplicate", [by("black floor", 0.1)], None),
        ("duplicate", [by("neighbours count", 3.0, 2.0)] * 2, None),
        ("shadowed", [by("neighbours count", 3.0, 12.0), by("neighbours count", 9.0, 19.0)], None),
        ("shadowed", [by("fixed probability", 1.0), by("white floor", 0.1)], None),
    ],
)
def test_seeded_transitions(code, edges, mission):
    findings = found(search(GO, *edges), REST, mission=mission)
    assert code in {each for each, _, _ in findings}
    others = {each for each, _, _ in findings} - {code}
    assert others <= ({"always-fires", "shadowed"} if "fixed probability" in str(edges) or mission else set())


def test_conditions_that_may_fire_on_an_unknown_ground_or_with_many_robots():
    edges = by("floor colour", 0.5, 2.0), by("white floor", 0.5), by("neighbours count", 10.0, 20.0)
    assert found(search(*edges), REST) == set()
    assert found(search(edges[2]), REST, mission=replace(MISSION, robots=20)) == set()


def test_robots_that_may_count_more_than_there_are():
    many = by("neighbours count", 10.0, 20.0)
    noisy = replace(MERCATOR, lidar=replace(MERCATOR.lidar, noise=Uniform(half_width=0.02)))
    walls = replace(MISSION, arena=replace(MISSION.arena, wall_height=0.5))
    assert ("never-fires", "state 0", True) in found(search(many), REST, mission=MISSION)
    assert found(search(many), REST, mission=MISSION, model=noisy) == set()
    assert found(search(many), REST, mission=walls) == set()


def test_states():
    stop = State("stop")
    island = State("repulsion", (2.0,), (by("black floor", 0.5, to=0),))
    assert found(search(GO), REST, island) == {("unreachable-state", "state 2", False)}
    assert found(search(GO), stop) == {("absorbing-state", "state 1", False)}
    bridge = search(GO, by("white floor", 0.5, to=2))
    assert found(bridge, REST, island) == set()
    assert found(bridge, REST, island, mission=MISSION) == {
        ("unreachable-state", "state 2", False), ("never-fires", "state 0", True),
    }  # fmt: skip
    dead_end = State("stop", (), (by("white floor", 0.5, to=0),))
    assert found(search(GO), dead_end, mission=MISSION) == {
        ("absorbing-state", "state 1", False), ("never-fires", "state 1", True),
    }  # fmt: skip


def test_senses():
    light = State("phototaxis", (), (BACK,))
    assert ("missing-sense", "state 1", False) in found(search(GO), light, model=MERCATOR, flavour="chocolate")
    assert found(search(GO), light, model=EPUCK, flavour="chocolate") == set()
    dark = load_mission("aggregation", ["robot_model=epuck"])
    assert found(search(GO), light, mission=dark, model=EPUCK, flavour="chocolate") == {
        ("nothing-to-read", "state 1", False)
    }
    together = State("attraction", (2.0,), (BACK,))
    assert found(search(GO), together, mission=replace(MISSION, robots=1)) == {("nothing-to-read", "state 1", False)}
    assert ("never-fires", "state 0", True) in found(search(by("floor colour", 0.5, 0.0)), REST, model=EPUCK)


def test_parameters_outside_their_domains():
    edge = by("black floor", 1.5)
    assert {code for code, _, _ in found(State("exploration", (200.0,), (edge,)), REST, lenient=True)} == {
        "out-of-domain"
    }


def test_equivalence_counts_other_targets():
    """A certain transition makes another one superfluous only if it cannot take the turn of a third."""
    edges = by("black floor", 1.0), by("black floor", 1.0)
    third = by("black floor", 0.5, to=2)
    assert {code for code, _, _ in found(search(*edges), REST)} == {"shadowed"}
    assert {code for code, _, _ in found(search(*edges, third), REST, REST)} == {"duplicate"}


def test_published_designs():
    """Checked by hand: states that nothing leads to, ends that may be meant, conditions given twice."""
    codes = {
        name: sorted({one.code for one in lint(pfsm, state_names(pfsm))} - {"duplicate"})
        for flavour in FLAVOURS
        for name, line in PUBLISHED[flavour].items()
        for pfsm in [parse(line, flavour)]
    }
    assert {name: each for name, each in codes.items() if each} == {
        "W1": ["absorbing-state"], "C1": ["absorbing-state"], "C8": ["always-fires"],
        "W2": ["unreachable-state"], "W21": ["unreachable-state"], "C12": ["unreachable-state"],
        "W6": ["shadowed"], "W28": ["shadowed"],
        "C13": ["shadowed", "unreachable-state"],
    }  # fmt: skip


class TestVerb:
    def test_exit_codes_and_json(self, mdesign, tmp_path):
        path = tmp_path / "fsm.txt"
        path.write_text("--nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 0 --p0x0 0.5 --s1 1")
        code, out, _ = mdesign("fsm", "lint", path)
        assert (code, out) == (
            0, "absorbing-state (note): state 1 (stop): no transition leads out of it: a robot stays here to the end\n",
        )  # fmt: skip
        path.write_text(path.read_text().replace("0.5", "0"))
        code, out, _ = mdesign("fsm", "lint", path, "--mission", "aggregation", "--json")
        assert code == 3
        assert [(one["code"], one["is_note"]) for one in json.loads(out)] == [
            ("never-fires", False), ("absorbing-state", True), ("unreachable-state", False),
        ]  # fmt: skip
        path.write_text(path.read_text().replace("20", "500"))
        assert mdesign("fsm", "lint", path)[0] == 3
        assert "out-of-domain: state 0: tau of exploration is 500" in mdesign("fsm", "lint", path, "--lenient")[1]
