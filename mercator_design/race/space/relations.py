"""What a parameter depends on, as values: conditions and bounds that need no expression in irace's language."""

from collections.abc import Mapping
from typing import NamedTuple


class ValueIn(NamedTuple):
    """A condition: another parameter, categorical or ordered, has one of some values."""

    name: str
    values: tuple[str, ...]

    @property
    def names(self) -> tuple[str]:
        return (self.name,)

    def holds(self, configuration: Mapping[str, float | str]) -> bool:
        return configuration.get(self.name) in self.values


class ValueAbove(NamedTuple):
    """A condition: another parameter, integer or real, is active and above a limit."""

    name: str
    limit: float

    @property
    def names(self) -> tuple[str]:
        return (self.name,)

    def holds(self, configuration: Mapping[str, float | str]) -> bool:
        return self.name in configuration and float(configuration[self.name]) > self.limit


class ValuePlus(NamedTuple):
    """A bound: another parameter, integer or real, plus a whole number; None where that is inactive."""

    name: str
    offset: int

    @property
    def names(self) -> tuple[str]:
        return (self.name,)

    @property
    def text(self) -> str:
        return f"{self.name}{self.offset:+d}"

    def __call__(self, configuration: Mapping[str, float | str]) -> float | None:
        value = configuration.get(self.name)
        return None if value is None or isinstance(value, str) else value + self.offset
