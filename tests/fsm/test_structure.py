"""Moves in the structure of PFSMs, and their canonical form."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mercator_design.designer import flavour_space
from mercator_design.fsm.pfsm import Pfsm, State, Transition
from mercator_design.fsm.space.grammar import from_pfsm, to_pfsm
from mercator_design.fsm.space.structure import PfsmStructure, canonical
from mercator_design.fsm.text import parse, to_text
from mercator_design.modules.conditions import COLOUR_LABELS
from mercator_design.modules.flavour import define_flavour
from tests.fsm.strategies import pfsms

GREEN, BLUE = (float(COLOUR_LABELS.index(name)) for name in ("green", "blue"))
SPACE = flavour_space("watermelon")
STRUCTURE = PfsmStructure("watermelon")


def random_pfsm(seed):
    draws = np.random.default_rng(seed)
    return to_pfsm(SPACE.build(lambda p, bounds: p.quantile(draws.random(), bounds)), "watermelon")


def neighbour(pfsm, draws):
    return to_pfsm(STRUCTURE.neighbour(from_pfsm(pfsm), draws), "watermelon")


def renumbered(pfsm, order, draws):
    """The same PFSM: its states in another order, the initial one still first, and so its transitions."""
    place = {old: new for new, old in enumerate(order)}
    states = []
    for i in order:
        edges = pfsm.states[i].transitions
        moved = [edges[k]._replace(target=place[edges[k].target]) for k in draws.permutation(len(edges))]
        states.append(pfsm.states[i]._replace(transitions=tuple(moved)))
    return replace(pfsm, states=tuple(states))


@given(pfsms(), st.integers(0, 2**32))
def test_renumbering_does_not_change_the_canonical_form(pfsm, seed):
    for state in pfsm.states:
        edges = {(edge.condition, edge.parameters, pfsm.states[edge.target].behaviour) for edge in state.transitions}
        assume(len(edges) == len(state.transitions))
    draws = np.random.default_rng(seed)
    order = [0, *(1 + draws.permutation(len(pfsm.states) - 1)).tolist()]
    assert canonical(renumbered(pfsm, order, draws)) == canonical(pfsm)


@given(pfsms())
def test_the_canonical_form_is_its_own(pfsm):
    assert canonical(canonical(pfsm)) == canonical(pfsm)


def test_the_canonical_form_of_transitions_that_differ_in_their_targets_alone():
    """Their order follows the new numbers of the targets."""
    to = [Transition("black floor", (0.0,), 2), *(Transition("gray floor", (0.0,), target) for target in (1, 2))]
    found = canonical(Pfsm((State("stop", (), tuple(to)), State("stop"), State("stop"))))
    assert [(edge.condition, edge.target) for edge in found.states[0].transitions] == [
        ("black floor", 1), ("gray floor", 1), ("gray floor", 2),
    ]  # fmt: skip
    assert canonical(found) == found


def test_states_that_nothing_leads_to_are_dropped():
    unreachable = State("stop", (), (Transition("black floor", (0.5,), 0),))
    explore = State("exploration", (10.0,), (Transition("black floor", (1.0,), 2),))
    attraction = State("attraction", (2.0,), (Transition("fixed probability", (0.25,), 0),))
    found = canonical(Pfsm((explore, unreachable, attraction)))
    assert [state.behaviour for state in found.states] == ["exploration", "attraction"]
    assert found.states[0].transitions == (Transition("black floor", (1.0,), 1),)
    assert found.states[1].transitions == (Transition("fixed probability", (0.25,), 0),)


def test_neighbours_are_configurations_of_the_grammar_and_all_moves_are_made():
    draws = np.random.default_rng(1)
    changes = set()
    for seed in range(300):
        pfsm = canonical(random_pfsm(seed))
        found = STRUCTURE.neighbour(from_pfsm(pfsm), draws)
        SPACE.check(found)
        assert STRUCTURE.canonical(found) == found
        other = to_pfsm(found, "watermelon")
        edges = [sum(len(state.transitions) for state in one.states) for one in (pfsm, other)]
        changes.add((np.sign(len(other.states) - len(pfsm.states)), np.sign(edges[1] - edges[0])))
    assert {(0, 0), (0, 1), (0, -1), (1, 1), (-1, -1)} <= changes


def no_white_and_no_green(module, parameters):
    """Whether a condition fires on a floor without these colours."""
    return module.name != "white floor" and (module.name != "floor colour" or parameters[1] != GREEN)


class TestWhatCannotFire:
    STRUCTURE = PfsmStructure("watermelon", can_fire=no_white_and_no_green)

    def canonical(self, *states):
        return to_pfsm(self.STRUCTURE.canonical(from_pfsm(Pfsm(states))), "watermelon").states

    def test_it_is_dropped_with_the_states_that_only_it_leads_to(self):
        white, green = Transition("white floor", (0.5,), 1), Transition("floor colour", (0.5, GREEN), 1)
        black, blue = Transition("black floor", (0.5,), 2), Transition("floor colour", (0.5, BLUE), 0)
        seen = State("attraction", (2.0,), (blue,))
        never = State("stop", (), (Transition("black floor", (0.5,), 0),))
        found = self.canonical(State("exploration", (10.0,), (white, black, green)), never, seen)
        assert found == (State("exploration", (10.0,), (black._replace(target=1),)), seen)

    def test_an_initial_state_that_is_never_left_is_the_whole_machine(self):
        explore = State("exploration", (10.0,), (Transition("white floor", (0.5,), 1),))
        assert self.canonical(explore, State("stop", (), (Transition("black floor", (0.5,), 0),))) == (
            State("exploration", (10.0,)),
        )

    def test_another_state_that_is_never_left_keeps_one_to_the_initial_state(self):
        """In the grammar, each state of several has a transition."""
        explore = State("exploration", (10.0,), (Transition("black floor", (0.5,), 1),))
        white, green = Transition("white floor", (0.5,), 2), Transition("floor colour", (0.5, GREEN), 0)
        third = State("attraction", (2.0,), (Transition("black floor", (0.5,), 0),))
        assert self.canonical(explore, State("stop", (), (white, green)), third) == (
            explore,
            State("stop", (), (green,)),
        )
        assert self.canonical(explore, State("stop", (), (white,)), third) == (
            explore,
            State("stop", (), (white._replace(target=0),)),
        )

    def test_moves_do_not_add_it(self):
        draws = np.random.default_rng(3)
        for seed in range(200):
            found = self.STRUCTURE.neighbour(from_pfsm(random_pfsm(seed)), draws)
            SPACE.check(found)
            assert self.STRUCTURE.canonical(found) == found
            initial, *others = to_pfsm(found, "watermelon").states
            assert all(no_white_and_no_green(edge.module, edge.parameters) for edge in initial.transitions)
            for state in others:
                fires = [no_white_and_no_green(edge.module, edge.parameters) for edge in state.transitions]
                assert all(fires) or fires == [False]


def test_small_turns_change_by_small_steps():
    draws = np.random.default_rng(4)
    pfsm = Pfsm((State("exploration", (3.0,)),))
    found = [neighbour(pfsm, draws).states[0] for _ in range(2000)]
    near = [1 <= one.parameters[0] <= 9 for one in found if one.behaviour == "exploration" and one != pfsm.states[0]]
    assert np.mean(near) > 0.7  # 0.81; with even steps over 1 to 100 it is 0.45


def test_any_pfsm_is_reached_from_any_other():
    """Moves that lower a distance are accepted: structure, modules and a number become those of the target."""
    draws = np.random.default_rng(2)
    stop = State("stop", (), (Transition("white floor", (0.5,), 1),))
    target = canonical(Pfsm((stop, State("exploration", (20.0,), (Transition("black floor", (0.5,), 0),)))))

    def distance(pfsm):
        behaviours = [state.behaviour for state in pfsm.states]
        conditions = [edge.condition for state in pfsm.states for edge in state.transitions]
        wanted = ["stop", "exploration"], ["white floor", "black floor"]
        return sum(
            abs(len(found) - len(right)) + sum(a != b for a, b in zip(found, right, strict=False))
            for found, right in zip((behaviours, conditions), wanted, strict=True)
        )

    for seed in range(3):
        pfsm, tries = canonical(random_pfsm(seed)), 0
        while distance(pfsm) > 0 and tries < 20_000:
            tries += 1
            other = neighbour(pfsm, draws)
            if distance(other) <= distance(pfsm):
                pfsm = other
        assert distance(pfsm) == distance(target) == 0


def test_the_same_draws_make_the_same_move():
    one, other = (neighbour(random_pfsm(4), np.random.default_rng(9)) for _ in range(2))
    assert one == other


_TWO, _CONDITIONS = "{exploration: 0, stop: 1}", "{black floor: 0, neighbours count: 3}"


@pytest.mark.usefixtures("registries")
@pytest.mark.parametrize(
    ("behaviours", "conditions", "states", "transitions"),
    [
        (_TWO, _CONDITIONS, 1, 4),
        (_TWO, _CONDITIONS, 2, 1),
        (_TWO, _CONDITIONS, 6, 6),
        (_TWO, "{}", 4, 4),
        ("{stop: 1}", _CONDITIONS, 3, 1),
        ("{stop: 1}", "{}", 1, 1),
    ],
)
def test_flavours_of_few_modules_or_other_limits_are_searched(behaviours, conditions, states, transitions):
    define_flavour(
        f"schema: 1\nlimits: {{states: {states}, transitions: {transitions}}}\nbehaviours: {behaviours}\n"
        f"conditions: {conditions}\n",
        "small",
    )
    space, structure, draws = flavour_space("small"), PfsmStructure("small"), np.random.default_rng(1)
    found = [dict(space.build(lambda p, bounds: p.quantile(draws.random(), bounds))) for _ in range(30)]
    near = structure.simple(draws)[0]
    for _ in range(100):
        near = structure.neighbour(near, draws)
        assert structure.canonical(near) == near
        found.append(near)
    for configuration in found:
        pfsm = to_pfsm(configuration, "small")
        assert from_pfsm(pfsm) == configuration
        line = " ".join(
            f"{one.switch}{configuration[one.name]}" for one in space.parameters if one.name in configuration
        )
        assert parse(line, "small") == parse(to_text(pfsm), "small") == pfsm
