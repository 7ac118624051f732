"""Parts of the grammars of all architectures: parameters of a space, as plain values.

A grammar is the set of all control software of a flavour. Each architecture lists its parameters; a parameter of a
module is active only where the module is chosen.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from mercator_design.modules.module import Module, ModuleParameter

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


class Chosen(NamedTuple):
    """A module at a place of a grammar: its number there, and the names of its parameters."""

    name: str  # of the module
    number: str
    parameters: tuple[str, ...]  # their names
    are_whole: tuple[bool, ...]

    def values(self, configuration: Mapping[str, Value]) -> tuple[float, ...]:
        """The values of its parameters in a configuration."""
        return tuple([float(configuration[name]) for name in self.parameters])

    def put(self, configuration: dict[str, Value], values: Iterable[float]) -> None:
        """Enter the values of its parameters."""
        for name, value, is_whole in zip(self.parameters, values, self.are_whole, strict=True):
            configuration[name] = int(value) if is_whole else float(value)


def choices(modules: Mapping[int, Module], index: str) -> tuple[dict[str, Chosen], dict[str, Chosen]]:
    """The modules that may be chosen at a place, by number and by name."""
    found = [
        Chosen(
            module.name,
            str(number),
            tuple(parameter.stem + index for parameter in module.parameters),
            tuple(parameter.integer for parameter in module.parameters),
        )
        for number, module in modules.items()
    ]
    return {one.number: one for one in found}, {one.name: one for one in found}


def value_at(parameter: ModuleParameter, place: float) -> float:
    """The value at a place in [0, 1] of a parameter's domain."""
    low, high = parameter.sampled
    value = low * (high / low) ** place if parameter.log else low + place * (high - low)
    return float(round(value)) if parameter.integer else round(value, DIGITS)


def place_of(parameter: ModuleParameter, value: float) -> float:
    """The place of a value that may be sampled; the inverse of `value_at` but for rounding."""
    low, high = parameter.sampled
    return math.log(value / low) / math.log(high / low) if parameter.log else (value - low) / (high - low)


def numbers_text(table: Iterable[int]) -> tuple[str, ...]:
    """Numbers of modules as values of a category."""
    return tuple(map(str, table))


def module_parameters(table: Mapping[int, Module], index: str, chooser: str) -> Iterator[GrammarParameter]:
    """The parameters of the modules; modules may share one, active where any of them is chosen."""
    users: dict[str, list[int]] = {}
    found: dict[str, ModuleParameter] = {}
    for number, module in table.items():
        for parameter in module.parameters:
            users.setdefault(parameter.stem, []).append(number)
            found[parameter.stem] = parameter
    for stem, parameter in found.items():
        low, high = parameter.sampled
        digits = 0 if parameter.integer else DIGITS
        name, switch = f"{stem}{index}", f"--{parameter.flag}{index} "
        condition = (chooser, numbers_text(users[stem]))
        yield GrammarParameter(name, switch, low=low, high=high, digits=digits, condition=condition)
