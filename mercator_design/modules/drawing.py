"""Random draws of modules and their parameters, for searches in the structure of control software."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple, Protocol, TypeVar

from mercator_design.modules.grammar import place_of, value_at
from mercator_design.modules.module import Module, ModuleParameter

T = TypeVar("T")

Usable = Callable[[Module, Sequence[float]], bool]
"""Whether a module with some parameters can be of use on a mission; with none instead, if they are not known."""

_ANOTHER_MOVE = 0.33
"""Probability of one more move after each."""
_MAX_TRIES = 1000
_ANYWHERE = 0.3
"""Probability that a number that is tuned is drawn anew."""
_STEP = 0.15
"""Standard deviation of a small step of a number, as a part of its domain."""


class Draws(Protocol):
    """A generator of random numbers, such as numpy's."""

    def random(self) -> float: ...

    def normal(self) -> float: ...


def any_of(some: Sequence[T], draws: Draws) -> T:
    """One of them, all equally likely."""
    return some[min(int(draws.random() * len(some)), len(some) - 1)]


def drawn_values(module: Module, draws: Draws) -> tuple[float, ...]:
    """Values of a module's parameters, uniform over their domains, or over the logarithm if these say so."""
    return tuple(value_at(parameter, draws.random()) for parameter in module.parameters)


def near(parameter: ModuleParameter, value: float, draws: Draws) -> float:
    """Another value of a parameter, mostly a small step away."""
    place = place_of(parameter, value) + _STEP * draws.normal()
    anywhere = draws.random() < _ANYWHERE or not 0 <= place <= 1
    return value_at(parameter, draws.random() if anywhere else place)


def make_moves(moves: Sequence[Callable[[], bool]], draws: Draws) -> None:
    """Make one of these moves, and with decreasing probability more; a flavour may have none that is possible.

    Args:
        moves: Change control software, and return whether that was possible.
        draws: Makes all random draws.
    """
    while True:
        any(any_of(moves, draws)() for _ in range(_MAX_TRIES))
        if draws.random() >= _ANOTHER_MOVE:
            return


def always(module: Module, parameters: Sequence[float]) -> bool:  # noqa: ARG001 - for any module
    """A module is of use, whatever the mission."""
    return True


class Kind(NamedTuple):
    """A condition; for one whose last parameter is a label, such as floor colour, with the label."""

    module: Module
    label: float = 1.0

    @property
    def strongest(self) -> tuple[float, ...]:
        """Parameters with which it holds wherever it may: beta is 1; none if it has others than beta and a label."""
        is_known = self.module.has_beta and len(self.module.parameters) == 1 + self.module.labelled
        return (1.0, self.label)[: len(self.module.parameters)] if is_known else ()

    def values(self, draws: Draws) -> tuple[float, ...]:
        values = drawn_values(self.module, draws)
        return (*values[:-1], self.label) if self.module.labelled else values


def firing(conditions: Iterable[Module], can_fire: Usable) -> tuple[list[Module], set[tuple[str, float]]]:
    """The conditions that can fire with some label, and the names and labels of all that cannot."""
    known = [*conditions]
    dead = {(one.module.name, one.label) for one in kinds_of(known) if not can_fire(one.module, one.strongest)}
    alive = {one.module.name for one in kinds_of(known) if (one.module.name, one.label) not in dead}
    return [module for module in known if module.name in alive], dead


def kinds_of(conditions: Iterable[Module]) -> Iterator[Kind]:
    """Conditions, floor colour once for each colour, and so others with a label."""
    for module in conditions:
        if module.labelled:
            yield from (Kind(module, float(label)) for label in range(len(module.parameters[-1].labels)))
        else:
            yield Kind(module)


def label_of(module: Module, parameters: Sequence[float]) -> float:
    """The label of a condition with these parameters, as in its Kind."""
    return parameters[-1] if module.labelled else 1.0
