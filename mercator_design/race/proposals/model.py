"""The sampling model: each elite's own distributions, from which new configurations are drawn.

As irace's (model.R, generation.R), in the unit scale of `Parameter.quantile`: each elite has, for each
numeric or ordered parameter, a normal distribution around its own value truncated to the domain, and for each
categorical one a probability of each value. A new configuration takes one elite as parent and draws all its
values from the parent's distributions. These narrow with each iteration; a soft restart widens them again.

As in irace, an ordered parameter is drawn with neither a half added to the mean nor to the upper bound, so the lower
neighbour is preferred and the last value never drawn; and the mean of a parameter whose bounds depend on others is a
value, which may lie outside a child's bounds.
"""

from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from mercator_design.arrays import Floats
from mercator_design.race.elimination.options import RaceOptions
from mercator_design.race.proposals.sampling import truncated_normal, truncated_normal_value
from mercator_design.race.space.parameter import Bounds, Configuration, Parameter, Value
from mercator_design.race.space.space import Space

_MAX_ROUNDS = 100
"""Maximum number of rounds in which forbidden configurations are drawn again (irace)."""
_INITIAL_SPREAD = 0.5
"""Standard deviation of a new elite's distributions, as a part of the domain's width."""
_MAX_CERTAINTY = 0.2
"""A categorical probability is capped at this to the power 1/d, then normalised (irace, elitist races)."""
_SAME_SPREAD = float(np.finfo(float).eps)


def elite_weights(n: int) -> Floats:
    """Probabilities of the elites as parents, best first, shape (n,)."""
    return np.arange(n, 0, -1) / (n * (n + 1) / 2)


@dataclass(kw_only=True, slots=True)
class EliteModel:
    """The distributions of one elite.

    weights: of the values of each categorical parameter, by name.
    centres: means of the others in unit scale, shape (n_variable,); the value itself of a dependent parameter.
        NaN means uniform: the elite and its ancestors never had a value.
    spreads: standard deviations as a part of the domain's width, shape (n_variable,).
    """

    weights: dict[str, Floats]
    centres: Floats
    spreads: Floats


