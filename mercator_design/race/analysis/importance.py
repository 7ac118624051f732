"""Which parameters explain what configurations cost in a race.

The costs of each configuration, corrected for the instances that it happened to see, are learnt by the race's surrogate
(surrogate.py) from four fifths of the configurations and predicted for the others, for each fifth in turn. A parameter
matters as far as predictions get worse when its values are shuffled among those others where it is active (Breiman
2001, Random forests, Machine Learning 45:5-32). Half of the squared error that this adds is, for independent
parameters, the total effect of Sobol's method: the share of the variance that the parameter has a part in, alone or
together with others (Jansen 1999, Computer Physics Communications 117:35-43). But a model that has learnt from few or
noisy results predicts smaller differences than there are, so a share is a lower bound rather than an estimate.

So importance is about the configurations that were raced, of which most are like the elites; and parameters that
always change together cannot be told apart.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from mercator_design import seeds
from mercator_design.errors import RaceError
from mercator_design.race.methods.additive_model import effects, table
from mercator_design.race.methods.surrogate import Features, Floats, Surrogate
from mercator_design.race.space.parameter import Configuration, Value
from mercator_design.race.space.space import Space

FEWEST = 30
"""Configurations that something can be learnt from."""
_MOST = 600
"""Configurations; of more, as many are taken evenly, since fitting takes the cube of their number."""
_FOLDS = 5
_FITS = 10
"""Of the surrogate, each of which goes on from the one before."""
_SHUFFLES = 20
_GRID = 7
"""Values of a parameter that are tried to find the one it favours."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Importance:
    """What one parameter has to do with the costs.

    share: of the variance between configurations that it has a part in, at least; may be below 0.
    error: the standard error of that over the configurations, given the models: that others might have been learnt is
        not in it.
    active: the part of the configurations in which it is active.
    favours: the value of which the least cost is predicted, all else as it was.
    gain: how much less that is than with the value of which the most is predicted.
    """

    name: str
    share: float
    error: float
    active: float
    favours: Value
    gain: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """What parameters explain.

    configurations: how many were learnt from.
    explained: the share of the variance between configurations, beyond noise, that is predicted of new ones.
    parameters: the most important first; those that nowhere vary are left out.
    """

    configurations: int
    explained: float
    parameters: tuple[Importance, ...]


def explain(
    space: Space, configurations: Sequence[Configuration], costs: Sequence[Mapping[int, float]], *, seed: int
) -> Explanation:
    """Explain costs.

    Args:
        space: Of the configurations.
        configurations: That were raced.
        costs: Theirs, by instance; of those that were rejected some are infinite.
        seed: Of what is random here: folds and shuffles.

    Raises:
        RaceError: There are too few configurations, or all cost the same.
    """
    usable = [k for k, own in enumerate(costs) if own and not any(map(math.isinf, own.values()))]
    usable = [usable[k * len(usable) // min(len(usable), _MOST)] for k in range(min(len(usable), _MOST))]
    if len(usable) < FEWEST:
        raise RaceError(f"importance: expected at least {FEWEST} configurations that were raced, found {len(usable)}")
    known = table([costs[k] for k in usable])
    known = known[:, ~np.isnan(known).all(axis=0)]
    means, variance = effects(known)
    noise = variance / (~np.isnan(known)).sum(axis=1)
    between = float(means.var() - noise.mean())
    if between <= 0:
        raise RaceError("importance: expected configurations of different costs, found no difference beyond noise")
    with threadpool_limits(limits=1, user_api="blas"):
        return _explain(space, [configurations[k] for k in usable], means, noise, between, seed)


def _explain(
    space: Space, configurations: Sequence[Configuration], means: Floats, noise: Floats, between: float, seed: int
) -> Explanation:
    generator = seeds.generator(seed, "importance")
    features = Features(space)
    places = features.places(configurations)
    fold = generator.permutation(len(places)) % _FOLDS
    before = np.zeros(len(places))
    added = np.zeros(places.shape)  # to the squared error of each configuration, when each parameter is shuffled
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
    found = []
    for column, parameter in enumerate(space.variable):
        rows = np.flatnonzero(~np.isnan(places[:, column]))
        if len(np.unique(places[rows, column])) < 2:
            continue
        best, gain = _favoured(model, places[rows], column)
        value = configurations[rows[best]][parameter.name]
        found.append(
            Importance(
                name=parameter.name, share=float(added[:, column].mean()),
                error=float(added[:, column].std(ddof=1)) / len(places) ** 0.5,
                active=len(rows) / len(places), favours=value, gain=gain,
            )
        )  # fmt: skip
    found.sort(key=lambda one: -one.share)
    explained = 1 - (float(before.mean()) - float(noise.mean())) / between
    return Explanation(configurations=len(places), explained=explained, parameters=tuple(found))


class _Model:
    """A surrogate of costs as they are."""

    def __init__(self, features: Features, places: Floats, means: Floats, noise: Floats) -> None:
        self._features = features
        self._middle, self._scale = float(means.mean()), float(means.std()) or 1.0
        self._surrogate = Surrogate(features)
        rows = features.of(places)
        for _ in range(_FITS):
            self._surrogate.fit(rows, (means - self._middle) / self._scale, noise / self._scale**2)

    def predict(self, places: Floats) -> Floats:
        found: Floats = self._middle + self._scale * self._surrogate.predict(self._features.of(places))[0]
        return found


def _favoured(model: _Model, places: Floats, column: int) -> tuple[int, float]:
    """The row whose value of a parameter is predicted to cost least, and how much less than the worst one tried."""
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
