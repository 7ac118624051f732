"""How far a race has converged: how different the new configurations of each iteration are from each other.

This is measured on the configurations, so it holds for every method. It is 1 for uniform draws, 0 for equal
configurations. Of a categorical or ordered parameter it is the probability that two configurations differ (Gini and
Simpson); of a number, the standard deviation on the unit scale. Parameters count as often as they are active.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mercator_design.race.session.record import Record
from mercator_design.race.space.parameter import Configuration, Parameter
from mercator_design.race.space.space import Space

_UNIFORM = math.sqrt(1.0 / 12.0)
"""Standard deviation of uniform draws from the unit interval."""


class Spread(NamedTuple):
    """How different the new configurations of an iteration are; NaN if there are no such parameters."""

    iteration: int
    configurations: int
    categories: float
    numbers: float


def spreads(space: Space, record: Record) -> list[Spread]:
    """The spread of the configurations that were new in each iteration, where there were at least two."""
    new: dict[int, list[Configuration]] = {}
    for number, iteration in first_iterations(record).items():
        new.setdefault(iteration, []).append(record.configurations[number])
    return [_spread(space, iteration, several) for iteration, several in sorted(new.items()) if len(several) > 1]


def first_iterations(record: Record) -> Mapping[int, int]:
    """The iteration in which each configuration was raced first."""
    found: dict[int, int] = {}
    for number in sorted(record.experiments):
        one = record.experiments[number]
        found.setdefault(one.configuration, one.iteration)
    return found


def _spread(space: Space, iteration: int, configurations: Sequence[Configuration]) -> Spread:
    sums = {"categories": [0.0, 0.0], "numbers": [0.0, 0.0]}
    for parameter in space.variable:
        active = [one for one in configurations if parameter.name in one]
        kind, spread = _of(parameter, active)
        if not math.isnan(spread):
            sums[kind][0] += len(active) * spread
            sums[kind][1] += len(active)
    categories, numbers = (total / weight if weight else math.nan for total, weight in sums.values())
    return Spread(iteration, len(configurations), categories, numbers)


def _of(parameter: Parameter, configurations: Sequence[Configuration]) -> tuple[str, float]:
    n = len(configurations)
    if not parameter.is_numeric:
        counts = [sum(one[parameter.name] == value for one in configurations) for value in parameter.values]
        alike = sum(count * (count - 1) for count in counts) / (n * (n - 1)) if n > 1 else math.nan
        return "categories", (1.0 - alike) / (1.0 - 1.0 / len(parameter.values))
    places = []
    for one in configurations:
        bounds = parameter.bounds(one)
        if bounds is not None and bounds[0] < bounds[1]:
            places.append(parameter.position(one[parameter.name], bounds))
    return "numbers", float(np.std(places, ddof=1)) / _UNIFORM if len(places) > 1 else math.nan
