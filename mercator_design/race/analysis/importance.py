"""Importance analysis: which parameters explain the costs of the configurations of a race.

The mean costs of configurations are corrected for the instances that they have seen. A surrogate
(surrogate.py) learns them from four fifths of the configurations and predicts them for the others, for each fifth in
turn. Then the values of one parameter are shuffled among those others in which it is active: the worse the predictions
get, the more important is the parameter (Breiman 2001, Random forests, Machine Learning 45:5-32). Half of the squared
error that this adds is, for independent parameters, the total effect of Sobol's method: the share of the variance in
which the parameter has a part, alone or with others (Jansen 1999, Computer Physics Communications 117:35-43). A model
that has learnt from few or noisy results predicts too small differences, so a share is rather a lower bound than an
estimate. Where a parameter has no effect, shuffling it makes the predictions a little better or worse by chance. A
share that this puts below 0 is 0, and one above 1 is 1.

Importance is about the configurations that were raced, and most of them are similar to the elites. The importance of
parameters that always change together cannot be separated.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from mercator_design import seeds
from mercator_design.arrays import Floats
from mercator_design.errors import RaceError
from mercator_design.race.elimination.additive_model import effects, table
from mercator_design.race.proposals.surrogate import Features, Surrogate
from mercator_design.race.space.encoding import Encoding
from mercator_design.race.space.parameter import Configuration, Value
from mercator_design.race.space.space import Space

MIN_CONFIGURATIONS = 30
_MAX_CONFIGURATIONS = 600
"""If there are more, so many are taken evenly, because the time of a fit grows with the cube of their number."""
_FOLDS = 5
_ADAPTATIONS = 10
"""How often the surrogate adapts to the costs; each time continues from the one before."""
_SHUFFLES = 20
_GRID = 7
"""Number of values of a parameter that are tried to find the best one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Importance:
    """The importance of one parameter.

    share: The share of the variance between configurations in which it has a part, at least; from 0 to 1.
    error: The standard error of the share over the configurations, for the given models.
    active: The share of the configurations in which it is active.
    favours: The value with the lowest predicted cost, if all others stay as they are.
    gain: The difference between the highest and the lowest predicted cost.
    """

    name: str
    share: float
    error: float
    active: float
    favours: Value
    gain: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """The result of the analysis.

    configurations: Number of configurations that were learnt from.
    explained: The share of the variance between new configurations, without noise, that is predicted; at most 1, and
        below 0 if the predictions are worse than the mean.
    parameters: The most important first; parameters that do not vary are left out.
    """

    configurations: int
    explained: float
    parameters: tuple[Importance, ...]


def explain(
    space: Space, configurations: Sequence[Configuration], costs: Sequence[Mapping[int, float]], *, seed: int
) -> Explanation:
    """Find the importance of all parameters.

    Args:
        space: The space of the configurations.
        configurations: The configurations of a race.
        costs: The costs of each configuration, by instance; an infinite cost rejects it.
        seed: Seed of folds and shuffles.

    Raises:
        RaceError: There are too few configurations, or there is no difference between their costs.
    """
    usable = learnt_from([k for k, own in enumerate(costs) if own and not any(map(math.isinf, own.values()))])
    if (n := len(usable)) < MIN_CONFIGURATIONS:
        raise RaceError(f"importance: expected at least {MIN_CONFIGURATIONS} configurations that were raced, found {n}")
    known = table([costs[k] for k in usable])
    means, variance = effects(known)
    noise = variance / (~np.isnan(known)).sum(axis=1)
    between = float(means.var() - noise.mean())
    if between <= 0:
        raise RaceError("importance: expected configurations of different costs, found no difference beyond noise")
    with threadpool_limits(limits=1, user_api="blas"):
        return _explain(space, [configurations[k] for k in usable], means, noise, between, seed)


def learnt_from(usable: Sequence[int]) -> list[int]:
    """Those of the usable configurations that the surrogate learns from."""
    n = min(len(usable), _MAX_CONFIGURATIONS)
    return [usable[k * len(usable) // n] for k in range(n)]


def _explain(
    space: Space, configurations: Sequence[Configuration], means: Floats, noise: Floats, between: float, seed: int
) -> Explanation:
    generator = seeds.generator(seed, "importance")
    encoding = Encoding(space)
    features, places = Features(encoding), encoding.rows(configurations)
    fold = generator.permutation(len(places)) % _FOLDS
    before = np.zeros(len(places))
    added = np.zeros(places.shape)  # how much shuffling a parameter adds to the squared error of each configuration
    for number in range(_FOLDS):
        held = np.flatnonzero(fold == number)
        model = _Model(features, places[fold != number], means[fold != number], noise[fold != number])
        before[held] = (means[held] - model.predict(places[held])) ** 2
        for column in range(places.shape[1]):
            active = held[~np.isnan(places[held, column])]
            if len(np.unique(places[active, column])) < 2:
                continue
            for _ in range(_SHUFFLES):
                shuffled = places[active]
                shuffled[:, column] = generator.permutation(shuffled[:, column])
                added[active, column] += (means[active] - model.predict(shuffled)) ** 2 - before[active]
    added /= 2 * _SHUFFLES * between
    model = _Model(features, places, means, noise)
    shares = added.mean(axis=0)
    found = []
    for column in sorted(range(len(shares)), key=lambda column: -shares[column]):
        parameter = space.variable[column]
        rows = np.flatnonzero(~np.isnan(places[:, column]))
        if len(np.unique(places[rows, column])) < 2:
            continue
        best, gain = _favoured(model, places[rows], column)
        value = configurations[rows[best]][parameter.name]
        found.append(
            Importance(
                name=parameter.name, share=float(shares[column].clip(0, 1)),
                error=float(added[:, column].std(ddof=1)) / len(places) ** 0.5,
                active=len(rows) / len(places), favours=value, gain=gain,
            )
        )  # fmt: skip
    explained = min(1.0, 1 - (float(before.mean()) - float(noise.mean())) / between)
    return Explanation(configurations=len(places), explained=explained, parameters=tuple(found))


class _Model:
    """A surrogate of costs that are not standardised."""

    def __init__(self, features: Features, places: Floats, means: Floats, noise: Floats) -> None:
        self._features = features
        self._middle, self._scale = float(means.mean()), float(means.std()) or 1.0
        self._surrogate = Surrogate(features)
        known = (features.of(places), (means - self._middle) / self._scale, noise / self._scale**2)
        for _ in range(_ADAPTATIONS - 1):
            self._surrogate.adapt(*known)
        self._surrogate.fit(*known)

    def predict(self, places: Floats) -> Floats:
        return self._middle + self._scale * self._surrogate.means(self._features.of(places))


def _favoured(model: _Model, places: Floats, column: int) -> tuple[int, float]:
    """The row of the value with the lowest predicted cost, and the difference to the highest one."""
    order = np.argsort(places[:, column], kind="stable")
    values, first = np.unique(places[order, column], return_index=True)
    tried = order[first][np.unique(np.linspace(0, len(values) - 1, _GRID).round().astype(int))]
    if len(values) <= 2 * _GRID:
        tried = order[first]
    costs = []
    for row in tried:
        changed = places.copy()
        changed[:, column] = places[row, column]
        costs.append(float(model.predict(changed).mean()))
    return int(tried[int(np.argmin(costs))]), max(costs) - min(costs)
