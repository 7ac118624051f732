"""The set of all PFSMs of a flavour as a space of parameters.

This is the grammar of AutoMoDe: NumStates, then for each state its behaviour and number of transitions, for each
transition its target and condition, and the parameters of the modules chosen. A parameter is active only where its
module is. The target's upper bound depends on the number of states.
"""

import functools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from mercator_design.fsm.pfsm import (
    MAX_STATES,
    MAX_TRANSITIONS,
    Pfsm,
    State,
    Transition,
    absolute_target,
    relative_target,
)
from mercator_design.modules.behaviours import BEHAVIOURS
from mercator_design.modules.conditions import CONDITIONS
from mercator_design.modules.module import Module, ModuleParameter, numbered

Value = int | float | str
"""Numbers of modules are text, as they are categories; all else is a number."""

DIGITS = 2
"""Decimals of real parameters, as AutoMoDe designs them."""


class GrammarParameter(NamedTuple):
    """A parameter: one of some values, or a number within bounds."""

    name: str
    switch: str  # text before the value on a command line
    values: tuple[str, ...] = ()  # empty: a number
    low: float = 0
    high: float | tuple[str, int] = 0  # a number, or another parameter and what is added to it
    digits: int = 0  # decimals of a number
    condition: tuple[str, tuple[str, ...] | range] | None = None
    """Another parameter, and its values with which this one is active; None: it always is."""


class _Chosen(NamedTuple):
    """What stands in the grammar for a module at a place."""

    name: str  # of the module
    number: str
    parameters: tuple[str, ...]  # their names
    are_whole: tuple[bool, ...]


class _TransitionNames(NamedTuple):
    """Names of a transition's parameters, and its condition by number and by name."""

    target: str
    condition: str
    by_number: Mapping[str, _Chosen]
    by_name: Mapping[str, _Chosen]


class _StateNames(NamedTuple):
    """Names of a state's parameters, and its behaviour by number and by name."""

    behaviour: str
    connections: str
    by_number: Mapping[str, _Chosen]
    by_name: Mapping[str, _Chosen]
    transitions: tuple[_TransitionNames, ...]


def parameters_of(flavour: str) -> Iterator[GrammarParameter]:
    """The grammar of a flavour. Watermelon has 149 parameters, Chocolate 133."""
    behaviours, conditions = modules_of(flavour)
    yield GrammarParameter("NumStates", "--nstates ", low=1, high=MAX_STATES)
    for i in range(MAX_STATES):
        exists = ("NumStates", range(i + 1, MAX_STATES + 1))
        yield GrammarParameter(f"S{i}", f"--s{i} ", values=_numbers(behaviours), condition=exists)
        yield from _of_modules(behaviours, f"{i}", f"S{i}")
        connected = ("NumStates", range(max(i, 1) + 1, MAX_STATES + 1))
        number = f"NumConnections{i}"
        yield GrammarParameter(number, f"--n{i} ", low=1, high=MAX_TRANSITIONS, condition=connected)
        for j in range(MAX_TRANSITIONS):
            transition, exists = f"{i}x{j}", (number, range(j + 1, MAX_TRANSITIONS + 1))
            yield GrammarParameter(f"N{transition}", f"--n{transition} ", high=("NumStates", -2), condition=exists)
            condition = f"C{transition}"
            yield GrammarParameter(condition, f"--c{transition} ", values=_numbers(conditions), condition=exists)
            yield from _of_modules(conditions, transition, condition)


def module_of(parameter: str, number: str, flavour: str) -> Module:
    """The module that a category of the grammar stands for: a behaviour of S0, a condition of C0x0."""
    return numbered(BEHAVIOURS if parameter.startswith("S") else CONDITIONS, flavour)[int(number)]


def value_at(parameter: ModuleParameter, place: float) -> float:
    """The value at a place in [0, 1] of a parameter's domain."""
    low, high = parameter.sampled
    value = low * (high / low) ** place if parameter.log else low + place * (high - low)
    return float(round(value)) if parameter.integer else round(value, DIGITS)


def place_of(parameter: ModuleParameter, value: float) -> float:
    """The place of a value that may be sampled; the inverse of `value_at` but for rounding."""
    low, high = parameter.sampled
    return math.log(value / low) / math.log(high / low) if parameter.log else (value - low) / (high - low)


def to_pfsm(configuration: Mapping[str, Value], flavour: str) -> Pfsm:
    """The PFSM of a configuration: a value for each active parameter of the grammar."""
    return Pfsm(to_states(configuration, flavour), flavour)


