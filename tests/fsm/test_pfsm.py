import pytest
from hypothesis import given

from mercator_design.errors import FsmError
from mercator_design.fsm import Pfsm, State, Transition, parse
from mercator_design.fsm.space.grammar import from_pfsm, parameters_of, to_pfsm
from mercator_design.show.machines.notations import to_dot
from tests.fsm.strategies import pfsms

STOP = State("stop")
GO = Transition("fixed probability", (0.5,), 1)


@pytest.mark.parametrize(
    ("states", "words"),
    [
        ((), "found 0"),
        ((STOP,) * 5, "found 5"),
        ((State("stop", (), (GO,) * 5), STOP), "at most 4"),
        ((State("stop", (), (GO,)),), "another"),
        ((STOP, State("stop", (), (GO,))), "another"),
        ((State("stop", (), (Transition("fixed probability", (0.5,), -1),)), STOP), "another"),
        ((State("dance"),), "dance"),
        ((State("phototaxis"),), "phototaxis"),
        ((State("stop", (1.0,)),), "takes 0"),
        ((State("attraction"),), "takes 1"),
        ((State("attraction", (6.0,)),), "1 to 5"),
        ((State("attraction", (float("nan"),)),), "alpha"),
        ((State("exploration", (2.5,)),), "integer"),
        ((State("stop", (), (Transition("fixed probability", (1.1,), 1),)), STOP), "state 0, transition 0"),
    ],
)
def test_invalid_machines_cannot_be_made(states, words):
    with pytest.raises(FsmError, match=words):
        Pfsm(states)


def test_unknown_flavour():
    with pytest.raises(FsmError, match="flavour"):
        Pfsm((STOP,), "vanilla")


def test_what_a_machine_needs():
    assert Pfsm((State("phototaxis"),), "chocolate").reads == {"light", "proximity"}
    assert Pfsm((STOP,), "chocolate").reads == set()


@given(pfsms())
def test_configurations_and_machines_are_the_same_thing(pfsm):
    assert to_pfsm(from_pfsm(pfsm), pfsm.flavour) == pfsm


@pytest.mark.parametrize(("flavour", "parameters"), [("watermelon", 149), ("chocolate", 133)])
def test_grammar_has_as_many_parameters_as_automode_s(flavour, parameters):
    names = [one.name for one in parameters_of(flavour)]
    assert len(names) == len(set(names)) == parameters


def test_dot_names_every_state_condition_and_parameter():
    dot = to_dot(parse("--nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 0 --p0x0 0.5 --s1 1"))
    assert dot == (
        "digraph finite_state_machine {\n"
        "  rankdir=LR;\n"
        '  S0 [shape=doublecircle; color=blue; label="Exploration\\nrwm=20"];\n'
        '  S1 [shape=circle; color=blue; label="Stop"];\n'
        '  C0x0 [shape=diamond; color=green; label="BlackFloor\\np=0.5"];\n'
        "  S0 -> C0x0 -> S1;\n"
        "}\n"
    )
