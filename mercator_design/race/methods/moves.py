"""Moves from configurations to new ones nearby: change a few parameters of one, or cross two.

The sampling model draws all parameters of a child again, so with many parameters most children lose what made their
parent good. A move changes only a few parameters. Values of parameters that become active are copied from another good
configuration or drawn uniformly; those of parameters that become inactive are dropped.
"""

from collections.abc import Sequence

from numpy.random import Generator

from mercator_design.race.space.parameter import Bounds, Configuration, Parameter, Value
from mercator_design.race.space.space import Space

_MORE_CHANGES = 0.5
"""One parameter changes, and a Poisson number of others with this mean."""
_STEP = 0.15
"""Standard deviation of a small step of a number, relative to the width of its domain."""


class Moves:
    """The moves of a space, with the draws of one generator.

    Args:
        space: The space of the configurations.
        generator: Makes all random draws.
        structure: Part of the mutations that use the space's structure, if it has one.
    """

    def __init__(self, space: Space, generator: Generator, *, structure: float = 0.0) -> None:
        self._space = space
        self._structure = space.structure if structure else None
        self._in_structure = structure
        self._generator = generator
        self._deciding = {name for parameter in space.parameters for name in parameter.depends_on}

    def uniform(self) -> Configuration:
        """A configuration with every active parameter uniform over its domain."""
        return self._space.build(self._anywhere)

    def mutated(self, parent: Configuration, donors: Sequence[Configuration]) -> Configuration:
        """A configuration with one or a few parameters changed; donors lend values to what becomes active."""
        if self._structure is None:
            return self._mutated(parent, donors)
        if self._generator.random() < self._in_structure:
            return self._structure.neighbour(parent, self._generator)
        return self._structure.canonical(self._mutated(parent, donors))

    def _mutated(self, parent: Configuration, donors: Sequence[Configuration]) -> Configuration:
        draws = self._generator
        names = [p.name for p in self._space.variable if p.name in parent]
        n = min(1 + int(draws.poisson(_MORE_CHANGES)), len(names))
        changed = {names[k] for k in draws.choice(len(names), size=n, replace=False).tolist()}
        if not changed & self._deciding:
            child = dict(parent)
            for name in names:
                parameter = self._space[name]
                if name in changed and (bounds := parameter.bounds(parent)) is not None:
                    child[name] = self._changed(parameter, parent[name], bounds)
            return child

        def choose(parameter: Parameter, bounds: Bounds) -> Value:
            value = parent.get(parameter.name)
            if value is not None and parameter.name in changed:
                return self._changed(parameter, value, bounds)
            if value is None and donors and draws.random() < 0.5:
                value = donors[int(draws.integers(len(donors)))].get(parameter.name)
            if value is None or not _fits(parameter, value, bounds):
                return self._anywhere(parameter, bounds)
            return value

        return self._space.build(choose)

    def crossed(self, one: Configuration, other: Configuration) -> Configuration:
        """A configuration in which each parameter has its value of one of two parents."""

        def choose(parameter: Parameter, bounds: Bounds) -> Value:
            values = [one.get(parameter.name), other.get(parameter.name)]
            if self._generator.random() < 0.5:
                values.reverse()
            for value in values:
                if value is not None and _fits(parameter, value, bounds):
                    return value
            return self._anywhere(parameter, bounds)

        return self._space.build(choose)

    def _anywhere(self, parameter: Parameter, bounds: Bounds) -> Value:
        if parameter.kind == "categorical":
            return parameter.values[int(self._generator.integers(len(parameter.values)))]
        return parameter.quantile(self._generator.random(), bounds)

    def _changed(self, parameter: Parameter, value: Value, bounds: Bounds) -> Value:
        """Another category; a number near the present one or anywhere, equally often."""
        draws = self._generator
        if parameter.kind == "categorical":
            others = [other for other in parameter.values if other != value]
            return others[int(draws.integers(len(others)))]
        if _fits(parameter, value, bounds) and draws.random() < 0.5:
            place = parameter.position(value, bounds) + _STEP * draws.normal()
            if 0 <= place <= 1:
                return parameter.quantile(place, bounds)
        return self._anywhere(parameter, bounds)


def _fits(parameter: Parameter, value: Value, bounds: Bounds) -> bool:
    """Whether a value may stay within the bounds that other parameters give."""
    return not parameter.is_numeric or bounds[0] <= float(value) <= bounds[1]
