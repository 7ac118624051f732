"""Simple machines, for a search to begin with."""

import numpy as np
import pytest

from mercator_design.designer import flavour_space, mission_space
from mercator_design.fsm.space.grammar import modules_of, to_pfsm
from mercator_design.fsm.space.simple import simple_machines
from mercator_design.fsm.space.structure import PfsmStructure, canonical
from mercator_design.missions.mission import load_mission
from mercator_design.modules.conditions import COLOUR_LABELS
from mercator_design.modules.drawing import drawn_values
from mercator_design.modules.module import BEHAVIOURS
from mercator_design.race.space.parameter import key_of
from mercator_design.sim.simulate import Simulator

EXPLORATION = BEHAVIOURS["exploration"]


def everything(module, parameters):
    return True


def machines_of(mission, flavour, *overrides):
    space = mission_space(Simulator(load_mission(mission, overrides)), flavour)
    return [to_pfsm(one, flavour) for one in space.structure.simple(np.random.default_rng(1))]


@pytest.mark.parametrize("flavour", ["watermelon", "chocolate"])
def test_they_are_different_canonical_machines_of_one_or_two_states(flavour):
    space = flavour_space(flavour)
    found = PfsmStructure(flavour).simple(np.random.default_rng(1))
    machines = [to_pfsm(one, flavour) for one in found]
    for configuration, machine in zip(found, machines, strict=True):
        space.check(configuration)
        assert canonical(machine) == machine
        assert len(machine.states) == 1 or [len(state.transitions) for state in machine.states] == [1, 1]
    assert len({key_of(one) for one in found}) == len(found)
    behaviours, conditions = modules_of(flavour)
    n_conditions = sum(len(COLOUR_LABELS) if one.labelled else 1 for one in conditions.values())
    assert len(found) == len(behaviours) + n_conditions * (len(behaviours) - 1)


def test_the_second_behaviour_ends_by_another_condition_on_the_same_senses_or_on_any():
    draws = np.random.default_rng(2)
    machines = [one for _ in range(40) for one in simple_machines("watermelon", everything, draws)]
    on_others = []
    for first, second in (one.states for one in machines if len(one.states) == 2):
        assert first.behaviour == "exploration" != second.behaviour
        (there,), (back,) = first.transitions, second.transitions
        if there.module.reads:
            assert (there.condition, there.parameters[1:]) != (back.condition, back.parameters[1:])
        on_others.append(there.module.reads != back.module.reads)
    # Of 10 conditions 7 read the floor and 2 the neighbours: (0.7 * 3 + 0.2 * 8 + 0.1 * 9) / 9 / 2 = 0.256 of the pairs
    # read different senses. The standard error of 400 draws is 0.022.
    assert 0.14 < np.mean(on_others) < 0.37


def test_turns_are_drawn_evenly_over_their_logarithm():
    draws = np.random.default_rng(3)
    taus = [drawn_values(EXPLORATION, draws)[0] for _ in range(4000)]
    assert {1.0, 100.0} <= set(taus) <= set(range(1, 101))
    # At most 10 with probability ln(10.5) / ln(100): 0.51, with a standard error of 0.008.
    assert 0.47 < np.mean(np.array(taus) <= 10) < 0.55


def test_order_and_numbers_are_drawn():
    first, again, other = (simple_machines("chocolate", everything, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first == again
    assert [one.states[-1].behaviour for one in first] != [one.states[-1].behaviour for one in other]


def test_they_use_what_a_mission_offers():
    machines = machines_of("color_aggregation", "watermelon")
    colours = {
        edge.parameters[1]
        for machine in machines
        for state in machine.states
        for edge in state.transitions
        if edge.condition == "floor colour"
    }
    assert colours == {0.0, 2.0, 3.0}  # no blue
    dark = machines_of("chocolate_sca", "chocolate", "lights=[]")
    lit = machines_of("chocolate_sca", "chocolate")
    assert {"phototaxis", "anti-phototaxis"} <= {state.behaviour for one in lit for state in one.states}
    assert not {"phototaxis", "anti-phototaxis"} & {state.behaviour for one in dark for state in one.states}
    alone = machines_of("aggregation", "watermelon", "robots=1")
    assert {state.behaviour for one in alone for state in one.states} == {"exploration", "stop"}
    assert {edge.condition for one in alone for state in one.states for edge in state.transitions} == {
        "black floor", "gray floor", "fixed probability",
    }  # fmt: skip
