"""The first configurations, draws from a truncated normal distribution, and similar configurations.

The first configurations are points that cover the unit interval of each parameter evenly, mapped by
`Parameter.quantile`, for all kinds of parameters (irace's generation.R).
"""

import math
from collections.abc import Callable, Mapping

import numpy as np
import scipy
from numpy.random import Generator

from mercator_design.arrays import Floats
from mercator_design.errors import RaceError
from mercator_design.race.space.parameter import Configuration, Key, Parameter, Value, key_of
from mercator_design.race.space.space import Space

Points = Callable[[int, int, Generator], Floats]
"""A function of the number of points, the number of dimensions and a generator."""

_MAX_SOBOL_DIMENSIONS = 21201
"""Limit of scipy's direction numbers."""


def even_sample(
    space: Space, n: int, generator: Generator, excluded: Callable[[Configuration], bool], points: Points
) -> list[Configuration]:
    """Up to n different configurations, spread evenly over the space.

    Inactive parameters have coordinates, too, so fewer than n configurations may be different. Then a larger sample
    is drawn once, as in irace.

    Args:
        space: The space to sample.
        n: Maximum number.
        generator: Draws the points.
        excluded: Returns True for a configuration that must not be sampled.
        points: `sobol_sequence` or `latin_hypercube`.

    Raises:
        RaceError: All sampled configurations are excluded.
    """
    found = _different(space, points(n, space.n_variable, generator), excluded)
    if len(found) < n:
        have = len(found)
        larger = max(math.ceil(n + (n - have) * (2 - have / n)), min(5 * space.n_variable, 100))
        found = _different(space, points(larger, space.n_variable, generator), excluded)
    if not found:
        raise RaceError("first configurations: expected some to be allowed, but all that were sampled are forbidden")
    return found[:n]


def sobol_sequence(n: int, d: int, generator: Generator) -> Floats:
    """The first n points of a scrambled Sobol sequence in d dimensions, shape (n, d); irace's first configurations."""
    if d > _MAX_SOBOL_DIMENSIONS:
        return generator.random((n, d))
    from scipy.stats.qmc import Sobol  # slow: half a second

    points: Floats = Sobol(d, scramble=True, seed=generator).random_base2(math.ceil(math.log2(n)))
    return points[:n]


def latin_hypercube(n: int, d: int, generator: Generator) -> Floats:
    """Points of shape (n, d): in each dimension, one in each of n equal intervals (McKay et al. 1979)."""
    intervals = generator.permuted(np.tile(np.arange(n), (d, 1)), axis=1)
    return ((intervals + generator.random((d, n))) / n).T


def truncated_normal(uniforms: Floats | float, means: Floats | float, deviations: Floats | float) -> Floats:
    """Transform uniform values to truncated normal values in [0, 1] by the inverse distribution function.

    Where a mean is NaN, values stay uniform; where it lies very far outside, the value is the nearer bound.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        is_low = np.less(means, 0)  # mirrored, because only lower tails are exact
        centres = np.where(is_low, np.subtract(1, means), means)
        uniforms = np.where(is_low, np.subtract(1, uniforms), uniforms)
        below = scipy.special.ndtr(-centres / deviations)
        above = scipy.special.ndtr((1 - centres) / deviations)
        values = np.where(
            above > below, centres + deviations * scipy.special.ndtri(below + uniforms * (above - below)), centres
        )
    values = np.where(is_low, 1 - values, values)
    return np.where(np.isnan(means), uniforms, np.clip(values, 0.0, 1.0))


def truncated_normal_value(uniform: float, mean: float, deviation: float) -> float:
    """`truncated_normal` of single values, in a tenth of the time."""
    if math.isnan(mean):
        return uniform
    if mean < 0:  # mirrored, because only lower tails are exact
        return 1 - truncated_normal_value(1 - uniform, 1 - mean, deviation)
    below, above = scipy.special.ndtr(-mean / deviation), scipy.special.ndtr((1 - mean) / deviation)
    value = mean + deviation * scipy.special.ndtri(below + uniform * (above - below)) if above > below else mean
    return float(min(max(value, 0.0), 1.0))


def similar(space: Space, configurations: Mapping[int, Configuration], threshold: float) -> list[int]:
    """Which configurations are nearly equal to another one (irace's similarConfigurations).

    Nearly equal configurations have the same categorical and ordered values and the same active parameters, and their
    numeric values differ by at most `threshold` times the width of the domain.
    """
    names = [p.name for p in space.variable if not p.is_numeric]
    numeric = [p for p in space.variable if p.is_numeric]
    groups: dict[tuple[Value | None, ...], list[int]] = {}
    for number, configuration in configurations.items():
        groups.setdefault(tuple(map(configuration.get, names)), []).append(number)
    found: set[int] = set()
    for group in groups.values():
        if len(group) > 1:
            places = np.array([[_place(p, configurations[number]) for p in numeric] for number in group])
            found.update(group[row] for row in _near_rows(places, threshold))
    return [number for number in configurations if number in found]


def _near_rows(places: Floats, threshold: float) -> set[int]:
    missing = np.isnan(places)
    near: set[int] = set()
    for row in range(len(places) - 1):
        same = (np.abs(places[row + 1 :] - places[row]) <= threshold) | (missing[row + 1 :] & missing[row])
        others = np.flatnonzero(same.all(axis=1))
        if len(others):
            near.add(row)
            near.update((others + row + 1).tolist())
    return near


def _place(parameter: Parameter, configuration: Configuration) -> float:
    """A numeric value relative to the width of its domain, on the original scale."""
    value = configuration.get(parameter.name)
    bounds = None if value is None else parameter.bounds(configuration)
    if value is None or bounds is None:
        return math.nan
    low, high = bounds
    return (float(value) - low) / (high - low) if high > low else 0.0


def _different(space: Space, points: Floats, excluded: Callable[[Configuration], bool]) -> list[Configuration]:
    columns = {p.name: column for column, p in enumerate(space.variable)}

    def at(point: list[float]) -> Configuration:
        return space.build(lambda parameter, bounds: parameter.quantile(point[columns[parameter.name]], bounds))

    found: dict[Key, Configuration] = {}
    for configuration in map(at, points.tolist()):
        if not excluded(configuration):
            found.setdefault(key_of(configuration), configuration)
    return list(found.values())
