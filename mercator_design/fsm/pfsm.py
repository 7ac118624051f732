"""The probabilistic finite-state machine: its structure, what makes it valid, and its tables for the kernels."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from mercator_design.errors import FsmError
from mercator_design.modules.flavour import DEFAULT_FLAVOUR, flavour_of
from mercator_design.modules.module import BEHAVIOURS, CONDITIONS, Module
from mercator_design.modules.perception import Row
from mercator_design.modules.reference import senses_bits

MEMORY = 2
"""Numbers that control software keeps for itself: the active state, and control cycles spent in it."""


class Parts(NamedTuple):
    """The modules of a PFSM, one after the other; part k has places starts[k] to starts[k + 1] of a row."""

    modules: Row  # position of each in BEHAVIOURS or CONDITIONS
    starts: Row  # in `parameters`
    parameters: Row
    memory_starts: Row  # in the memory, behind MEMORY
    memory_ends: Row


class Program(NamedTuple):
    """A PFSM as tables of numbers: tuples here, numpy arrays of the same length in compiled code."""

    behaviours: Parts  # of the states
    transitions: Row  # of each state, the place of its first transition; and how many there are in all
    conditions: Parts  # of the transitions
    targets: Row  # of each transition, number of a state
    reads: Row  # of each state, the senses that it and its conditions read, as bits (module.SENSES)

    @property
    def memory(self) -> int:
        """Count of the numbers that it keeps from cycle to cycle."""
        parts = (self.behaviours, self.conditions)
        return max([MEMORY, *(int(part.memory_ends[k]) for part in parts for k in range(len(part.memory_ends)))])


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
        """Its condition."""
        return CONDITIONS[self.condition]


class State(NamedTuple):
    """A node: a behaviour, with its parameters in the table's order, and the outgoing transitions."""

    behaviour: str
    parameters: tuple[float, ...] = ()
    transitions: tuple[Transition, ...] = ()

    @property
    def module(self) -> Module:
        """Its behaviour."""
        return BEHAVIOURS[self.behaviour]

    @property
    def reads(self) -> frozenset[str]:
        """The senses that the behaviour and the conditions read."""
        return self.module.reads.union(*(transition.module.reads for transition in self.transitions))


@dataclass(frozen=True, slots=True)
class Pfsm:
    """A valid probabilistic finite-state machine; state 0 is the initial one.

    Raises:
        FsmError: on no states, more states or transitions from a state than the flavour has, a target that is the state
            itself or does not exist, a module that does not exist in the flavour, a missing, superfluous or not finite
            parameter, and (unless `any_domain`) a parameter outside its domain.
    """

    states: tuple[State, ...]
    flavour: str = DEFAULT_FLAVOUR
    any_domain: bool = field(default=False, compare=False, repr=False, kw_only=True)

    def __post_init__(self) -> None:
        flavour = flavour_of(self.flavour, "pfsm")
        max_states, max_transitions = flavour.limit("states"), flavour.limit("transitions")
        if not 1 <= len(self.states) <= max_states:
            raise FsmError(f"expected 1 to {max_states} states, found {len(self.states)}")
        for i, state in enumerate(self.states):
            place = f"state {i}"
            flavour.check_module(place, "behaviour", state.behaviour, state.parameters, any_domain=self.any_domain)
            if len(state.transitions) > max_transitions:
                raise FsmError(
                    f"{place}: expected at most {max_transitions} transitions, found {len(state.transitions)}"
                )
            for j, transition in enumerate(state.transitions):
                place = f"state {i}, transition {j}"
                if not 0 <= transition.target < len(self.states) or transition.target == i:
                    raise FsmError(
                        f"{place}: the target must be another one of the states 0 to {len(self.states) - 1}, "
                        f"found {transition.target}"
                    )
                flavour.check_module(
                    place, "condition", transition.condition, transition.parameters, any_domain=self.any_domain
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

    @property
    def draws(self) -> int:
        """Uniform draws a cycle may use: one for the behaviour, two for each transition (is it next, does it fire)."""
        return 1 + 2 * flavour_of(self.flavour).limit("transitions")

    def program(self) -> Program:
        """The tables that `control_cycle` runs on."""
        edges = [transition for state in self.states for transition in state.transitions]
        ends = [*itertools.accumulate(len(state.transitions) for state in self.states)]
        # In a state its behaviour has the first part of the memory, then its conditions theirs.
        behaving = [MEMORY + state.module.memory for state in self.states]
        kept = [
            [*itertools.accumulate((edge.module.memory for edge in state.transitions), initial=begin)]
            for begin, state in zip(behaving, self.states, strict=True)
        ]
        return Program(
            behaviours=_parts(self.states, [MEMORY] * len(self.states), behaving),
            transitions=(0, *ends),
            conditions=_parts(
                edges,
                [place for places in kept for place in places[:-1]],
                [place for places in kept for place in places[1:]],
            ),
            targets=tuple(edge.target for edge in edges),
            reads=tuple(senses_bits(state.reads) for state in self.states),
        )


def _parts(used: Sequence[State | Transition], memory_starts: Sequence[int], memory_ends: Sequence[int]) -> Parts:
    values = [each.parameters for each in used]
    return Parts(
        modules=tuple(each.module.position for each in used),
        starts=(0, *itertools.accumulate(map(len, values))),
        parameters=tuple(float(value) for row in values for value in row),
        memory_starts=tuple(memory_starts),
        memory_ends=tuple(memory_ends),
    )
