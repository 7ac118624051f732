"""Many configurations as the rows of a table of numbers, so that numpy works on all of them at once.

The table has a column for each variable parameter. A category is its index; any other value is its place in the unit
interval (`Parameter.position`); NaN means that the parameter is inactive.
"""

import math
from collections.abc import Hashable, Sequence

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from mercator_design.arrays import Floats
from mercator_design.race.space.parameter import Bounds, Configuration, Parameter, Value
from mercator_design.race.space.space import Space

_MAX_LISTED = 10_000
"""What follows from the values of other parameters is kept if there are at most so many combinations of these."""
_MAX_KEPT = 1000
"""Of so many values of each parameter the numbers are kept."""


class Encoding:
    """The encoding of a space's configurations.

    Attributes:
        space: The space of the configurations.
        is_category: Which columns are of categorical parameters, shape (columns,).
        n_values: Number of values of each column's parameter; infinite if real, NaN if its bounds depend on others.
    """

    def __init__(self, space: Space) -> None:
        self.space = space
        self.is_category = np.array([p.kind == "categorical" for p in space.variable], dtype=bool)
        self.n_values = np.array([math.nan if p.is_dependent else _n_values(p, p.bounds({})) for p in space.variable])
        self._columns = {p.name: column for column, p in enumerate(space.variable)}
        self._others = {p.name: p.bound_names for p in space.variable}
        self._kept: dict[str, dict[Hashable, float]] = {p.name: {} for p in space.variable}  # numbers of values
        is_whole = np.isfinite(self.n_values) & ~self.is_category
        is_log = np.array([p.log for p in space.variable], dtype=bool)
        self._whole, self._log = np.flatnonzero(is_whole & ~is_log), np.flatnonzero(is_whole & is_log)
        self._lowest = np.array([bounds[0] for k in self._log if (bounds := space.variable[k].bounds({})) is not None])
        levels = np.array([space.levels[p.name] if p.depends_on else 0 for p in space.variable])
        self._levels = [_Level(self, np.flatnonzero(levels == level)) for level in np.unique(levels[levels > 0])]

    def rows(self, configurations: Sequence[Configuration]) -> Floats:
        """The rows of configurations, shape (configurations, columns)."""
        found = np.full((len(configurations), self.space.n_variable), math.nan)
        for row, configuration in enumerate(configurations):
            for name, value in configuration.items():
                if (column := self._columns.get(name)) is None:
                    continue
                others = self._others[name]
                key = (value, *map(configuration.get, others)) if others else value
                kept = self._kept[name]
                if key not in kept:
                    if len(kept) == _MAX_KEPT:
                        kept.clear()
                    kept[key] = self._number(self.space[name], value, configuration)
                found[row, column] = kept[key]
        return found

    def configuration(self, row: Floats) -> Configuration:
        """The configuration of a row."""
        places = row.tolist()
        return self.space.build(lambda p, bounds: _value(p, places[self._columns[p.name]], bounds))

    def uniform(self, n: int, generator: Generator) -> Floats:
        """Rows with values for all parameters, also for inactive ones, each uniform over its domain."""
        found: Floats = generator.random((n, self.space.n_variable))
        found[:, self.is_category] = np.floor(found[:, self.is_category] * self.n_values[self.is_category])
        return found

    def settled(self, rows: Floats) -> Floats:
        """Rows of configurations, from rows with values for all parameters: those of inactive ones are dropped.

        The place of a whole number or of an ordered value is moved to the middle of this value's part.
        """
        rows = rows.copy()
        rows[:, self._whole] = _middle(rows[:, self._whole], self.n_values[self._whole])
        if len(self._log):
            low, n_values = self._lowest, self.n_values[self._log]
            start, width = np.log(low), np.log(low + n_values) - np.log(low)
            above = np.floor(np.exp(start + width * rows[:, self._log]) - low)
            rows[:, self._log] = (np.log(low + np.clip(above, 0, n_values - 1) + 0.5) - start) / width
        for level in self._levels:
            level.settle(rows)
        return rows

    def parents(self, parameter: Parameter) -> list[int]:
        """The columns from which a parameter's activity and bounds follow."""
        found: list[int] = []
        for name in parameter.depends_on:
            found += self.parents(self.space[name]) if self.space[name].is_fixed else [self._columns[name]]
        return list(dict.fromkeys(found))

    def size(self, parameter: Parameter, row: Floats) -> float:
        """Number of values of a parameter by what it depends on in a row; 0 if it is inactive."""
        chosen: Configuration = {}
        for name in parameter.depends_on:
            self._put(name, row, chosen)
        if parameter.condition is not None and not parameter.condition.holds(chosen):
            return 0.0
        return _n_values(parameter, parameter.bounds(chosen))

    @staticmethod
    def _number(parameter: Parameter, value: Value, configuration: Configuration) -> float:
        if parameter.kind == "categorical":
            return float(parameter.values.index(str(value)))
        bounds = parameter.bounds(configuration)
        return math.nan if bounds is None else parameter.position(value, bounds)

    def _put(self, name: str, row: Floats, chosen: Configuration) -> None:
        """Add the value of a parameter in a row to those chosen, if it is active."""
        parameter = self.space[name]
        if parameter.is_fixed:
            if self.size(parameter, row):
                chosen[name] = parameter.values[0]
        elif not math.isnan(place := float(row[self._columns[name]])):
            for other in parameter.bound_names:
                self._put(other, row, chosen)
            bounds = parameter.bounds(chosen)
            if bounds is not None:
                chosen[name] = _value(parameter, place, bounds)


