"""What is wrong or superfluous in a PFSM: alone, or on a mission with a robot model.

A condition is tried in all situations that a robot may be in: each reading of the ground, with each number of
neighbours. What is not known (a noisy ground, no mission) is taken to be anything, so a finding is certain.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from mercator_design.config.colours import COLOURS, LABELS, RGB
from mercator_design.fsm.pfsm import Pfsm, State, Transition
from mercator_design.missions.mission import Mission
from mercator_design.modules.architecture import out_of_domain
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.module import Module
from mercator_design.modules.reference import Readings, ReferenceModel
from mercator_design.plugins.registries import is_ours
from mercator_design.sim.checks.no_effect import ground_levels, readings_on, seen_colours
from mercator_design.sim.robot_model import RobotModel
from mercator_design.sim.robot_parts import LidarNeighbours, Uniform

NEGLIGIBLE = 1e-6
"""Probability a cycle below which a transition counts as one that never fires: once in a day of a robot."""
_MANY = 40
"""Number of neighbours up to which each is tried."""
_MAX_NEIGHBOURS = 1000
"""The maximum number of robots of a mission: it stands for all numbers above `_MANY`."""
_ANY_GROUND: tuple[RGB, ...] = (*(COLOURS[name] for name in LABELS), (64.0, 64.0, 64.0))
"""All that conditions distinguish; the last is between black and gray, where no condition holds."""


class _Choice(NamedTuple):
    """A transition of a state: the probability of its condition in each situation, and its target."""

    chances: Sequence[float]
    target: int


def _chance_of(target: int, choices: Sequence[_Choice], at: int) -> float:
    """The probability that a state changes to a target in a situation, with its transitions tested in random order.

    If a transition is tested at the time t of [0, 1], each other is tested before with probability t. So it is taken
    with its own probability times the integral over t of the product of 1 - t p of the others, which is a polynomial
    of at most the third degree: Simpson's rule is exact.
    """
    total = 0.0
    for choice in choices:
        if choice.target == target:
            others = [other.chances[at] for other in choices if other is not choice]
            half, whole = (math.prod(1.0 - time * p for p in others) for time in (0.5, 1.0))
            total += choice.chances[at] * (1.0 + 4.0 * half + whole) / 6.0
    return total


def _beta(edge: Transition) -> float | None:
    """The probability that is a condition's first parameter, if it has one."""
    return edge.parameters[0] if edge.module.has_beta else None


