"""The set of all PFSMs of a flavour as a space of parameters, in the language of irace's parameter files.

This is the grammar of AutoMoDe: NumStates, then for each state its behaviour and number of transitions, for each
transition its target and condition, and the parameters of the modules chosen. A parameter is active only where its
module is. The target's upper bound depends on the number of states; AutoMoDe needed a patched irace for that, the
language has had dependent bounds since.
"""

import functools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from mercator_design.fsm.behaviours import BEHAVIOURS
from mercator_design.fsm.conditions import CONDITIONS
from mercator_design.fsm.modules import Module, ModuleParameter, numbered
from mercator_design.fsm.pfsm import (
    MAX_STATES,
    MAX_TRANSITIONS,
    Pfsm,
    State,
    Transition,
    absolute_target,
    relative_target,
)

Value = int | float | str
"""Numbers of modules are text, as they are categories; all else is a number."""

DIGITS = 2
"""Decimals of real parameters, as AutoMoDe designs them."""


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


def parameters_text(flavour: str) -> str:
    """The grammar of a flavour as an irace parameter file. Watermelon has 149 parameters, Chocolate 133."""
    behaviours, conditions = modules_of(flavour)
    lines = [f'NumStates "--nstates " i (1, {MAX_STATES})']
    for i in range(MAX_STATES):
        exists = f"NumStates > {i}"
        lines.append(f'S{i} "--s{i} " c ({_numbers(behaviours)}) | {exists}')
        lines += _module_lines(behaviours, f"{i}", f"S{i}")
        connected = "NumStates > 1" if i == 0 else exists
        lines.append(f'NumConnections{i} "--n{i} " i (1, {MAX_TRANSITIONS}) | {connected}')
        for j in range(MAX_TRANSITIONS):
            transition = f"{i}x{j}"
            exists = f"as.numeric(NumConnections{i}) > {j}"
            lines.append(f'N{transition} "--n{transition} " i (0, "NumStates-2") | {exists}')
            lines.append(f'C{transition} "--c{transition} " c ({_numbers(conditions)}) | {exists}')
            lines += _module_lines(conditions, transition, f"C{transition}")
    return "\n".join([*lines, "", "[global]", f"digits = {DIGITS}", ""])


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


def _numbers(table: Iterable[int]) -> str:
    return ", ".join(str(number) for number in table)


def _module_lines(table: Mapping[int, Module], index: str, chooser: str) -> list[str]:
    """A line for each parameter of the modules; modules may share one, active where any of them is chosen."""
    users: dict[str, list[int]] = {}
    found: dict[str, ModuleParameter] = {}
    for number, module in table.items():
        for parameter in module.parameters:
            users.setdefault(parameter.grammar, []).append(number)
            if found.setdefault(parameter.grammar, parameter) != parameter:
                raise ValueError(f"{parameter.grammar}: modules share this parameter, but its domains differ")
    lines = []
    for stem, parameter in found.items():
        low, high = parameter.sampled
        kind = "i" if parameter.integer else "r"
        chosen = ", ".join(f'"{number}"' for number in users[stem])
        switch, condition = f'"--{parameter.flag}{index} "', f"{chooser} %in% c({chosen})"
        lines.append(f"{stem}{index} {switch} {kind} ({low:g}, {high:g}) | {condition}")
    return lines
