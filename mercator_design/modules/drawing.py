"""Random draws of modules and their parameters, for searches in the structure of control software."""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

from mercator_design.modules.grammar import value_at
from mercator_design.modules.module import Module

T = TypeVar("T")

Usable = Callable[[Module, Sequence[float]], bool]
"""Whether a module with some parameters can be of use on a mission."""


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
