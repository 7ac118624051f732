"""PFSMs in words: explanations and differences."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

from mercator_design.fsm.pfsm import Pfsm, State, Transition
from mercator_design.fsm.text import parse
from mercator_design.fsm.words.difference import difference
from mercator_design.fsm.words.explain import explanation
from mercator_design.fsm.words.names import state_names
from mercator_design.modules.flavour import define_flavour
from mercator_design.modules.module import BEHAVIOURS, CONDITIONS, KnownSwarm
from mercator_design.modules.words import module_words, with_parameters
from tests.fsm.strategies import FLAVOURS, pfsms
from tests.fsm.test_structure import renumbered

PUBLISHED = json.loads((Path(__file__).parents[1] / "data" / "published_fsms.json").read_text())
GO, BACK = Transition("black floor", (0.5,), 1), Transition("neighbours count", (3.0, 5.0), 0)
SEARCH, REST = State("exploration", (20.0,), (GO,)), State("stop", (), (BACK,))
HERE = Pfsm((SEARCH, REST))


def changes(other, one=HERE):
    found = difference(one, other, state_names(one), state_names(other))
    return found.kind, list(found.changes)


def test_an_explanation():
    assert explanation(HERE, ("search", "rest"), KnownSwarm(0.1)) == (
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


@pytest.mark.parametrize(
    ("robots", "words"),
    [
        (None, "nearly 100 % with none, nearly 100 % with 7, 50 % with 8 and nearly 0 % with 9, in each cycle"),
        (1, "nearly 100 % with none, in each cycle; there is no other robot"),
        (2, "nearly 100 % with none and nearly 100 % with 1, in each cycle; there is only 1 other robot"),
        (3, "nearly 100 % with none and nearly 100 % with 2, in each cycle; there are only 2 other robots"),
        (
            9,
            "nearly 100 % with none, nearly 100 % with 7 and 50 % with 8, in each cycle; there are only 8 other robots",
        ),
        (10, "nearly 100 % with none, nearly 100 % with 7, 50 % with 8 and nearly 0 % with 9, in each cycle"),
    ],
)
def test_a_robot_has_no_more_neighbours_than_there_are_other_robots(robots, words):
    found = module_words(CONDITIONS["inverted neighbours count"], (8.0, 10.38), KnownSwarm(0.1, robots))
    assert found == f"the fewer neighbours the likelier: {words}"
    several = module_words(CONDITIONS["neighbours count"], (8.0, 10.38), KnownSwarm(0.1, robots))
    assert several.partition("cycle")[2] == found.partition("cycle")[2]


@pytest.mark.usefixtures("registries")
def test_the_constants_of_the_flavour_count():
    text = "schema: 1\nbehaviours: {stop: 0}\nconditions: {neighbours count: 0}\nconstants: {count_wraps: 1}\n"
    define_flavour(text, "wrapped")
    states = (State("stop", (), (Transition("neighbours count", (3.0, 5.0), 1),)), State("stop", (), (BACK,)))
    assert "but never with more than 3" in explanation(Pfsm(states, "wrapped"), ("a", "b"), KnownSwarm(0.1))


def test_a_robot_alone_has_no_neighbours_to_go_to():
    for behaviour in ("attraction", "repulsion"):
        assert module_words(BEHAVIOURS[behaviour], (2.0,), KnownSwarm(0.1, 1)).endswith(
            "obstacles; there is no other robot"
        )
        assert module_words(BEHAVIOURS[behaviour], (2.0,), KnownSwarm(0.1, 2)).endswith("obstacles")


class TestRobotsThatAreKnown:
    COUNTS = "--nstates 2 --s0 0 --rwm0 5 --n0 1 --n0x0 0 --c0x0 3 --p0x0 8 --w0x0 9 --s1 1"

    @pytest.fixture
    def explained(self, mdesign, tmp_path):
        def explain(header, *options):
            file = tmp_path / "fsm.txt"
            file.write_text(f"{header}{self.COUNTS}\n")
            code, out, err = mdesign("fsm", "explain", file, *options)
            return (code, err) if code else (out, err)

        return explain

    @pytest.mark.parametrize("header", ["# mission: aggregation\n", "# robots: 3\n# mission: gone.yaml\n"])
    def test_by_the_header(self, explained, header):
        out, err = explained(header)
        assert "\nThere are 3 robots: each has 2 others.\n" in out
        assert "with 2, in each cycle; there are only 2 other robots\n" in out
        assert err == ""

    def test_by_a_mission(self, explained):
        assert "there are only 19 other robots" not in explained("", "--mission", "aggregation_20")[0]
        assert "There are 20 robots: each has 19 others." in explained("", "--mission", "aggregation_20")[0]
        assert "There are 3 robots" in explained("# robots: 20\n", "--mission", "aggregation")[0]

    def test_not_at_all(self, explained):
        out, err = explained("")
        assert "There are" not in out
        assert "with 9, in each cycle\n" in out
        assert err == ""
        out, err = explained("# mission: gone.yaml\n")
        assert "with 9, in each cycle\n" in out
        assert "Note: the number of robots is not known: " in err
        assert "gone.yaml" in err

    @pytest.mark.parametrize("robots", ["0", "x", "1001"])
    def test_a_wrong_header_is_refused(self, explained, robots):
        code, err = explained(f"# robots: {robots}\n")
        assert code == 3
        assert f'robots in the header: expected a whole number >= 1 and <= 1000, found "{robots}"' in err

    def test_on_a_picture(self, mdesign, tmp_path):
        file = tmp_path / "fsm.txt"
        file.write_text(f"# mission: aggregation\n{self.COUNTS}\n")
        assert "There are 3 robots: each has 2 others." in mdesign("fsm", "show", file)[1]
        file.write_text("# mission: aggregation\n--nstates 1 --s0 1\n")
        assert "robots: each" not in mdesign("fsm", "show", file)[1]


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_every_module_of_published_designs_is_explained(flavour):
    for line in PUBLISHED[flavour].values():
        pfsm = parse(line, flavour)
        text = explanation(pfsm, state_names(pfsm), KnownSwarm(0.1))
        for state in pfsm.states:
            assert with_parameters(state.module, state.parameters) in text
            assert all(with_parameters(edge.module, edge.parameters) in text for edge in state.transitions)


def test_a_pfsm_is_the_same_as_itself():
    assert changes(HERE) == ("same", [])


@given(pfsms())
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
