"""A surrogate: predicts the costs of configurations, with their uncertainty, from those that have run.

A Gaussian process (Rasmussen and Williams 2006) over conditional, mixed spaces. Each parameter's value is a vector:
a category's indicator; a number's bumps around evenly spaced centres (so that near numbers have near vectors); zeros
for an inactive number; an extra category for an inactive categorical parameter. The distance of two configurations is
the sum of the squared distances of these vectors, weighted by the importance of each parameter, and

    covariance = variance * exp(-distance)

so that effects of single parameters, of pairs, and of whole configurations are possible, single parameters first.
Weights and variance maximise the posterior density by a few steps of Adam (Kingma and Ba 2015), which continue from fit
to fit.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from mercator_design.race.space.parameter import Configuration
from mercator_design.race.space.space import Space

Floats = NDArray[np.float64]

_CENTRES = np.linspace(0.0, 1.0, 7)
_BUMP = 0.15
"""Width of a number's bumps, as a part of its domain."""
_INACTIVE = -1.0
"""The code of an inactive categorical parameter."""
_MEDIAN_WEIGHT = 0.3
"""Initial weight of a parameter; the prior of its logarithm is normal with this median and deviation 1."""
_STEPS = 4
_STEP = 0.2
"""Step of Adam in the logarithms of weights and variance."""
_MIN_NOISE = 1e-4
_DIGITS = 9
"""Results are rounded to so many decimals: the last bits differ between machines and must not decide."""
_SLOPE_DIGITS = 6
"""Smallest slope: Adam would make a full step for a slope that is only rounding error."""


class Features:
    """Configurations as rows of numbers.

    Attributes:
        owner: of each feature, the parameter's column among the space's variable ones, shape (features,).
        n_parameters: variable parameters.
    """

    def __init__(self, space: Space) -> None:
        self._space = space
        codes = [np.arange(_INACTIVE, len(p.values)) if p.kind == "categorical" else _CENTRES for p in space.variable]
        self.n_parameters = len(codes)
        self.owner = np.repeat(np.arange(len(codes)), [len(c) for c in codes])
        self.starts = np.flatnonzero(np.diff(self.owner, prepend=-1))
        self._code = np.concatenate(codes)
        self._is_category = np.array([p.kind == "categorical" for p in space.variable])
        self._columns = {p.name: column for column, p in enumerate(space.variable)}
        self._index = {
            p.name: {value: float(k) for k, value in enumerate(p.values)}
            for p in space.variable
            if p.kind == "categorical"
        }
        self._bounds = {p.name: p.bounds({}) for p in space.variable if not p.is_dependent}

    def places(self, configurations: Sequence[Configuration]) -> Floats:
        """Categories as numbers, others in the unit interval; shape (configurations, parameters), NaN if inactive."""
        found = np.full((len(configurations), self.n_parameters), math.nan)
        for row, configuration in enumerate(configurations):
            for name, value in configuration.items():
                column = self._columns.get(name)
                if column is None:
                    continue
                if name in self._index:
                    found[row, column] = self._index[name][str(value)]
                    continue
                parameter = self._space[name]
                bounds = self._bounds[name] if name in self._bounds else parameter.bounds(configuration)
                if bounds is not None:
                    found[row, column] = parameter.position(value, bounds)
        return found

    def of(self, places: Floats) -> Floats:
        """Unit vectors of each parameter's value side by side, shape (configurations, features)."""
        place = places[:, self.owner]
        category = self._is_category[self.owner]
        with np.errstate(invalid="ignore"):
            bumps = np.exp(-0.5 * ((place - self._code) / _BUMP) ** 2)
        indicators = np.where(np.isnan(place), _INACTIVE, place) == self._code
        found = np.where(category, indicators, np.where(np.isnan(place), 0.0, bumps))
        lengths = np.sqrt(np.add.reduceat(found * found, self.starts, axis=1))
        unit: Floats = found / np.where(lengths == 0, 1.0, lengths)[:, self.owner]
        return unit