def to_states(configuration: Mapping[str, Value], flavour: str) -> tuple[State, ...]:
    """The states of a configuration's PFSM, without the checks of `Pfsm`."""
    states = []
    for i, names in enumerate(_names(flavour)[: int(configuration["NumStates"])]):
        transitions = []
        for edge in names.transitions[: int(configuration.get(names.connections, 0))]:
            condition = edge.by_number[str(configuration[edge.condition])]
            target = absolute_target(i, int(configuration[edge.target]))
            transitions.append(Transition(condition.name, _values(configuration, condition), target))
        behaviour = names.by_number[str(configuration[names.behaviour])]
        states.append(State(behaviour.name, _values(configuration, behaviour), tuple(transitions)))
    return tuple(states)


def from_pfsm(pfsm: Pfsm) -> dict[str, Value]:
    """The configuration of a PFSM; the inverse of `to_pfsm`."""
    return from_states(pfsm.states, pfsm.flavour)


def from_states(states: Sequence[State], flavour: str) -> dict[str, Value]:
    """The configuration of the PFSM of some states."""
    configuration: dict[str, Value] = {"NumStates": len(states)}
    for i, (state, names) in enumerate(zip(states, _names(flavour), strict=False)):
        behaviour = names.by_name[state.behaviour]
        configuration[names.behaviour] = behaviour.number
        _put(configuration, behaviour, state.parameters)
        if state.transitions:
            configuration[names.connections] = len(state.transitions)
        for transition, edge in zip(state.transitions, names.transitions, strict=False):
            condition = edge.by_name[transition.condition]
            configuration[edge.target] = relative_target(i, transition.target)
            configuration[edge.condition] = condition.number
            _put(configuration, condition, transition.parameters)
    return configuration


def _values(configuration: Mapping[str, Value], chosen: _Chosen) -> tuple[float, ...]:
    return tuple([float(configuration[name]) for name in chosen.parameters])


def _put(configuration: dict[str, Value], chosen: _Chosen, values: Iterable[float]) -> None:
    for name, value, is_whole in zip(chosen.parameters, values, chosen.are_whole, strict=True):
        configuration[name] = int(value) if is_whole else float(value)


@functools.cache
def _names(flavour: str) -> tuple[_StateNames, ...]:
    """The names of the grammar for each state."""
    behaviours, conditions = modules_of(flavour)

    def choices(modules: Mapping[int, Module], index: str) -> tuple[dict[str, _Chosen], dict[str, _Chosen]]:
        found = [
            _Chosen(
                module.name,
                str(number),
                tuple(parameter.grammar + index for parameter in module.parameters),
                tuple(parameter.integer for parameter in module.parameters),
            )
            for number, module in modules.items()
        ]
        return {one.number: one for one in found}, {one.name: one for one in found}

    def transition(index: str) -> _TransitionNames:
        return _TransitionNames(f"N{index}", f"C{index}", *choices(conditions, index))

    return tuple(
        _StateNames(
            f"S{i}",
            f"NumConnections{i}",
            *choices(behaviours, f"{i}"),
            tuple(transition(f"{i}x{j}") for j in range(MAX_TRANSITIONS)),
        )
        for i in range(MAX_STATES)
    )


@functools.cache
def modules_of(flavour: str) -> tuple[Mapping[int, Module], Mapping[int, Module]]:
    """The behaviours and the conditions of a flavour, by their numbers."""
    return numbered(BEHAVIOURS, flavour), numbered(CONDITIONS, flavour)


def _numbers(table: Iterable[int]) -> tuple[str, ...]:
    return tuple(map(str, table))


def _of_modules(table: Mapping[int, Module], index: str, chooser: str) -> Iterator[GrammarParameter]:
    """The parameters of the modules; modules may share one, active where any of them is chosen."""
    users: dict[str, list[int]] = {}
    found: dict[str, ModuleParameter] = {}
    for number, module in table.items():
        for parameter in module.parameters:
            users.setdefault(parameter.grammar, []).append(number)
            if found.setdefault(parameter.grammar, parameter) != parameter:
                raise ValueError(f"{parameter.grammar}: modules share this parameter, but its domains differ")
    for stem, parameter in found.items():
        low, high = parameter.sampled
        digits = 0 if parameter.integer else DIGITS
        name, switch = f"{stem}{index}", f"--{parameter.flag}{index} "
        condition = (chooser, _numbers(users[stem]))
        yield GrammarParameter(name, switch, low=low, high=high, digits=digits, condition=condition)
