"""Conditions and bounds of a parameter, as values instead of expressions in irace's language."""

from collections.abc import Mapping
from typing import Any, NamedTuple


class ValueIn(NamedTuple):
    """A condition: another parameter is active and has one of some values."""

    name: str
    values: tuple[str, ...] | range

    @property
    def names(self) -> tuple[str]:
        return (self.name,)

    def holds(self, configuration: Mapping[str, Any]) -> bool:
        return configuration.get(self.name) in self.values


class ValuePlus(NamedTuple):
    """A bound: another parameter, which is a number, plus a whole number; None where the parameter is inactive."""

    name: str
    offset: int

    @property
    def names(self) -> tuple[str]:
        return (self.name,)

    @property
    def text(self) -> str:
        return f"{self.name}{self.offset:+d}"

    def __call__(self, configuration: Mapping[str, Any]) -> float | None:
        value: float | None = configuration.get(self.name)
        return None if value is None else value + self.offset