class _Level:
    """Columns of one level: activity and bounds of their parameters follow from columns of lower levels, their parents.

    For each column there is a table of the numbers of values by the values of the parents; NaN: not computed yet.
    Where parents have too many values, the table has one entry, which is not used.

    Args:
        encoding: Of the space.
        columns: Of the level.
    """

    def __init__(self, encoding: Encoding, columns: NDArray[np.intp]) -> None:
        variable = encoding.space.variable
        self._encoding = encoding
        self._columns = columns
        self._parameters = [variable[column] for column in columns]
        self._is_moved = np.array([p.is_dependent and p.kind != "real" for p in self._parameters])
        parents = [encoding.parents(p) for p in self._parameters]
        counts = [[math.inf if variable[k].log else encoding.n_values[k] + 1 for k in own] for own in parents]
        is_listed = np.array([np.prod(own) <= _MAX_LISTED for own in counts])
        self._listed, self._others = np.flatnonzero(is_listed), np.flatnonzero(~is_listed)
        self._parents = sorted({k for place in self._listed for k in parents[place]})
        self._inactive = encoding.n_values[self._parents]
        self._scales = np.where(encoding.is_category[self._parents], 1.0, self._inactive)
        self._strides = np.zeros((len(self._parents), len(columns)))
        sizes = [1] * len(columns)
        for place in self._listed:
            for parent, stride in zip(parents[place], np.cumprod([1.0, *counts[place]])[:-1], strict=True):
                self._strides[self._parents.index(parent), place] = stride
            sizes[place] = int(np.prod(counts[place]))
        self._starts = np.cumsum([0, *sizes[:-1]])
        self._known = np.full(sum(sizes), math.nan)

    def settle(self, rows: Floats) -> None:
        """Drop the values of inactive parameters, and move those of whole numbers whose bounds follow from others."""
        sizes = self._sizes(rows)
        places = np.where(sizes == 0, math.nan, rows[:, self._columns])
        if self._is_moved.any():
            places[:, self._is_moved] = _middle(places[:, self._is_moved], sizes[:, self._is_moved])
        rows[:, self._columns] = places

    def _sizes(self, rows: Floats) -> Floats:
        """Numbers of values, 0 if inactive; shape (rows, columns)."""
        places = rows[:, self._parents]
        codes = np.where(np.isnan(places), self._inactive, np.floor(places * self._scales))
        entries = self._starts + (codes @ self._strides).astype(np.intp)
        found: Floats = self._known[entries]
        is_unknown = np.isnan(found)
        is_unknown[:, self._others] = False
        if is_unknown.any():
            for entry, first in zip(*np.unique(np.where(is_unknown, entries, -1), return_index=True), strict=True):
                if entry >= 0:
                    row, column = divmod(int(first), len(self._columns))
                    self._known[entry] = self._encoding.size(self._parameters[column], rows[row])
            found = self._known[entries]
        for place in self._others:
            found[:, place] = [self._encoding.size(self._parameters[place], row) for row in rows]
        return found


def _value(parameter: Parameter, place: float, bounds: Bounds) -> Value:
    return parameter.values[int(place)] if parameter.kind == "categorical" else parameter.quantile(place, bounds)


def _n_values(parameter: Parameter, bounds: Bounds | None) -> float:
    """Number of values within bounds, 0 if these are NA."""
    if bounds is None:
        return 0.0
    return math.inf if parameter.kind == "real" else float(bounds[1] - bounds[0] + 1)


def _middle(places: Floats, n_values: Floats) -> Floats:
    """Places moved to the middle of their values' parts; n_values as the places, or one for each column."""
    with np.errstate(invalid="ignore"):  # of inactive parameters
        return (np.minimum(np.floor(places * n_values), n_values - 1) + 0.5) / n_values
