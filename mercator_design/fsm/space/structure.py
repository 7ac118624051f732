"""Moves in the structure of a PFSM, and the one PFSM that stands for all that are the same.

The grammar numbers states and transitions, so that one PFSM has many configurations, and what is one step for a person
(drop a state, and lead what led to it to where it led) changes half of the numbers. Here a step is one of the PFSM.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from mercator_design.fsm.pfsm import Pfsm, State, Transition
from mercator_design.fsm.space.grammar import from_states, limits_of, modules_of, to_states
from mercator_design.fsm.space.simple import simple_machines
from mercator_design.modules.drawing import (
    Draws,
    Usable,
    always,
    any_of,
    drawn_values,
    firing,
    label_of,
    make_moves,
    near,
)
from mercator_design.modules.grammar import Value
from mercator_design.modules.module import Module

T = TypeVar("T")


class PfsmStructure:
    """The structure of a flavour's PFSMs, in terms of configurations of the grammar.

    Args:
        flavour: The flavour.
        usable: Returns whether a module with some parameters can be of use on a mission; by default all are.
        can_fire: Returns whether a condition with some parameters can fire on a mission. The canonical form has no
            transitions that cannot, and moves do not draw their conditions.
    """

    def __init__(self, flavour: str, usable: Usable = always, can_fire: Usable = always) -> None:
        self._flavour = flavour
        self._usable = usable
        self._conditions, self._dead = firing(modules_of(flavour)[1].values(), can_fire)

    def simple(self, draws: Draws) -> list[dict[str, Value]]:
        """The configurations of simple machines, in random order."""
        return [self._configuration(one.states) for one in simple_machines(self._flavour, self._usable, draws)]

    def canonical(self, configuration: Mapping[str, Value]) -> dict[str, Value]:
        """The configuration that stands for all whose PFSMs are the same but for the numbering and what cannot fire."""
        return self._configuration(to_states(configuration, self._flavour))

    def neighbour(self, configuration: Mapping[str, Value], draws: Draws) -> dict[str, Value]:
        """A configuration whose PFSM is one move or a few away, in canonical form."""
        states = _States(to_states(configuration, self._flavour), self._flavour, self._conditions, draws)
        return self._configuration(states.moved())

    def _configuration(self, states: Sequence[State]) -> dict[str, Value]:
        return from_states(_canonical(_firing(states, self._dead) if self._dead else states), self._flavour)


def canonical(pfsm: Pfsm) -> Pfsm:
    """The same PFSM, its states in the order in which a search from the initial one finds them.

    States that cannot be reached are dropped. Transitions are sorted, as they are tested in random order; only if two
    are alike, and lead to states of the same behaviour, does the order of these decide.
    """
    return replace(pfsm, states=_canonical(pfsm.states))


def _firing(states: Sequence[State], dead: Collection[tuple[str, float]]) -> list[State]:
    """The states without transitions that cannot fire.

    In the grammar only the state of a PFSM of one state has no transition. So another state of which none can fire
    keeps one, to the initial state.
    """

    def fires(edge: Transition) -> bool:
        return (edge.condition, label_of(edge.module, edge.parameters)) not in dead

    found = []
    for i, state in enumerate(states):
        edges = tuple(filter(fires, state.transitions))
        if not edges and i > 0 and state.transitions:
            kept = min(state.transitions, key=lambda edge: (edge.condition, edge.parameters))
            edges = (kept._replace(target=0),)
        found.append(state if edges == state.transitions else state._replace(transitions=edges))
    return found


def _canonical(states: Sequence[State]) -> tuple[State, ...]:
    def ranked(edges: Sequence[Transition], places: Sequence[int]) -> Sequence[Transition]:
        if len(edges) < 2:
            return edges
        return sorted(
            edges,
            key=lambda edge: (edge.condition, edge.parameters, states[edge.target].behaviour, places[edge.target]),
        )

    numbers = range(len(states))
    edges = [ranked(state.transitions, numbers) for state in states]
    order = [0]
    for i in order:
        order += dict.fromkeys(edge.target for edge in edges[i] if edge.target not in order)
    if order == list(numbers):  # as most are: a race asks for tens of thousands
        return tuple(
            State(state.behaviour, state.parameters, tuple(own)) for state, own in zip(states, edges, strict=True)
        )
    place = [0] * len(states)
    for new, old in enumerate(order):
        place[old] = new
    return tuple(
        State(
            states[i].behaviour,
            states[i].parameters,
            tuple(Transition(edge.condition, edge.parameters, place[edge.target]) for edge in ranked(edges[i], place)),
        )
        for i in order
    )


class _States:
    """States of a PFSM that are being changed. A move returns whether it was possible.

    Args:
        states: Of the PFSM.
        flavour: Of its behaviours.
        conditions: What new conditions are drawn from.
        draws: Makes all random draws.
    """

    def __init__(self, states: Sequence[State], flavour: str, conditions: Sequence[Module], draws: Draws) -> None:
        self.states = list(states)
        self._draws = draws
        self._behaviours = tuple(modules_of(flavour)[0].values())
        self._max_states, self._max_transitions = limits_of(flavour)
        self._conditions = conditions

    def moved(self) -> list[State]:
        """The states after a move, or with decreasing probability more."""
        often = (self.tune,) * 4 + (self.change_behaviour, self.change_condition) * 2
        moves = (
            *often,
            self.redirect,
            self.add_transition,
            self.drop_transition,
            self.add_state,
            self.split_state,
            self.drop_state,
        )
        make_moves(moves, self._draws)
        return self.states

    def tune(self) -> bool:
        """Another value of a parameter."""
        places = [place for place in self._places() if self._at(*place).parameters]
        if not places:
            return False
        place = self._any_of(places)
        one = self._at(*place)
        k = self._any_of(range(len(one.parameters)))
        value = near(one.module.parameters[k], one.parameters[k], self._draws)
        self._put(*place, one._replace(parameters=(*one.parameters[:k], value, *one.parameters[k + 1 :])))
        return True

    def change_behaviour(self) -> bool:
        i = self._any_of(range(len(self.states)))
        others = [m for m in self._behaviours if m.name != self.states[i].behaviour]
        if not others:
            return False
        module = self._any_of(others)
        self.states[i] = self.states[i]._replace(behaviour=module.name, parameters=self._values(module))
        return True

    def change_condition(self) -> bool:
        if not (edges := self._edges()):
            return False
        i, j = self._any_of(edges)
        edge = self.states[i].transitions[j]
        if not (others := [m for m in self._conditions if m.name != edge.condition]):
            return False
        module = self._any_of(others)
        self._put(i, j, edge._replace(condition=module.name, parameters=self._values(module)))
        return True

    def redirect(self) -> bool:
        """Another target of a transition."""
        edges = self._edges()
        if len(self.states) <= 2 or not edges:
            return False
        i, j = self._any_of(edges)
        edge = self.states[i].transitions[j]
        others = [k for k in range(len(self.states)) if k not in (i, edge.target)]
        self._put(i, j, edge._replace(target=self._any_of(others)))
        return True

    def add_transition(self) -> bool:
        free = self._free()
        if len(self.states) == 1 or not free:
            return False
        i = self._any_of(free)
        self._connect(i, self._any_of([k for k in range(len(self.states)) if k != i]))
        return True

    def drop_transition(self) -> bool:
        """The grammar has one at least in each state."""
        edges = [(i, j) for i, j in self._edges() if len(self.states[i].transitions) > 1]
        if not edges:
            return False
        i, j = self._any_of(edges)
        edges_of = self.states[i].transitions
        self.states[i] = self.states[i]._replace(transitions=edges_of[:j] + edges_of[j + 1 :])
        return True

    def add_state(self) -> bool:
        """A new state, with a transition to it and one from it."""
        free = self._free()
        if len(self.states) == self._max_states or not free:
            return False
        new, i = len(self.states), self._any_of(free)
        module = self._any_of(self._behaviours)
        self.states.append(State(module.name, self._values(module)))
        self._connect(i, new)
        self._connect(new, self._any_of(range(new)))
        return True

    def split_state(self) -> bool:
        """A copy of a state takes over each transition to it with probability 1/2, and one leads to it."""
        free = self._free()
        if len(self.states) == self._max_states or not free:
            return False
        new, i = len(self.states), self._any_of(free)
        for k, state in enumerate(self.states):
            moved = (
                edge._replace(target=new) if edge.target == i and self._draws.random() < 1 / 2 else edge
                for edge in state.transitions
            )
            self.states[k] = state._replace(transitions=tuple(moved))
        self.states.append(self.states[i])
        self._connect(i, new)
        if not self.states[new].transitions:
            self._connect(new, i)
        return True

    def drop_state(self) -> bool:
        """Each transition to it leads to the target of one of its own instead."""
        n = len(self.states)
        if n == 1:
            return False
        gone = self._any_of(range(n))
        after = [edge.target for edge in self.states[gone].transitions]
        rest = [k for k in range(n) if k != gone]
        for k in rest:
            edges = (
                edge._replace(target=self._any_of(after)) if edge.target == gone else edge
                for edge in self.states[k].transitions
            )
            kept = tuple(edge._replace(target=rest.index(edge.target)) for edge in edges if edge.target != k)
            self.states[k] = self.states[k]._replace(transitions=kept)
        del self.states[gone]
        for k, state in enumerate(self.states):
            if not state.transitions and n > 2 and self._conditions:
                self._connect(k, self._any_of([other for other in range(n - 1) if other != k]))
        return True

    def _connect(self, i: int, target: int) -> None:
        module = self._any_of(self._conditions)
        edge = Transition(module.name, self._values(module), target)
        self.states[i] = self.states[i]._replace(transitions=(*self.states[i].transitions, edge))

    def _free(self) -> list[int]:
        """States that may have one more transition; none where no condition can fire."""
        return [
            i
            for i, state in enumerate(self.states)
            if self._conditions and len(state.transitions) < self._max_transitions
        ]

    def _edges(self) -> list[tuple[int, int]]:
        """State and place of each transition."""
        return [(i, j) for i, state in enumerate(self.states) for j in range(len(state.transitions))]

    def _places(self) -> list[tuple[int, int | None]]:
        """Those of all modules; None is the state's own."""
        return [*((i, None) for i in range(len(self.states))), *self._edges()]

    def _at(self, i: int, j: int | None) -> State | Transition:
        return self.states[i] if j is None else self.states[i].transitions[j]

    def _put(self, i: int, j: int | None, one: State | Transition) -> None:
        if isinstance(one, State):
            self.states[i] = one
            return
        edges = list(self.states[i].transitions)
        edges[j or 0] = one
        self.states[i] = self.states[i]._replace(transitions=tuple(edges))

    def _values(self, module: Module) -> tuple[float, ...]:
        return drawn_values(module, self._draws)

    def _any_of(self, some: Sequence[T]) -> T:
        return any_of(some, self._draws)
