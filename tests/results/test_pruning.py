"""What a PFSM consists of, and what is left of it."""

import pytest

from mercator_design.fsm.pfsm import Pfsm, State, Transition
from mercator_design.results.analysis.pruning import elements, max_modules, module_counts, removed, without
from tests.fsm.strategies import FLAVOURS


def fixed(target):
    return Transition("fixed probability", (0.5,), target)


@pytest.fixture
def pfsm():
    """0 -> 1 -> 2 -> 0, and 1 -> 0; 3 -> 0 cannot be reached."""
    return Pfsm(
        (
            State("stop", (), (fixed(1),)),
            State("attraction", (2.0,), (fixed(2), Transition("black floor", (1.0,), 0))),
            State("stop", (), (fixed(0),)),
            State("repulsion", (2.0,), (fixed(0),)),
        )
    )


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_modules_have_different_names(flavour):
    assert set(max_modules(flavour).values()) == {4, 16}
    assert module_counts(Pfsm((State("stop"),), flavour)) == dict.fromkeys(max_modules(flavour), 0) | {"stop": 1}


def test_counts_are_of_what_can_be_reached(pfsm):
    counts = {name: n for name, n in module_counts(pfsm).items() if n}
    assert counts == {"stop": 2, "attraction": 1, "fixed probability": 3, "black floor": 1}


def test_elements(pfsm):
    assert elements(pfsm) == {
        (1, None): "state 1 (attraction)", (2, None): "state 2 (stop)", (3, None): "state 3 (repulsion)",
        (0, 0): "transition 0 -> 1 (fixed probability)", (1, 0): "transition 1 -> 2 (fixed probability)",
        (1, 1): "transition 1 -> 0 (black floor)", (2, 0): "transition 2 -> 0 (fixed probability)",
        (3, 0): "transition 3 -> 0 (fixed probability)",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("out", "gone", "states", "transitions"),
    [
        ([], {(3, None), (3, 0)}, ["stop", "attraction", "stop"], [[1], [2, 0], [0]]),
        ([(2, None)], {(1, 0), (2, None), (2, 0), (3, None), (3, 0)}, ["stop", "attraction"], [[1], [0]]),
        ([(1, 0)], {(1, 0), (2, None), (2, 0), (3, None), (3, 0)}, ["stop", "attraction"], [[1], [0]]),
        ([(1, 1), (2, 0)], {(1, 1), (2, 0), (3, None), (3, 0)}, ["stop", "attraction", "stop"], [[1], [2], []]),
        ([(1, None)], None, ["stop"], [[]]),
    ],
)
def test_what_is_left(pfsm, out, gone, states, transitions):
    out = frozenset(out)
    left = without(pfsm, out)
    assert [state.behaviour for state in left.states] == states
    assert [[t.target for t in state.transitions] for state in left.states] == transitions
    assert removed(pfsm, out) == (frozenset(elements(pfsm)) if gone is None else gone)
    assert without(pfsm, removed(pfsm, out)) == left
