"""Simplification: what does not matter goes, what matters stays, and the evidence is in the file."""

import random

import pytest

from mercator_design.fsm.pfsm import Pfsm, State, Transition
from mercator_design.fsm.text import to_text
from mercator_design.race.analysis.pairs import paired_p_value, worse_p_value
from mercator_design.results.analysis.simplification import counts, simplify
from mercator_design.software.files import read_fsm


def by(condition, to, *parameters):
    return Transition(condition, parameters or (0.5,), to)


SEARCH = State("exploration", (20.0,), (by("black floor", 1), by("gray floor", 2), by("white floor", 1)))
PFSM = Pfsm(
    (
        SEARCH,
        State("stop", (), (by("neighbours count", 0, 3.0, 5.0),)),
        State("repulsion", (2.0,), (by("inverted neighbours count", 0, 3.0, 5.0),)),
        State("attraction", (2.0,), (by("fixed probability", 0),)),  # cannot be reached
    )
)


CONDITIONS = ("black floor", "gray floor", "white floor", "neighbours count", "inverted neighbours count")
ALL = dict.fromkeys(CONDITIONS, 5.0)


def costs_of(weights, noise=0.1):
    """A stand-in for experiments: the cost of a PFSM is 10 and the weights of the conditions that it lacks."""
    asked = []

    def measure(pfsms, instances, what):
        asked.append((len(pfsms), instances))
        table = []
        for pfsm in pfsms:
            there = {edge.condition for state in pfsm.states for edge in state.transitions}
            lacks = sum(weight for condition, weight in weights.items() if condition not in there)
            draws = random.Random(f"{to_text(pfsm)} {instances}")
            table.append([10.0 + lacks + noise * draws.gauss(0.0, 1.0) for _ in instances])
        return table

    return measure, asked


def test_what_does_not_matter_goes():
    measure, asked = costs_of({"black floor": 5.0})
    found = simplify(PFSM, measure, runs=20)
    assert [state.behaviour for state in found.simpler.states] == ["exploration", "stop"]
    assert [edge.condition for edge in found.simpler.states[0].transitions] == ["black floor"]
    assert found.kept_states == [0, 1]
    assert counts(found) == (2, 5)
    assert found.margin == pytest.approx(0.5, rel=0.05)
    assert asked[0] == (1, range(20))
    assert asked[-1] == (len(found.steps) + 1, range(20, 40))


def test_what_matters_stays():
    measure, _ = costs_of(ALL)
    found = simplify(PFSM, measure, runs=20)
    assert found.steps == ()
    assert found.simpler.states[0] == SEARCH
    assert counts(found) == (1, 1)  # what cannot be reached


def test_a_removal_of_which_too_little_is_known_is_not_made():
    measure, _ = costs_of({}, noise=30.0)
    found = simplify(PFSM, measure, runs=5, margin=0.5)
    assert found.passed == ()
    assert len(found.simpler.states) == 3


def test_what_never_fires_needs_no_test():
    measure, _ = costs_of(ALL | {"white floor": 0.0})
    found = simplify(PFSM, measure, runs=20, dead=frozenset({(0, 2)}))
    assert found.steps == ()
    assert [edge.condition for edge in found.simpler.states[0].transitions] == ["black floor", "gray floor"]


def test_the_first_failed_test_ends_the_removal():
    measure, _ = costs_of({"black floor": 5.0})
    found = simplify(PFSM, lambda pfsms, instances, what: [
        [cost + 5.0 * (instances.start > 0 and k > 1) for cost in costs]
        for k, costs in enumerate(measure(pfsms, instances, what))
    ], runs=20)  # fmt: skip
    assert len(found.passed) == 1 < len(found.steps)
    assert found.out == found.steps[0].out


def test_p_values():
    differences = [0.3, -0.1, 0.2, 0.05, -0.2]
    assert worse_p_value(differences, 0.0) + worse_p_value([-each for each in differences], 0.0) == pytest.approx(1.0)
    assert 2 * (1 - worse_p_value(differences, 0.0)) == pytest.approx(paired_p_value(differences))
    assert worse_p_value(differences, 0.05) == pytest.approx(0.5)  # their mean
    assert worse_p_value(differences, 1.0) < 0.01
    assert worse_p_value([0.0, 0.0], 0.0) == 0.0
    assert worse_p_value([0.1, 0.1], 0.1) == 1.0
    assert worse_p_value([0.1, 0.1], 0.2) == 0.0


def test_the_verb(mdesign, tmp_path):
    original = Pfsm((State("exploration", (20.0,), (by("black floor", 1), by("white floor", 1))), State("stop")))
    fsm, simpler = tmp_path / "fsm.txt", tmp_path / "simpler.yaml"
    fsm.write_text(f"# mission: aggregation\n# score: 3\n# state names: search, rest\n{to_text(original)}\n")
    arguments = ["fsm", "simplify", fsm, "-o", simpler, "--set", "duration=20", "-n", 4, "-j", 1]
    code, out, err = mdesign(*arguments)
    assert code == 0
    assert "FSM without what never fires or cannot be reached" in out
    assert "step 1, removals to choose from: 1: 4 experiments" in err
    file = read_fsm(simpler)
    assert [edge.condition for edge in file.pfsm.states[0].transitions] in (["black floor"], [])
    assert file.names == ("search", "rest")[: len(file.pfsm.states)]
    assert file.header["simplified from"] == to_text(original)
    assert file.header["mission"] == "aggregation"
    assert "score" not in file.header
    text = simpler.read_text()
    assert mdesign(*arguments)[1] == out
    assert simpler.read_text() == text
