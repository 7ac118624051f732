"""A space: parameters with domains and conditions, as in irace's parameters.txt.

A configuration is a dict of the active parameters' values: text for categorical and ordered parameters, numbers for the
others; inactive parameters are not in it. A parameter is also inactive if its condition or a bound is NA, because these
depend on an inactive parameter.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Protocol

from numpy.random import Generator

from mercator_design.errors import RaceError
from mercator_design.race.space.expressions import Expression
from mercator_design.race.space.parameter import Bounds, Configuration, Parameter, Value
from mercator_design.race.space.r_operators import number_text

_MAX_CACHED = 1000
"""Largest number of values of a parameter for which the active children of each value are cached, and of bounds."""


class Structure(Protocol):
    """The meaning of the configurations of a space, for example that different ones are the same PFSM."""

    def canonical(self, configuration: Configuration) -> Configuration:
        """The canonical form of a configuration: equal for all configurations of the same meaning."""

    def neighbour(self, configuration: Configuration, draws: Generator) -> Configuration:
        """A configuration of a similar meaning, in canonical form."""

    def simple(self, draws: Generator) -> Sequence[Configuration]:
        """Configurations for a search to begin with, in canonical form and random order."""


class Space:
    """Parameters and forbidden combinations of their values.

    Attributes:
        parameters: The parameters in file order, which is also their order on a command line.
        levels: The level of each parameter, by name: 1 if it depends on no other, else one more than these.
        variable: The parameters that are not fixed, in file order.
        n_variable: Number of variable parameters (irace's nbVariable), conditional ones included.
        forbidden: Expressions that must not be true for a configuration.
        structure: The meaning of the configurations, if it is known.
        notes: Notes for the user on the text of the space.

    Raises:
        RaceError: A name is used twice, is unknown, or depends on itself; a bound depends on a parameter that is not
            numeric.
    """

    def __init__(
        self,
        parameters: Iterable[Parameter],
        *,
        forbidden: Iterable[Expression | str] = (),
        structure: Structure | None = None,
        notes: Iterable[str] = (),
    ) -> None:
        self.structure = structure
        self.notes = tuple(notes)
        self.parameters = tuple(parameters)
        self.forbidden = tuple(Expression(f) if isinstance(f, str) else f for f in forbidden)
        self._by_name = {p.name: p for p in self.parameters}
        self._check_names()
        self.levels: dict[str, int] = {}
        for parameter in self.parameters:
            self._find_level(parameter.name)
        self.variable = tuple(p for p in self.parameters if not p.is_fixed)
        self.n_variable = len(self.variable)
        self._order = {p.name: place for place, p in enumerate(self.parameters)}
        self._prepare()

    def __getitem__(self, name: str) -> Parameter:
        return self._by_name[name]

    def build(self, choose: Callable[[Parameter, Bounds], Value]) -> Configuration:
        """Build a configuration from the value that is chosen for each active parameter; fixed ones have their value.

        Args:
            choose: Called for each active variable parameter, level by level, with its bounds.
        """
        chosen: Configuration = {}
        waiting = [list(places) for places in self._always]  # the places of parameters to check, by level
        for places in waiting:
            places.sort()
            for place in places:
                parameter, name, bounds, is_conditional, is_parent = self._steps[place]
                if is_conditional and not self._is_active(parameter, chosen):
                    continue
                bounds = bounds or self._dependent_bounds(parameter, chosen)
                if bounds is None:
                    continue
                chosen[name] = value = parameter.values[0] if len(parameter.values) == 1 else choose(parameter, bounds)
                if is_parent:
                    for level, child in self._active_children(name, value):
                        waiting[level].append(child)
        return {name: chosen[name] for name in sorted(chosen, key=self._order.__getitem__)}

    def _prepare(self) -> None:
        """Sort the parameters by level, and find those that need not be checked in each configuration.

        Most parameters are active for some values of one other parameter. They are checked only for these values.
        """
        in_order = sorted(self.parameters, key=lambda p: self.levels[p.name])
        self._always: list[list[int]] = [[] for _ in range(max(self.levels.values(), default=0))]
        self._children: dict[str, list[int]] = {}
        self._active: dict[tuple[str, Value], list[tuple[int, int]]] = {}
        conditional: set[str] = set()
        for place, parameter in enumerate(in_order):
            names = () if parameter.condition is None else parameter.condition.names
            if len(names) == 1 and _has_few_values(self._by_name[names[0]]) and not self._is_active(parameter, {}):
                self._children.setdefault(names[0], []).append(place)
                continue
            self._always[self.levels[parameter.name] - 1].append(place)
            if parameter.condition is not None:
                conditional.add(parameter.name)
        self._steps = [
            (p, p.name, None if p.is_dependent else p.bounds({}), p.name in conditional, p.name in self._children)
            for p in in_order
        ]
        self._others = {p.name: p.bound_names for p in in_order}
        self._bounds: dict[tuple[Value | None, ...], Bounds | None] = {}

    def _dependent_bounds(self, parameter: Parameter, chosen: Configuration) -> Bounds | None:
        """Bounds that depend on other parameters; kept by the values of these."""
        key = (parameter.name, *map(chosen.get, self._others[parameter.name]))
        if key not in self._bounds:
            if len(self._bounds) == _MAX_CACHED:
                self._bounds.clear()
            self._bounds[key] = parameter.bounds(chosen)
        return self._bounds[key]

    def _active_children(self, name: str, value: Value) -> list[tuple[int, int]]:
        """The level and place of each parameter that a value makes active."""
        found = self._active.get((name, value))
        if found is None:
            children = [(self._steps[place][0], place) for place in self._children[name]]
            found = [(self.levels[p.name] - 1, place) for p, place in children if self._is_active(p, {name: value})]
            self._active[name, value] = found
        return found

    @staticmethod
    def _is_active(parameter: Parameter, chosen: Configuration) -> bool:
        return parameter.condition is None or parameter.condition.holds(chosen)

    def check(self, configuration: Mapping[str, Value]) -> None:
        """Check that exactly the active parameters have values, each within its domain, and that it is not forbidden.

        Raises:
            RaceError: It is not so; with the parameter.
        """
        unknown = configuration.keys() - self._by_name.keys()
        if unknown:
            raise RaceError(f"configuration: expected names of parameters, found '{min(unknown)}'")

        def given(parameter: Parameter, bounds: Bounds) -> Value:
            if parameter.name not in configuration:
                raise RaceError(f"parameter '{parameter.name}': expected a value in {parameter.domain}, found none")
            parameter.check(configuration[parameter.name], bounds)
            return configuration[parameter.name]

        active = self.build(given)
        for name, value in active.items():
            if configuration.get(name) != value:
                found = repr(configuration[name]) if name in configuration else "none"
                raise RaceError(f"parameter '{name}': expected its only value '{value}', found {found}")
        for name, value in configuration.items():
            if name not in active:
                raise RaceError(f"parameter '{name}': expected no value as it is inactive, found {value!r}")
        for expression in self.forbidden:
            if expression.holds(configuration):
                raise RaceError(f"configuration: expected {expression.text} to be false, as it is forbidden")

    def is_forbidden(self, configuration: Mapping[str, Value]) -> bool:
        """Whether a forbidden expression is true; NA is not."""
        return any(expression.holds(configuration) for expression in self.forbidden)

    def command_line(self, configuration: Mapping[str, Value]) -> str:
        """The switches and values joined by blanks, as irace passes them to a program."""
        words = []
        for parameter in self.parameters:
            value = configuration.get(parameter.name)
            if value is not None:
                words.append(parameter.switch + (value if isinstance(value, str) else number_text(value)))
        return " ".join(words)

    def _check_names(self) -> None:
        seen: set[str] = set()
        for parameter in self.parameters:
            if parameter.name in seen:
                raise RaceError(f"parameter '{parameter.name}': expected a new name, found it twice")
            seen.add(parameter.name)
            for name in parameter.depends_on:
                if name not in self._by_name:
                    raise RaceError(f"parameter '{parameter.name}': expected names of parameters, found '{name}'")
            for name in parameter.bound_names:
                if not self._by_name[name].is_numeric:
                    raise RaceError(
                        f"parameter '{parameter.name}', domain {parameter.domain}: expected integer or real "
                        f"parameters in bounds, found '{name}', which is {self._by_name[name].kind}"
                    )
        for expression in self.forbidden:
            unknown = [n for n in expression.names if n not in self._by_name]
            if unknown:
                raise RaceError(f"forbidden {expression.text}: expected names of parameters, found '{unknown[0]}'")

    def _find_level(self, name: str) -> None:
        """Find the level of a parameter, and of those that it depends on; without recursion, as these may be many."""
        path = [name]  # each depends on the next
        while path:
            names = self._by_name[path[-1]].depends_on
            below = next((one for one in names if one not in self.levels), None)
            if below is None:
                self.levels[path.pop()] = 1 + max(map(self.levels.__getitem__, names), default=0)
            elif below in path:
                raise RaceError(f"parameter '{below}': depends on itself ({' -> '.join((*path, below))})")
            else:
                path.append(below)


def _has_few_values(parameter: Parameter) -> bool:
    if parameter.kind == "real" or parameter.is_dependent:
        return False
    low, high = parameter.bounds({}) or (0, 0)
    return high - low < _MAX_CACHED