class SamplingModel:
    """The distributions of all elites, by number of the elite.

    Args:
        space: What is sampled.
        options: The options of the race: elitist races cap the probabilities of categorical values.
    """

    def __init__(self, space: Space, options: RaceOptions | None = None) -> None:
        self.elites: dict[int, EliteModel] = {}
        self._space = space
        self._options = options or RaceOptions()
        self._columns = {p.name: column for column, p in enumerate(space.variable)}
        self._skewed = [column for column, p in enumerate(space.variable) if p.kind == "ordered"]

    def initialise(self, elites: Mapping[int, Configuration]) -> None:
        """Begin with the elites of the first race."""
        d = self._space.n_variable
        for elite, configuration in elites.items():
            weights = {
                p.name: np.full(len(p.values), 1 / len(p.values))
                for p in self._space.variable
                if p.kind == "categorical"
            }
            model = EliteModel(weights=weights, centres=np.full(d, np.nan), spreads=np.full(d, _INITIAL_SPREAD))
            self.elites[elite] = model
            self._centre(model, configuration)

    def update(
        self,
        elites: Mapping[int, Configuration],
        parents: Mapping[int, int],
        *,
        n_new: int,
        iteration: int,
        iterations: int,
    ) -> None:
        """Narrow the distributions around the present elites (irace's updateModel).

        Args:
            elites: The current elites; others are dropped.
            parents: The parents of new elites. A new elite begins with its parent's distributions.
            n_new: Number of configurations that will be sampled.
            iteration: The iteration that begins, from 1.
            iterations: Number of planned iterations.
        """
        self.elites = {e: self.elites[e] if e in self.elites else deepcopy(self.elites[parents[e]]) for e in elites}
        shrinking = (1 / n_new) ** (1 / self._space.n_variable)
        certainty = (iteration - 1) / iterations
        for elite, configuration in elites.items():
            model = self.elites[elite]
            self._centre(model, configuration)
            for name, column in self._columns.items():
                value = configuration.get(name)
                if value is None:
                    continue
                if name in model.weights:
                    chosen = self._space[name].values.index(str(value))
                    model.weights[name] = self._favour(model.weights[name], chosen, certainty)
                else:
                    model.spreads[column] *= shrinking

    def restart(self, elites: Sequence[int], n_new: int) -> None:
        """Widen some elites' distributions by two iterations, but not beyond the second's (soft restart)."""
        d = self._space.n_variable
        for elite in elites:
            model = self.elites[elite]
            model.spreads = np.minimum(model.spreads * n_new ** (2 / d), _INITIAL_SPREAD * (1 / n_new) ** (1 / d))
            for name, weights in model.weights.items():
                flatter = 0.9 * weights + 0.1 * weights.max()
                model.weights[name] = flatter / flatter.sum()

    def sample(
        self, n: int, ranked: Sequence[int], generator: Generator, excluded: Callable[[Configuration], bool]
    ) -> list[tuple[Configuration, int]]:
        """New configurations, each with its parent; fewer than n, perhaps none, if too many draws were excluded.

        Args:
            n: Number of configurations.
            ranked: The elites, best first.
            generator: Makes all random draws.
            excluded: Returns True for a configuration that must be drawn again.
        """
        found: list[tuple[Configuration, int]] = []
        for _ in range(_MAX_ROUNDS):
            drawn = self.draw(n - len(found), ranked, generator)
            found += [child for child in drawn if not excluded(child[0])]
            if len(found) == n:
                break
        return found

    def draw(self, n: int, ranked: Sequence[int], generator: Generator) -> list[tuple[Configuration, int]]:
        """New configurations, each with its parent, also excluded ones."""
        chosen = generator.choice(len(ranked), size=n, p=elite_weights(len(ranked)))
        uniforms = generator.random((n, self._space.n_variable))
        models = [self.elites[elite] for elite in ranked]
        factors = np.array([0.0 if p.is_dependent else _spread_factor(p) for p in self._space.variable])
        centres = np.array([m.centres for m in models])[chosen]
        spreads = np.array([m.spreads for m in models])[chosen]
        places = truncated_normal(uniforms, centres, spreads * factors)
        for column in self._skewed:
            places[:, column] = _skewed(
                len(self._space.variable[column].values), uniforms[:, column], centres[:, column], spreads[:, column]
            )
        cumulated = [{name: w.cumsum().tolist() for name, w in m.weights.items()} for m in models]
        return [
            (self._space.build(self._chooser(models[k], cumulated[k], place, row)), ranked[k])
            for k, place, row in zip(chosen.tolist(), places.tolist(), uniforms, strict=True)
        ]

    def _chooser(
        self, model: EliteModel, cumulated: dict[str, list[float]], places: list[float], uniforms: Floats
    ) -> Callable[[Parameter, Bounds], Value]:
        """Draws the values of one configuration."""

        def choose(parameter: Parameter, bounds: Bounds) -> Value:
            column = self._columns[parameter.name]
            if parameter.kind == "categorical":
                sums = cumulated[parameter.name]
                return parameter.values[min(bisect_right(sums, uniforms[column]), len(sums) - 1)]
            place = places[column]
            if parameter.is_dependent:
                low, high = bounds
                spread = model.spreads[column] * (high - low)
                if spread < _SAME_SPREAD:
                    return parameter.quantile(0.0, bounds)
                spread /= high - low + (parameter.kind == "integer")
                centre = parameter.position(float(model.centres[column]), bounds)
                place = truncated_normal_value(float(uniforms[column]), centre, spread)
            return parameter.quantile(place, bounds)

        return choose

    def _centre(self, model: EliteModel, configuration: Configuration) -> None:
        """Set the means to an elite's own values; keep those of inactive parameters."""
        for name, value in configuration.items():
            parameter = self._space[name]
            if parameter.is_fixed or parameter.kind == "categorical":
                continue
            bounds = parameter.bounds(configuration)
            if bounds is not None:
                centre = float(value) if parameter.is_dependent else parameter.position(value, bounds)
                model.centres[self._columns[name]] = centre

    def _favour(self, weights: Floats, chosen: int, certainty: float) -> Floats:
        weights = weights * (1 - certainty)
        weights[chosen] += certainty
        weights /= weights.sum()
        if self._options.elitist:
            weights = np.minimum(weights, _MAX_CERTAINTY ** (1 / self._space.n_variable))
        normalised: Floats = weights / weights.sum()
        return normalised


def _spread_factor(parameter: Parameter) -> float:
    """Convert a part of the domain's width to unit scale, where an integer has one width more."""
    if parameter.kind == "real" or parameter.log:
        return 1.0
    bounds = parameter.bounds({})
    low, high = bounds if bounds is not None else (0, 0)
    return (high - low) / (high - low + 1)


def _skewed(n_values: int, uniforms: Floats, centres: Floats, spreads: Floats) -> Floats:
    """Places of an ordered parameter's values as irace draws them: the integer part of a normal value in 1 .. K.

    A centre of NaN means uniform.
    """
    width = n_values - 1
    drawn = truncated_normal(uniforms, np.clip((centres * n_values - 0.5) / width, 0, 1), spreads)
    return np.where(np.isnan(centres), uniforms, (np.floor(drawn * width) + 0.5) / n_values)
