"""The set of all PFSMs of a flavour as a space of parameters.

This is the grammar of AutoMoDe: NumStates, then for each state its behaviour and number of transitions, for each
transition its target and condition, and the parameters of the modules chosen. A parameter is active only where its
module is. The target's upper bound depends on the number of states.
"""

import functools
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from mercator_design.fsm.pfsm import Pfsm, State, Transition, absolute_target, relative_target
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.grammar import Chosen, GrammarParameter, Value, choices, module_parameters, numbers_text
from mercator_design.modules.module import Module
from mercator_design.plugins.registries import by_entries


class _TransitionNames(NamedTuple):
    """Names of a transition's parameters, and its condition by number and by name."""

    target: str
    condition: str
    by_number: Mapping[str, Chosen]
    by_name: Mapping[str, Chosen]


class _StateNames(NamedTuple):
    """Names of a state's parameters, and its behaviour by number and by name."""

    behaviour: str
    connections: str
    by_number: Mapping[str, Chosen]
    by_name: Mapping[str, Chosen]
    transitions: tuple[_TransitionNames, ...]


def parameters_of(flavour: str) -> Iterator[GrammarParameter]:
    """The grammar of a flavour; numbers with one value are none of its parameters.

    Watermelon has 149 parameters, Chocolate 133.
    """
    behaviours, conditions = modules_of(flavour)
    max_states, max_transitions = limits_of(flavour)
    if max_states == 1:
        yield GrammarParameter("S0", "--nstates 1 --s0 ", values=numbers_text(behaviours))
        yield from module_parameters(behaviours, "0", "S0")
        return
    yield GrammarParameter("NumStates", "--nstates ", low=1, high=max_states)
    for i in range(max_states):
        exists = ("NumStates", range(i + 1, max_states + 1))
        yield GrammarParameter(f"S{i}", f"--s{i} ", values=numbers_text(behaviours), condition=exists)
        yield from module_parameters(behaviours, f"{i}", f"S{i}")
        connected = ("NumStates", range(max(i, 1) + 1, max_states + 1))
        number, before = f"NumConnections{i}", f"--n{i} "  # text that is still to be written before the next value
        if max_transitions > 1:
            yield GrammarParameter(number, before, low=1, high=max_transitions, condition=connected)
            before = ""
        else:
            before += "1 "
        for j in range(max_transitions):
            transition = f"{i}x{j}"
            exists = (number, range(j + 1, max_transitions + 1)) if max_transitions > 1 else connected
            switch = f"{before}--n{transition} "
            yield GrammarParameter(f"N{transition}", switch, high=("NumStates", -2), condition=exists)
            before = ""
            condition = f"C{transition}"
            yield GrammarParameter(condition, f"--c{transition} ", values=numbers_text(conditions), condition=exists)
            yield from module_parameters(conditions, transition, condition)


def module_of(parameter: str, number: str, flavour: str) -> Module:
    """The module that a category of the grammar stands for: a behaviour of S0, a condition of C0x0."""
    return modules_of(flavour)[0 if parameter.startswith("S") else 1][int(number)]


def to_pfsm(configuration: Mapping[str, Value], flavour: str) -> Pfsm:
    """The PFSM of a configuration: a value for each active parameter of the grammar."""
    return Pfsm(to_states(configuration, flavour), flavour)


def to_states(configuration: Mapping[str, Value], flavour: str) -> tuple[State, ...]:
    """The states of a configuration's PFSM, without the checks of `Pfsm`."""
    states = []
    for i, names in enumerate(_names(flavour)[: int(configuration.get("NumStates", 1))]):
        transitions = []
        for edge in names.transitions[: int(configuration.get(names.connections, f"N{i}x0" in configuration))]:
            condition = edge.by_number[str(configuration[edge.condition])]
            target = absolute_target(i, int(configuration[edge.target]))
            transitions.append(Transition(condition.name, condition.values(configuration), target))
        behaviour = names.by_number[str(configuration[names.behaviour])]
        states.append(State(behaviour.name, behaviour.values(configuration), tuple(transitions)))
    return tuple(states)


def from_pfsm(pfsm: Pfsm) -> dict[str, Value]:
    """The configuration of a PFSM; the inverse of `to_pfsm`."""
    return from_states(pfsm.states, pfsm.flavour)


def from_states(states: Sequence[State], flavour: str) -> dict[str, Value]:
    """The configuration of the PFSM of some states."""
    max_states, max_transitions = limits_of(flavour)
    configuration: dict[str, Value] = {"NumStates": len(states)} if max_states > 1 else {}
    for i, (state, names) in enumerate(zip(states, _names(flavour), strict=False)):
        behaviour = names.by_name[state.behaviour]
        configuration[names.behaviour] = behaviour.number
        behaviour.put(configuration, state.parameters)
        if state.transitions and max_transitions > 1:
            configuration[names.connections] = len(state.transitions)
        for transition, edge in zip(state.transitions, names.transitions, strict=False):
            condition = edge.by_name[transition.condition]
            configuration[edge.target] = relative_target(i, transition.target)
            configuration[edge.condition] = condition.number
            condition.put(configuration, transition.parameters)
    return configuration


@by_entries
@functools.cache
def _names(flavour: str) -> tuple[_StateNames, ...]:
    """The names of the grammar for each state."""
    behaviours, conditions = modules_of(flavour)
    max_states, max_transitions = limits_of(flavour)

    def transition(index: str) -> _TransitionNames:
        return _TransitionNames(f"N{index}", f"C{index}", *choices(conditions, index))

    return tuple(
        _StateNames(
            f"S{i}",
            f"NumConnections{i}",
            *choices(behaviours, f"{i}"),
            tuple(transition(f"{i}x{j}") for j in range(max_transitions)),
        )
        for i in range(max_states)
    )


@by_entries
@functools.cache
def modules_of(flavour: str) -> tuple[Mapping[int, Module], Mapping[int, Module]]:
    """The behaviours and the conditions of a flavour, by their numbers."""
    return flavour_of(flavour).numbered("behaviour"), flavour_of(flavour).numbered("condition")


def limits_of(flavour: str) -> tuple[int, int]:
    """Largest numbers of states and of transitions of a state that are designed; without conditions it is one state."""
    max_states = flavour_of(flavour).limit("states") if modules_of(flavour)[1] else 1
    return max_states, flavour_of(flavour).limit("transitions") if max_states > 1 else 0
