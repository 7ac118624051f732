"""PFSMs in words: explanations and differences."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

from mercator_design.fsm.pfsm import FLAVOURS, Pfsm, State, Transition
from mercator_design.fsm.text import parse
from mercator_design.fsm.words.difference import difference
from mercator_design.fsm.words.explain import explanation
from mercator_design.fsm.words.modules import with_parameters
from mercator_design.fsm.words.names import state_names
from tests.fsm.strategies import pfsms
from tests.fsm.test_structure import renumbered

PUBLISHED = json.loads((Path(__file__).parents[1] / "data" / "published_fsms.json").read_text())
GO, BACK = Transition("black floor", (0.5,), 1), Transition("neighbours count", (3.0, 5.0), 0)
SEARCH, REST = State("exploration", (20.0,), (GO,)), State("stop", (), (BACK,))
HERE = Pfsm((SEARCH, REST))


def changes(other, one=HERE):
    found = difference(one, other, state_names(one), state_names(other))
    return found.kind, list(found.changes)


def test_an_explanation():
    assert explanation(HERE, ("search", "rest"), 0.1) == (
        "A PFSM of watermelon with 2 states and 2 transitions. Robots begin in search.\n"
        "In each control cycle (0.1 s) a robot does what its state says.\n"
        "Then, but for the first cycle of a visit, it tests the transitions of the state in random order,\n"
        "and takes the first that fires.\n"
        "\n"
        "search: exploration (tau 20 cycles)\n"
        "  The robot drives straight on; before an obstacle it turns away for 1 to 19 cycles (at most 1.9 s).\n"
        "  It changes to rest\n"
        "    with probability 0.5 a cycle where the ground is black (after 0.2 s there, on average)\n"
        "      [black floor (beta 0.5 per cycle)]\n"
        "\n"
        "rest: stop\n"
        "  The robot stands still.\n"
        "  It changes to search\n"
        "    the more neighbours the likelier: nearly 0 % with none, 0.7 % with 2, 50 % with 3 and 99.3 % with 4, "
        "in each cycle\n"
        "      [neighbours count (xi 3 robots, eta 5)]\n"
    )


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_every_module_of_published_designs_is_explained(flavour):
    for line in PUBLISHED[flavour].values():
        pfsm = parse(line, flavour)
        text = explanation(pfsm, state_names(pfsm), 0.1)
        for state in pfsm.states:
            assert with_parameters(state.behaviour, state.parameters) in text
            assert all(with_parameters(edge.condition, edge.parameters) in text for edge in state.transitions)


def test_a_pfsm_is_the_same_as_itself():
    assert changes(HERE) == ("same", [])


@given(pfsms())
@settings(max_examples=20)
def test_renumbering_is_no_change(pfsm):
    order = [0, *range(len(pfsm.states) - 1, 0, -1)]
    kind, found = changes(renumbered(pfsm, order, np.random.default_rng(1)), pfsm)
    assert (kind in {"same", "renumbered"}, found) == (True, [])


@pytest.mark.parametrize(
    ("states", "words"),
    [
        ((SEARCH._replace(parameters=(35.0,)), REST), "state 'exploration': tau 20 -> 35"),
        ((State("repulsion", (2.0,), (GO,)), REST),
         "state 'exploration' (now 'repulsion'): repulsion (alpha 2) instead of exploration (tau 20 cycles)"),
        ((SEARCH._replace(transitions=(GO._replace(parameters=(0.7,)),)), REST),
         "state 'exploration': transition to 'stop' by black floor: beta 0.5 -> 0.7"),
        ((SEARCH._replace(transitions=()), REST),
         "state 'exploration': no transition to 'stop' by black floor (beta 0.5 per cycle) any more"),
        ((SEARCH._replace(transitions=(GO, BACK._replace(target=1))), REST),
         "state 'exploration': new transition to 'stop' by neighbours count (xi 3 robots, eta 5)"),
        ((SEARCH._replace(transitions=(Transition("white floor", (0.5,), 1),)), REST),
         "state 'exploration': transition to 'stop' by black floor: "
         "white floor (beta 0.5 per cycle) instead of black floor (beta 0.5 per cycle)"),
        ((REST._replace(transitions=(BACK._replace(target=1),)), SEARCH._replace(transitions=(GO._replace(target=0),))),
         "robots begin in 'stop', before in 'exploration'"),
    ],
)  # fmt: skip
def test_a_change_is_said_in_a_sentence(states, words):
    assert changes(Pfsm(states)) == ("different", [words])


def test_states_that_come_and_go():
    to_third = SEARCH._replace(transitions=(GO, Transition("white floor", (0.1,), 2)))
    other = Pfsm((to_third, REST, State("attraction", (2.0,), (Transition("gray floor", (1.0,), 0),))))
    assert changes(other) == ("different", [
        "state 'exploration': new transition to the new 'attraction' by white floor (beta 0.1 per cycle)",
        "new state 'attraction': attraction (alpha 2); to 'exploration' by gray floor (beta 1 per cycle)",
    ])  # fmt: skip
    assert changes(HERE, other) == ("different", [
        "state 'exploration': no transition to a state that is gone by white floor (beta 0.1 per cycle) any more",
        "no state 'attraction' any more: attraction (alpha 2)",
    ])  # fmt: skip


def test_what_cannot_be_reached_makes_no_difference():
    kind, found = changes(Pfsm((SEARCH, REST, State("repulsion", (2.0,), (Transition("gray floor", (1.0,), 0),)))))
    assert (kind, len(found)) == ("equivalent", 1)


def test_the_flavour():
    assert changes(Pfsm(HERE.states, "chocolate")) == ("equivalent", ["the flavour is chocolate, was watermelon"])


def test_the_verbs(mdesign, tmp_path):
    one, other = tmp_path / "one.txt", tmp_path / "other.txt"
    one.write_text(PUBLISHED["watermelon"]["W1"])
    other.write_text(PUBLISHED["watermelon"]["W1"].replace("0.5", "0.25"))
    assert mdesign("fsm", "diff", one, one)[:2] == (0, "the same PFSM\n")
    assert mdesign("fsm", "diff", one, other)[:2] == (
        0, "these differ\n  state 'exploration': transition to 'stop' by black floor: beta 0.5 -> 0.25\n",
    )  # fmt: skip
    assert "No transition leads out of this state" in mdesign("fsm", "explain", one)[1]
    one.write_text("# control period: 0.2\n" + PUBLISHED["watermelon"]["W1"])
    assert "In each control cycle (0.2 s)" in mdesign("fsm", "explain", one)[1]
