"""Simple PFSMs, for a search to begin with: one behaviour; or explore until a condition holds, then behave otherwise.

They are made from the modules of a flavour and of what is of use on a mission: no condition on a colour that the floor
does not have, no behaviour that follows a light where there is none.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, Protocol, TypeVar

from mercator_design.fsm.pfsm import Pfsm, State, Transition
from mercator_design.fsm.space.grammar import modules_of, value_at
from mercator_design.modules.behaviours import BEHAVIOURS
from mercator_design.modules.conditions import COLOUR_LABELS
from mercator_design.modules.module import Module

T = TypeVar("T")

Usable = Callable[[Module, Sequence[float]], bool]
"""Whether a module with some parameters can be of use on a mission."""


_SEARCH = next(module for module in BEHAVIOURS if module.name == "exploration")


class Draws(Protocol):
    """What is needed of a generator of random numbers, such as numpy's."""

    def random(self) -> float: ...

    def normal(self) -> float: ...


def any_of(some: Sequence[T], draws: Draws) -> T:
    """One of them, all equally likely."""
    return some[min(int(draws.random() * len(some)), len(some) - 1)]


def drawn_values(module: Module, draws: Draws) -> tuple[float, ...]:
    """Values of a module's parameters, uniform over their domains, or over the logarithm if these say so."""
    return tuple(value_at(parameter, draws.random()) for parameter in module.parameters)


class Kind(NamedTuple):
    """A condition; for floor colour, with its colour."""

    module: Module
    label: float = 1.0

    def values(self, draws: Draws) -> tuple[float, ...]:
        values = drawn_values(self.module, draws)
        return (*values[:-1], self.label) if self.module.colours else values


def simple_machines(flavour: str, usable: Usable, draws: Draws) -> list[Pfsm]:
    """One machine of each behaviour, and one of exploration with each condition and other behaviour, in random order.

    The second behaviour ends by another condition. In one half of the cases it reads the same senses, for example on a
    floor of another colour; in the other half it is any. Numbers are drawn by `drawn_values`.
    """
    behaviours = [one for one in modules_of(flavour)[0].values() if usable(one, (1.0, 1.0))]
    conditions = [one for one in kinds(flavour) if usable(one.module, (1.0, one.label))]

    def state(behaviour: Module, *transitions: Transition) -> State:
        return State(behaviour.name, drawn_values(behaviour, draws), transitions)

    def transition(kind: Kind, target: int) -> Transition:
        return Transition(kind.module.name, kind.values(draws), target)

    states: list[tuple[State, ...]] = [(state(one),) for one in behaviours]
    for there in conditions:
        others = [one for one in conditions if one != there] or [there]
        alike = [one for one in others if one.module.reads == there.module.reads] or [there]
        back = any_of((others, alike), draws)
        states += [
            (state(_SEARCH, transition(there, 1)), state(one, transition(any_of(back, draws), 0)))
            for one in behaviours
            if one != _SEARCH
        ]
    keys = [draws.random() for _ in states]
    return [Pfsm(states[k], flavour) for k in sorted(range(len(states)), key=keys.__getitem__)]


def kinds(flavour: str) -> Iterator[Kind]:
    """The conditions of a flavour, floor colour once for each colour."""
    for module in modules_of(flavour)[1].values():
        if module.colours:
            yield from (Kind(module, float(label)) for label in range(len(COLOUR_LABELS)))
        else:
            yield Kind(module)