class Surrogate:
    """A Gaussian process over features, for standardised costs."""

    def __init__(self, features: Features) -> None:
        self._owner = features.owner
        self._starts = features.starts
        self._log_median = math.log(_MEDIAN_WEIGHT)
        self._theta = np.append(np.full(features.n_parameters, self._log_median), 0.0)

    def fit(self, features: Floats, costs: Floats, noise: Floats) -> None:
        """Learn from costs of mean 0 and variance 1.

        Args:
            features: shape (n, features).
            costs: shape (n,).
            noise: variances of the costs' errors, shape (n,).
        """
        noise = np.maximum(noise, _MIN_NOISE)
        self._adapt(features, costs, noise)
        self._features = features
        self._scale = np.sqrt(np.exp(self._theta[:-1]))[self._owner]
        self._variance = math.exp(self._theta[-1])
        lower = np.linalg.cholesky(self._covariance(features, features) + np.diag(noise))
        self._whitening = np.linalg.inv(lower)
        self._weights = self._whitening.T @ (self._whitening @ costs)

    def predict(self, features: Floats) -> tuple[Floats, Floats]:
        """Means and standard deviations, each of shape (n,)."""
        across = self._covariance(features, self._features)
        known = across @ self._whitening.T
        variance = np.maximum(self._variance - (known * known).sum(axis=1), 0.0)
        return np.round(across @ self._weights, _DIGITS), np.round(np.sqrt(variance), _DIGITS)

    def sample(self, features: Floats, n: int, generator: Generator) -> Floats:
        """Functions sampled from the posterior, at n_points points each, shape (n, n_points)."""
        across = self._covariance(features, self._features)
        known = across @ self._whitening.T
        posterior = self._covariance(features, features) - known @ known.T
        jitter = 1e-6 * self._variance * np.eye(len(features))
        lower = np.linalg.cholesky(posterior + jitter)
        draws = generator.normal(size=(n, len(features)))
        sampled: Floats = np.round(across @ self._weights + draws @ lower.T, _DIGITS)
        return sampled

    def distances(self, features: Floats, others: Floats) -> Floats:
        """Distances of configurations, shape (n, others)."""
        one, other = features * self._scale, others * self._scale
        squares = (one * one).sum(axis=1)[:, np.newaxis] + (other * other).sum(axis=1)
        apart: Floats = np.round(np.maximum(0.5 * squares - one @ other.T, 0.0), _DIGITS)
        return apart

    def _covariance(self, features: Floats, others: Floats) -> Floats:
        found: Floats = self._variance * np.exp(-self.distances(features, others))
        return found

    def _adapt(self, features: Floats, costs: Floats, noise: Floats) -> None:
        """Maximise the log posterior density over the logarithms of weights and variance; keep the best point."""
        squares = np.add.reduceat(features * features, self._starts, axis=1)
        centre = np.append(np.full(len(self._theta) - 1, self._log_median), 0.0)
        theta, best, found = self._theta, self._theta, -math.inf
        momentum, power = np.zeros(len(theta)), np.zeros(len(theta))
        for step in range(1, _STEPS + 1):
            self._scale = np.sqrt(np.exp(theta[:-1]))[self._owner]
            self._variance = math.exp(theta[-1])
            signal = self._covariance(features, features)
            covariance = signal + np.diag(noise)
            inverse = np.linalg.inv(covariance)
            weights = inverse @ costs
            density = -0.5 * (costs @ weights + np.linalg.slogdet(covariance)[1] + ((theta - centre) ** 2).sum())
            if density > found:
                best, found = theta, density
            pull = (np.outer(weights, weights) - inverse) * signal
            apart = (squares * pull.sum(axis=1)[:, np.newaxis]).sum(axis=0)
            together = np.add.reduceat((features * (pull @ features)).sum(axis=0), self._starts)
            slope = np.append(-0.5 * np.exp(theta[:-1]) * (apart - together), 0.5 * pull.sum()) - (theta - centre)
            slope = np.round(slope, _SLOPE_DIGITS)
            momentum = 0.9 * momentum + 0.1 * slope
            power = 0.99 * power + 0.01 * slope * slope
            direction = momentum / (1 - 0.9**step) / (np.sqrt(power / (1 - 0.99**step)) + 1e-8)
            theta = np.round(theta + _STEP * direction, _DIGITS)
        self._theta = best
