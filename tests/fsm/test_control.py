"""The control cycle: which state, when, with which probability."""

import math
import random
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.fsm import Readings, drive, parse
from mercator_design.fsm.control import STATE, control_cycle, transition_taken
from mercator_design.modules.perception import new_row
from mercator_design.modules.reference import ACTIONS, ReferenceModel
from mercator_design.software import Controller
from tests.fsm.strategies import DRAW, DRAWS, READINGS, pfsms

NEVER = [0.999999] * DRAWS  # fires nothing below probability one
ALWAYS = [0.0] * DRAWS


def test_the_first_cycle_in_a_state_tests_nothing():
    controller = Controller(
        parse("--nstates 2 --s0 1 --n0 1 --n0x0 0 --c0x0 5 --p0x0 1 --s1 0 --rwm1 5 --n1 1 --n1x0 0 --c1x0 5 --p1x0 1")
    )
    states = []
    for _ in range(7):
        controller.step(Readings(), NEVER)
        states.append(controller.state)
    assert states == [0, 1, 1, 0, 0, 1, 1]


def test_the_new_behaviour_acts_in_the_next_cycle():
    controller = Controller(parse("--nstates 2 --s0 1 --n0 1 --n0x0 0 --c0x0 5 --p0x0 1 --s1 0 --rwm1 5"))
    wheels = [controller.step(Readings(), NEVER) for _ in range(4)]
    assert wheels == [drive(0, 0), drive(0, 0), drive(1, 1), drive(1, 1)]


def test_probability_zero_never_and_one_always_fires():
    never = Controller(parse("--nstates 2 --s0 1 --n0 1 --n0x0 0 --c0x0 5 --p0x0 0 --s1 1"))
    always = Controller(parse("--nstates 2 --s0 1 --n0 1 --n0x0 0 --c0x0 5 --p0x0 1 --s1 1"))
    for _ in range(2):
        never.step(Readings(), ALWAYS)
        always.step(Readings(), NEVER)
    assert (never.state, always.state) == (0, 1)


def test_an_absorbing_state_keeps_its_robot():
    controller = Controller(parse("--nstates 2 --s0 1 --n0 1 --n0x0 0 --c0x0 5 --p0x0 1 --s1 1"))
    for _ in range(50):
        controller.step(Readings(), ALWAYS)
    assert controller.state == 1


def test_a_turn_does_not_outlive_its_state():
    controller = Controller(parse("--nstates 2 --s0 0 --rwm0 100 --n0 1 --n0x0 0 --c0x0 0 --p0x0 1 --s1 0 --rwm1 100"))
    black = Readings(proximity_x=1.0, ground_red=0.0, ground_green=0.0, ground_blue=0.0)
    long_turn = [0.9] * DRAWS
    assert controller.step(Readings(proximity_x=1.0), long_turn) == drive(1, 1)
    assert controller.step(black, long_turn) == drive(1, -1)
    assert controller.state == 1
    assert controller.step(Readings(), long_turn) == drive(1, 1)


FOUR = (
    "--nstates 4 --s0 1 --n0 4 --n0x0 0 --c0x0 5 --p0x0 {} --n0x1 1 --c0x1 5 --p0x1 {} "
    "--n0x2 2 --c0x2 5 --p0x2 {} --n0x3 0 --c0x3 5 --p0x3 {} --s1 1 --s2 1 --s3 1"
)


@pytest.mark.parametrize("probabilities", [(1, 1, 1, 1), (1, 0.5, 0.5, 0), (0.1, 0.2, 0.3, 0.4), (0, 0, 0, 0)])
def test_transitions_are_tested_in_random_order(probabilities):
    """The share of each target against the exact one: mean over all orders.

    10 000 visits; a share is a mean of independent draws with standard error at most 0.005, so a deviation beyond
    0.03 (six of them) has a chance below 1e-8 for each of the 16 shares (Hoeffding's bound: 3e-8).
    """
    model, program, readings = ReferenceModel(), parse(FOUR.format(*probabilities)).program(), Readings()
    generator = random.Random(7)
    visits = 10_000
    counts = Counter()
    for _ in range(visits):
        memory, actions = new_row(program.memory), new_row(ACTIONS)
        control_cycle(model, program, readings, memory, NEVER, actions)
        control_cycle(model, program, readings, memory, [generator.random() for _ in range(DRAWS)], actions)
        counts[int(memory[STATE])] += 1
    expected = _shares(probabilities, targets=(1, 2, 3, 1))
    for state in range(4):
        assert counts[state] / visits == pytest.approx(expected[state], abs=0.03)


def _shares(probabilities, targets):
    """Exact: the average over all orders of who fires first."""
    from itertools import permutations

    shares = [0.0] * 4
    orders = list(permutations(range(len(probabilities))))
    for order in orders:
        left = 1.0
        for j in order:
            shares[targets[j]] += left * probabilities[j] / len(orders)
            left *= 1 - probabilities[j]
        shares[0] += left / len(orders)
    return shares


@pytest.mark.parametrize(
    ("condition", "readings", "p"),
    [
        ("0 --p0x0 0.3", Readings(ground_red=0.0, ground_green=0.0, ground_blue=0.0), 0.3),
        ("1 --p0x0 0.3", Readings(ground_red=127.0, ground_green=127.0, ground_blue=127.0), 0.3),
        ("2 --p0x0 0.3", Readings(), 0.3),
        ("3 --p0x0 3 --w0x0 0.5", Readings(neighbours=2.0), 1 / (1 + math.exp(0.5))),
        ("4 --p0x0 3 --w0x0 0.5", Readings(neighbours=2.0), 1 - 1 / (1 + math.exp(0.5))),
        ("5 --p0x0 0.3", Readings(), 0.3),
        ("6 --p0x0 0.3 --l0x0 1", Readings(ground_red=0.0, ground_green=0.0), 0.3),
    ],
)
def test_every_condition_fires_with_its_probability(condition, readings, p):
    """Exact: a transition is taken if and only if the draw is below the condition's probability."""
    pfsm = parse(f"--nstates 2 --s0 1 --n0 1 --n0x0 0 --c0x0 {condition} --s1 1")
    for draw, fires in ((p * 0.999999, True), (p * 1.000001, False)):
        controller = Controller(pfsm)
        for _ in range(2):
            controller.step(readings, [0.5, 0.5, draw] + [0.5] * (DRAWS - 3))
        assert (controller.state == 1) == fires


@given(pfsms(), st.lists(st.tuples(READINGS, st.lists(DRAW, min_size=DRAWS, max_size=DRAWS)), max_size=12))
def test_the_transition_that_is_taken_leads_to_the_next_state(pfsm, cycles):
    controller = Controller(pfsm)
    is_new = True
    for readings, draws in cycles:
        state = controller.state
        controller.step(readings, draws)
        taken = transition_taken(pfsm, ReferenceModel(), state, readings, draws)
        if controller.state != state:
            assert taken in pfsm.states[state].transitions
            assert taken.target == controller.state
        else:
            assert is_new or taken is None
        is_new = controller.state != state


def test_which_of_two_transitions_to_one_state_is_taken():
    pfsm = parse("--nstates 2 --s0 1 --n0 2 --n0x0 0 --c0x0 0 --p0x0 1 --n0x1 0 --c0x1 2 --p0x1 1 --s1 1")
    for level, condition in ((0.0, "black floor"), (255.0, "white floor")):
        ground = Readings(ground_red=level, ground_green=level, ground_blue=level)
        assert transition_taken(pfsm, ReferenceModel(), 0, ground, NEVER).condition == condition
