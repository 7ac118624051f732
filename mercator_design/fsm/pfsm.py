"""The probabilistic finite-state machine: its structure, what makes it valid, and its tables for the kernels."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from mercator_design.errors import FsmError
from mercator_design.modules.behaviours import BEHAVIOURS
from mercator_design.modules.conditions import CONDITIONS
from mercator_design.modules.module import MAX_PARAMETERS, Module, named, senses_bits
from mercator_design.modules.perception import Row

MAX_STATES = 4
MAX_TRANSITIONS = 4
"""The limits of AutoMoDe's grammar: states a PFSM, outgoing transitions a state."""

FLAVOURS = ("watermelon", "chocolate")

_BEHAVIOURS = named(BEHAVIOURS)
_CONDITIONS = named(CONDITIONS)


class Program(NamedTuple):
    """A PFSM as tables of numbers: tuples here, numpy arrays of the same length in compiled code.

    Transition j of state i is at place i * MAX_TRANSITIONS + j; a module's parameters begin at MAX_PARAMETERS times
    the place of the state or transition.
    """

    behaviours: Row  # of each state, position in BEHAVIOURS
    behaviour_parameters: Row
    transitions: Row  # of each state, how many
    conditions: Row  # of each transition, position in CONDITIONS
    condition_parameters: Row
    targets: Row  # of each transition, number of a state
    reads: Row  # of each state, the senses that it and its conditions read, as bits (modules.SENSES)


def absolute_target(state: int, relative: int) -> int:
    """The state that a target counted among the *other* states means, as texts and the grammar count."""
    return relative if relative < state else relative + 1


def relative_target(state: int, target: int) -> int:
    """The number of a target among the other states; undoes `absolute_target`."""
    return target if target < state else target - 1


class Transition(NamedTuple):
    """An edge: a condition, with its parameters in the table's order, and the number of the target state."""

    condition: str
    parameters: tuple[float, ...]
    target: int

    @property
    def module(self) -> Module:
        """The row of CONDITIONS."""
        return CONDITIONS[_CONDITIONS[self.condition]]


class State(NamedTuple):
    """A node: a behaviour, with its parameters in the table's order, and the outgoing transitions."""

    behaviour: str
    parameters: tuple[float, ...] = ()
    transitions: tuple[Transition, ...] = ()

    @property
    def module(self) -> Module:
        """The row of BEHAVIOURS."""
        return BEHAVIOURS[_BEHAVIOURS[self.behaviour]]

    @property
    def reads(self) -> frozenset[str]:
        """The senses that the behaviour and the conditions read."""
        return self.module.reads.union(*(transition.module.reads for transition in self.transitions))


@dataclass(frozen=True, slots=True)
class Pfsm:
    """A valid probabilistic finite-state machine; state 0 is the initial one.

    Raises:
        FsmError: on more than 4 or no states, more than 4 transitions from a state, a target that is the state itself
            or does not exist, a module that does not exist in the flavour, a missing, superfluous or not finite
            parameter, and (unless `any_domain`) a parameter outside its domain.
    """

    states: tuple[State, ...]
    flavour: str = "watermelon"
    any_domain: bool = field(default=False, compare=False, repr=False, kw_only=True)

    def __post_init__(self) -> None:
        if self.flavour not in FLAVOURS:
            raise FsmError(f"flavour: expected one of {', '.join(FLAVOURS)}, found {self.flavour!r}")
        if not 1 <= len(self.states) <= MAX_STATES:
            raise FsmError(f"expected 1 to {MAX_STATES} states, found {len(self.states)}")
        for i, state in enumerate(self.states):
            self._check_module(f"state {i}", "behaviour", state.behaviour, state.parameters)
            if len(state.transitions) > MAX_TRANSITIONS:
                raise FsmError(
                    f"state {i}: expected at most {MAX_TRANSITIONS} transitions, found {len(state.transitions)}"
                )
            for j, transition in enumerate(state.transitions):
                place = f"state {i}, transition {j}"
                if not 0 <= transition.target < len(self.states) or transition.target == i:
                    raise FsmError(
                        f"{place}: the target must be another one of the states 0 to {len(self.states) - 1}, "
                        f"found {transition.target}"
                    )
                self._check_module(place, "condition", transition.condition, transition.parameters)

    def _check_module(self, place: str, kind: str, name: str, values: tuple[float, ...]) -> None:
        table, places = (BEHAVIOURS, _BEHAVIOURS) if kind == "behaviour" else (CONDITIONS, _CONDITIONS)
        if name not in places or self.flavour not in table[places[name]].numbers:
            known = ", ".join(module.name for module in table if self.flavour in module.numbers)
            raise FsmError(f"{place}: {self.flavour} has no {kind} {name!r}; it has {known}")
        parameters = table[places[name]].parameters
        if len(values) != len(parameters):
            raise FsmError(f"{place}: {name} takes {len(parameters)} parameters, found {len(values)}")
        for parameter, value in zip(parameters, values, strict=True):
            if not math.isfinite(value) or not (self.any_domain or parameter.contains(value)):
                raise FsmError(
                    f"{place}: parameter {parameter.name} of {name} must be {parameter.domain}, found {value:g}"
                )

    def __repr__(self) -> str:
        return f"<Pfsm: {self.summary}>"

    @property
    def summary(self) -> str:
        """Flavour, states and number of transitions in a line."""
        n, m = len(self.states), sum(len(state.transitions) for state in self.states)
        states = f"{n} state{'s' * (n != 1)} ({', '.join(state.behaviour for state in self.states)})"
        return f"{self.flavour}, {states}, {m} transition{'s' * (m != 1)}"

    @property
    def reads(self) -> frozenset[str]:
        """The senses that a robot must have to run this PFSM."""
        return frozenset().union(*(state.reads for state in self.states))

    @property
    def nodes(self) -> Iterator[tuple[str, State | Transition]]:
        """Each state and its transitions, behind their places in words."""
        for i, state in enumerate(self.states):
            yield f"state {i}", state
            for j, transition in enumerate(state.transitions):
                yield f"state {i}, transition {j}", transition

    def program(self) -> Program:
        """The tables that `control_cycle` runs on."""
        nothing = Transition(CONDITIONS[0].name, (), 0)
        places = [
            transition
            for state in self.states
            for transition in (*state.transitions, *[nothing] * (MAX_TRANSITIONS - len(state.transitions)))
        ]
        return Program(
            behaviours=tuple(_BEHAVIOURS[state.behaviour] for state in self.states),
            behaviour_parameters=_padded(state.parameters for state in self.states),
            transitions=tuple(len(state.transitions) for state in self.states),
            conditions=tuple(_CONDITIONS[transition.condition] for transition in places),
            condition_parameters=_padded(transition.parameters for transition in places),
            targets=tuple(transition.target for transition in places),
            reads=tuple(senses_bits(state.reads) for state in self.states),
        )


def _padded(rows: Iterable[tuple[float, ...]]) -> tuple[float, ...]:
    """Parameters one after the other, MAX_PARAMETERS to a module."""
    return tuple(float(value) for row in rows for value in (*row, *[0.0] * (MAX_PARAMETERS - len(row))))
