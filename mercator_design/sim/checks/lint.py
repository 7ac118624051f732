"""What is wrong or superfluous in a PFSM or a behaviour tree: alone, or on a mission with a robot model."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.errors import FsmError
from mercator_design.fsm.pfsm import Pfsm, State, Transition
from mercator_design.missions.mission import Mission
from mercator_design.modules.architecture import Software, out_of_domain
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.reference import ReferenceModel
from mercator_design.sim.checks.findings import (
    NEGLIGIBLE,
    Finding,
    beta_of,
    chances_in,
    sense_findings,
    situations,
    why_never,
)
from mercator_design.sim.checks.tree_lint import tree_findings
from mercator_design.sim.robot_model import RobotModel
from mercator_design.software.architectures import architecture_of
from mercator_design.tree.tree import Tree


class Choice(NamedTuple):
    """A transition of a state: the probability of its condition in each situation, and its target."""

    chances: Sequence[float]
    target: int


def chances_of(target: int, choices: Sequence[Choice]) -> Floats:
    """The probability in each situation that a state changes to a target, its transitions tested in random order.

    If a transition is tested at the time t of [0, 1], each other is tested before with probability t. So it is taken
    with its own probability times the integral over t of the product of 1 - t p of the others: a polynomial whose
    degree is their number. n nodes of Gauss and Legendre are exact up to the degree 2 n - 1.
    """
    nodes, weights = np.polynomial.legendre.leggauss(len(choices) // 2 + 1)
    times = 0.5 * (nodes[:, np.newaxis] + 1.0)
    found = np.zeros(len(choices[0].chances))
    for k, choice in enumerate(choices):
        if choice.target == target:
            others = [1.0 - times * np.array(other.chances) for j, other in enumerate(choices) if j != k]
            product = np.prod(others, axis=0) if others else np.ones((len(times), 1))
            found += np.array(choice.chances) * (0.5 * weights @ product)
    return found


def _is_twin(one: Transition, other: Transition) -> bool:
    """Whether two transitions of a state have the same condition and target, but perhaps another probability beta."""
    free = int(beta_of(one) is not None)
    same = (one.condition, one.target) == (other.condition, other.target)
    return same and one.parameters[free:] == other.parameters[free:]


def lint(
    software: Software, names: Sequence[str], mission: Mission | None = None, model: RobotModel | None = None
) -> list[Finding]:
    """All findings on a PFSM, in the order of its states, or on a behaviour tree, in that of its nodes.

    Without a mission or a robot model, only findings that do not depend on it.

    Args:
        software: The control software.
        names: The names of its states.
        mission: The mission, if one is known.
        model: The robot model, if one is known.

    Raises:
        FsmError: It is a network.
    """
    if isinstance(software, Pfsm):
        return [*_Linter(software, names, mission, model).findings()]
    if isinstance(software, Tree):
        return [*tree_findings(software, mission, model)]
    noun = architecture_of(software.flavour).noun
    expected = "expected a PFSM or a behaviour tree, which have conditions to check"
    raise FsmError(f"{expected}, found a {noun} ({software.flavour}); `mdesign fsm explain` tells how it responds")


class _Linter:
    def __init__(self, pfsm: Pfsm, names: Sequence[str], mission: Mission | None, model: RobotModel | None) -> None:
        model = model and model.with_flavour(pfsm.flavour)
        self.pfsm, self.names, self.mission, self.model = pfsm, names, mission, model
        self.situations = situations(mission, model)
        reference = model.reference_model if model else flavour_of(pfsm.flavour).reference_model(ReferenceModel())
        self.chances = {
            (i, j): chances_in(self.situations, edge, reference, mission, model) for i, j, edge in self._edges()
        }
        self.dead = {place for place, chances in self.chances.items() if max(chances) <= NEGLIGIBLE}

    def findings(self) -> Iterator[Finding]:
        found: list[str] = []
        out_of_domain(self.pfsm, found.append)
        for one in found:
            place, _, words = one.partition(": ")
            yield Finding("out-of-domain", place, f"{words}; the original AutoMoDe would run it")
        linked, reached = self._reached(set()), self._reached(self.dead)
        for i, state in enumerate(self.pfsm.states):
            if i not in linked:
                yield Finding("unreachable-state", self._state(i), "no transition leads here from the initial state")
            elif i not in reached:
                yield Finding("unreachable-state", self._state(i), "only transitions that never fire lead here")
            else:
                yield from self._of_state(i, state)

    def _of_state(self, i: int, state: State) -> Iterator[Finding]:
        yield from sense_findings(self._state(i), state.module, self.mission, self.model)
        for j, edge in enumerate(state.transitions):
            place = self._transition(i, j)
            yield from sense_findings(place, edge.module, self.mission, self.model)
            if (i, j) in self.dead:
                why = why_never(edge, self.chances[i, j], self.situations, self.mission, self.model, "fires")
                yield Finding("never-fires", place, why)
            elif min(self.chances[i, j]) >= 1.0 - NEGLIGIBLE:
                message = "fires in every situation: all visits of its state last 2 cycles"
                yield Finding("always-fires", place, message)
        yield from self._superfluous(i, state)
        if len(self.pfsm.states) > 1 and all((i, j) in self.dead for j in range(len(state.transitions))):
            ends = "no transition leads out of it" if not state.transitions else "no transition out of it ever fires"
            yield Finding("absorbing-state", self._state(i), f"{ends}: a robot stays here to the end", is_note=True)

    def _superfluous(self, i: int, state: State) -> Iterator[Finding]:
        """Transitions without which the state changes as before, and those that could be one."""
        edges = state.transitions
        kept = [j for j in range(len(edges)) if (i, j) not in self.dead]
        for j in reversed(kept.copy()):
            without = [k for k in kept if k != j]
            if self._alike(i, [Choice(self.chances[i, k], edges[k].target) for k in without], kept):
                same = " or ".join(f"transition {k}" for k in without if edges[k].target == edges[j].target)
                yield Finding("shadowed", self._transition(i, j), f"has no effect beside {same}")
                kept = without
        for at, j in enumerate(kept):
            twins = [k for k in kept[:at] if _is_twin(edges[k], edges[j])]
            if twins:
                yield Finding("duplicate", self._transition(i, j), self._merged(i, twins[0], j, kept))

    def _merged(self, i: int, k: int, j: int, kept: Sequence[int]) -> str:
        """What to say of two transitions with the same condition and target."""
        edges = self.pfsm.states[i].transitions
        message = f"has the condition and the target of transition {k}"
        if (first := beta_of(edges[k])) is None or (second := beta_of(edges[j])) is None:
            return f"{message}, and the same parameters"
        beta = 1.0 - (1.0 - first) * (1.0 - second)
        both = [1.0 - (1.0 - p) * (1.0 - q) for p, q in zip(self.chances[i, k], self.chances[i, j], strict=True)]
        choices = [Choice(self.chances[i, other], edges[other].target) for other in kept if other not in (j, k)]
        if self._alike(i, [*choices, Choice(both, edges[j].target)], kept):
            return f"{message}: one transition with beta {beta:.4g} does the same"
        return f"{message}: together they fire with beta {beta:.4g}, and are tested more often before others"

    def _alike(self, i: int, choices: Sequence[Choice], kept: Sequence[int]) -> bool:
        """Whether a state with these transitions changes as with those that are kept, in every situation."""
        edges = self.pfsm.states[i].transitions
        before = [Choice(self.chances[i, j], edges[j].target) for j in kept]
        return bool(choices) and all(
            bool((np.abs(chances_of(target, choices) - chances_of(target, before)) <= NEGLIGIBLE).all())
            for target in {choice.target for choice in before}
        )

    def _reached(self, without: set[tuple[int, int]]) -> set[int]:
        """The states that the initial one leads to without some transitions."""
        found, waiting = set(), {0}
        while waiting:
            found |= waiting
            waiting = {edge.target for i, j, edge in self._edges() if i in found and (i, j) not in without} - found
        return found

    def _edges(self) -> Iterator[tuple[int, int, Transition]]:
        for i, state in enumerate(self.pfsm.states):
            for j, edge in enumerate(state.transitions):
                yield i, j, edge

    def _state(self, i: int) -> str:
        return f"state {i} ({self.names[i]})"

    def _transition(self, i: int, j: int) -> str:
        edge = self.pfsm.states[i].transitions[j]
        return f"{self._state(i)}, transition {j} ({edge.condition}, to {self.names[edge.target]})"
