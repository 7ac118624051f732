"""What may be configured: parameters with domains and conditions, as in irace's parameters.txt.

A configuration is a dict of the active parameters' values: text for categorical and ordered parameters,
numbers for the others; the name of an inactive parameter is absent. A condition that is NA, because it looks
at an inactive parameter, makes a parameter inactive, and so does a bound that is NA.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Protocol

from numpy.random import Generator

from mercator_design.errors import RaceError
from mercator_design.race.space.expressions import Expression
from mercator_design.race.space.parameter import Bounds, Configuration, Parameter, Value
from mercator_design.race.space.r_operators import number_text

_FEW = 1000
"""Values of a parameter that are worth remembering."""


class Structure(Protocol):
    """What configurations of a space mean, as only their owner knows."""

    def canonical(self, configuration: Configuration) -> Configuration:
        """The one that stands for all that mean the same."""
        ...

    def neighbour(self, configuration: Configuration, draws: Generator) -> Configuration:
        """One nearby in meaning, in canonical form."""
        ...


class Space:
    """Parameters in file order, which is also their order on a command line, and what may not be combined.

    Attributes:
        parameters: in file order.
        levels: name -> 1 for what depends on nothing, else one more than what it depends on.
        variable: the parameters that are not fixed, in file order.
        n_variable: how many those are (irace's nbVariable); conditional ones count.
        forbidden: expressions no configuration may satisfy.
        structure: what configurations mean beyond the values of their parameters, if anything is known of it.
        notes: what a user should know of the text that it was read from.

    Raises:
        RaceError: a name is used twice, unknown or circular; a bound depends on a parameter that is not
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
            self._find_level(parameter, ())
        self.variable = tuple(p for p in self.parameters if not p.is_fixed)
        self.n_variable = len(self.variable)
        self._order = {p.name: place for place, p in enumerate(self.parameters)}
        self._prepare()

    def __getitem__(self, name: str) -> Parameter:
        return self._by_name[name]

    def build(self, choose: Callable[[Parameter, Bounds], Value]) -> Configuration:
        """A configuration in which each active parameter gets the chosen value, or its only one.

        Args:
            choose: called by level, with the bounds that hold for what was chosen before.
        """
        chosen: Configuration = {}
        waiting = [list(places) for places in self._always]  # places of parameters to look at, by level
        for places in waiting:
            places.sort()
            for place in places:
                parameter, bounds = self._steps[place]
                if parameter.name in self._conditional and not self._is_active(parameter, chosen):
                    continue
                bounds = bounds or parameter.bounds(chosen)
                if bounds is None:
                    continue
                value = parameter.values[0] if parameter.is_fixed else choose(parameter, bounds)
                chosen[parameter.name] = value
                if parameter.name in self._children:
                    for level, child in self._active_children(parameter.name, value):
                        waiting[level].append(child)
        return dict(sorted(chosen.items(), key=lambda item: self._order[item[0]]))

    def _prepare(self) -> None:
        """Sort parameters by what must be known before they are looked at.

        Most are active where one other has certain values of few. Those are looked at only where they are active.
        """
        in_order = sorted(self.parameters, key=lambda p: self.levels[p.name])
        self._steps = [(p, None if p.is_dependent else p.bounds({})) for p in in_order]
        self._always: list[list[int]] = [[] for _ in range(max(self.levels.values(), default=0))]
        self._conditional: set[str] = set()
        self._children: dict[str, list[int]] = {}
        self._active: dict[tuple[str, Value], list[tuple[int, int]]] = {}
        for place, parameter in enumerate(in_order):
            names = () if parameter.condition is None else parameter.condition.names
            if len(names) == 1 and _has_few_values(self._by_name[names[0]]) and not self._is_active(parameter, {}):
                self._children.setdefault(names[0], []).append(place)
                continue
            self._always[self.levels[parameter.name] - 1].append(place)
            if parameter.condition is not None:
                self._conditional.add(parameter.name)

    def _active_children(self, name: str, value: Value) -> list[tuple[int, int]]:
        """Level and place of each parameter that a value makes active."""
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
        """Raise a RaceError unless exactly the active parameters have values, each within its domain."""
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
                raise RaceError(f"configuration: expected none that satisfies {expression.text}, which is forbidden")

    def is_forbidden(self, configuration: Mapping[str, Value]) -> bool:
        """Whether a forbidden expression is true; NA is not."""
        return any(expression.holds(configuration) for expression in self.forbidden)

    def key(self, configuration: Mapping[str, Value]) -> tuple[Value | None, ...]:
        """The values in file order, None where inactive: equal for equal configurations."""
        return tuple(map(configuration.get, self._by_name))

    def command_line(self, configuration: Mapping[str, Value]) -> str:
        """Switches and values joined by blanks, as irace hands them to a program."""
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
            for name in _depends_on(parameter):
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

    def _find_level(self, parameter: Parameter, path: tuple[str, ...]) -> int:
        if parameter.name in path:
            raise RaceError(f"parameter '{parameter.name}': depends on itself ({' -> '.join((*path, parameter.name))})")
        if parameter.name not in self.levels:
            path = (*path, parameter.name)
            below = [self._find_level(self._by_name[name], path) for name in _depends_on(parameter)]
            self.levels[parameter.name] = 1 + max(below, default=0)
        return self.levels[parameter.name]


def _has_few_values(parameter: Parameter) -> bool:
    if parameter.kind == "real" or parameter.is_dependent:
        return False
    low, high = parameter.bounds({}) or (0, 0)
    return high - low < _FEW


def _depends_on(parameter: Parameter) -> tuple[str, ...]:
    condition = parameter.condition.names if parameter.condition is not None else ()
    return (*parameter.bound_names, *condition)