def _is_twin(one: Transition, other: Transition) -> bool:
    """Whether two transitions of a state have the same condition and target, but perhaps another probability beta."""
    free = int(_beta(one) is not None)
    same = (one.condition, one.target) == (other.condition, other.target)
    return same and one.parameters[free:] == other.parameters[free:]


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that a person should look at."""

    code: str  # the kind of finding, for programs
    place: str  # the state, or the transition
    message: str  # a sentence
    is_note: bool = False  # whether it may well be meant


def lint(
    pfsm: Pfsm, names: Sequence[str], mission: Mission | None = None, model: RobotModel | None = None
) -> list[Finding]:
    """All findings on a PFSM, in the order of its states; `names` are the names of the states.

    Without a mission or a robot model, only findings that do not depend on it.
    """
    return [*_Linter(pfsm, names, mission, model).findings()]


class _Linter:
    def __init__(self, pfsm: Pfsm, names: Sequence[str], mission: Mission | None, model: RobotModel | None) -> None:
        model = model and model.with_flavour(pfsm.flavour)
        self.pfsm, self.names, self.mission, self.model = pfsm, names, mission, model
        self.situations = _situations(mission, model)
        reference = model.reference_model if model else flavour_of(pfsm.flavour).reference_model(ReferenceModel())
        self.chances = {
            (i, j): [
                edge.module.probability(reference, each, edge.parameters) if self._is_judged(edge.module) else math.nan
                for each in self.situations
            ]
            for i, j, edge in self._edges()
        }
        self.dead = {place for place, chances in self.chances.items() if max(chances) <= NEGLIGIBLE}

    def _is_judged(self, module: Module) -> bool:
        """Whether the situations have all that a condition depends on; own ones may distinguish any colours."""
        if not module.reads <= {"ground", "neighbours"} or module.memory:
            return False
        if is_ours(module.function) or "ground" not in module.reads:
            return True
        return (
            self.mission is not None and self.model is not None and ground_levels(self.mission, self.model) is not None
        )

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
        yield from self._senses(self._state(i), state)
        for j, edge in enumerate(state.transitions):
            place = self._transition(i, j)
            yield from self._senses(place, edge)
            if (i, j) in self.dead:
                yield Finding("never-fires", place, self._why_never(edge, self.chances[i, j]))
            elif min(self.chances[i, j]) >= 1.0 - NEGLIGIBLE:
                message = "fires in every situation: all visits of its state last 2 cycles"
                yield Finding("always-fires", place, message)
        yield from self._superfluous(i, state)
        if len(self.pfsm.states) > 1 and all((i, j) in self.dead for j in range(len(state.transitions))):
            ends = "no transition leads out of it" if not state.transitions else "no transition out of it ever fires"
            yield Finding("absorbing-state", self._state(i), f"{ends}: a robot stays here to the end", is_note=True)

    def _senses(self, place: str, one: State | Transition) -> Iterator[Finding]:
        """Senses that the robot lacks, or that never have anything to read on the mission."""
        reads, name = one.module.reads, one.module.name
        if self.model is not None and (missing := sorted(reads - self.model.senses)):
            yield Finding(
                "missing-sense", place, f"{name} needs {' and '.join(missing)}, which {self.model.name} lacks"
            )
            return
        if self.mission is None or isinstance(one, Transition):
            return
        if "neighbours" in reads and self.mission.robots == 1:
            yield Finding("nothing-to-read", place, f"{name} reads neighbours, and one robot has none")
        if "light" in reads and not self.mission.lights:
            yield Finding("nothing-to-read", place, f"{name} reads the light, and {self.mission.name} has none")

    def _why_never(self, edge: Transition, chances: Sequence[float]) -> str:
        if (beta := _beta(edge)) is not None and beta <= NEGLIGIBLE:
            return f"never fires: its beta is {beta:g}"
        if (
            edge.module.labelled
            and "ground" in edge.module.reads
            and self.model is not None
            and not self.model.sees_colours
        ):
            return f"never fires: robot {self.model.name} sees only how bright the ground is"
        if "neighbours" in edge.module.reads:
            neighbours = max(int(each.neighbours) for each in self.situations)
            found = f"{max(chances):.1g} a cycle with at most {neighbours} neighbours"
            return f"never fires: its probability is {found}"
        if self.mission is not None and self.model is not None:
            return f"never fires: on {self.mission.name}, robots see {seen_colours(self.mission, self.model)}"
        return "never fires: no ground has such a colour"

    def _superfluous(self, i: int, state: State) -> Iterator[Finding]:
        """Transitions without which the state changes as before, and those that could be one."""
        edges = state.transitions
        kept = [j for j in range(len(edges)) if (i, j) not in self.dead]
        for j in reversed(kept.copy()):
            without = [k for k in kept if k != j]
            if self._alike(i, [_Choice(self.chances[i, k], edges[k].target) for k in without], kept):
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
        if (first := _beta(edges[k])) is None or (second := _beta(edges[j])) is None:
            return f"{message}, and the same parameters"
        beta = 1.0 - (1.0 - first) * (1.0 - second)
        both = [1.0 - (1.0 - p) * (1.0 - q) for p, q in zip(self.chances[i, k], self.chances[i, j], strict=True)]
        choices = [_Choice(self.chances[i, other], edges[other].target) for other in kept if other not in (j, k)]
        if self._alike(i, [*choices, _Choice(both, edges[j].target)], kept):
            return f"{message}: one transition with beta {beta:.4g} does the same"
        return f"{message}: together they fire with beta {beta:.4g}, and are tested more often before others"

    def _alike(self, i: int, choices: Sequence[_Choice], kept: Sequence[int]) -> bool:
        """Whether a state with these transitions changes as with those that are kept, in every situation."""
        edges = self.pfsm.states[i].transitions
        before = [_Choice(self.chances[i, j], edges[j].target) for j in kept]
        return bool(choices) and all(
            abs(_chance_of(target, choices, at) - _chance_of(target, before, at)) <= NEGLIGIBLE
            for target in {choice.target for choice in before}
            for at in range(len(self.situations))
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


def _situations(mission: Mission | None, model: RobotModel | None) -> list[Readings]:
    """All situations of a robot that conditions distinguish."""
    levels = ground_levels(mission, model) if mission is not None and model is not None else None
    numbers = [*range(_MANY + 1), _MAX_NEIGHBOURS]
    if mission is not None and model is not None and _counts_robots_alone(mission, model):
        numbers = [n for n in numbers if n < mission.robots]
    grounds = [
        readings_on(model, one) if model else Readings(ground_red=one[0], ground_green=one[1], ground_blue=one[2])
        for one in (_ANY_GROUND if levels is None else levels)
    ]
    return [ground._replace(neighbours=float(n)) for ground in grounds for n in numbers]


def _counts_robots_alone(mission: Mission, model: RobotModel) -> bool:
    """Whether a robot never counts more neighbours than there are: it counts no wall, and no robot as two."""
    if model.reference_model.neighbour_count_memory > 0.0:
        return False
    lidar, arena = model.lidar, mission.arena
    if not isinstance(model.neighbours, LidarNeighbours) or lidar is None:
        return True
    noise = lidar.noise
    jump = 0.0 if noise is None else 2.0 * noise.half_width if isinstance(noise, Uniform) else math.inf
    highest = max(model.body.height, arena.wall_height, *(box.height for box in arena.obstacles))
    return arena.room is None and highest <= lidar.height and jump < model.reference_model.cluster_distance
