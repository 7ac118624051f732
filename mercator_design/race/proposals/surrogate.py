"""A surrogate: predicts the costs of configurations, with their uncertainty, from those that have run.

A Gaussian process (Rasmussen and Williams 2006) over conditional, mixed spaces. Each parameter's value is a vector:
a category's indicator; a number's point on a half circle (so that near numbers have near vectors); zeros for an
inactive number; an extra category for an inactive categorical parameter. The distance of two configurations is
the sum of the squared distances of these vectors, weighted by the importance of each parameter, and

    covariance = variance * exp(-distance)

so that effects of single parameters, of pairs, and of whole configurations are possible, single parameters first.
Weights and variance maximise the posterior density by a few steps of Adam (Kingma and Ba 2015), which continue from fit
to fit.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from mercator_design.arrays import Floats
from mercator_design.race.space.encoding import Encoding

_MAX_ADAPTED = 100
"""Weights and variance are adapted to so many configurations at most: the time grows with the cube of their number."""
_MEDIAN_WEIGHT = 0.3
"""Initial weight of a parameter; the prior of its logarithm is normal with this median and deviation 1."""
_STEPS = 3
_STEP = 0.2
"""Step of Adam in the logarithms of weights and variance."""
_MIN_NOISE = 1e-4
_DIGITS = 9
"""Results are rounded to so many decimals: the last bits differ between machines and must not decide."""
_SLOPE_DIGITS = 6
"""Smallest slope: Adam would make a full step for a slope that is only rounding error."""


class Features:
    """Configurations as vectors, from their rows (encoding.py).

    Attributes:
        owner: of each feature, the column of its parameter, shape (features,).
        n_parameters: variable parameters.
    """

    def __init__(self, encoding: Encoding) -> None:
        self.n_parameters = encoding.space.n_variable
        sizes = np.where(encoding.is_category, encoding.n_values + 1, 2).astype(int)
        self.owner = np.repeat(np.arange(self.n_parameters), sizes)
        self.starts = np.cumsum([0, *sizes[:-1]])
        self._categories = np.flatnonzero(encoding.is_category)
        self._numbers = np.flatnonzero(~encoding.is_category)

    def of(self, rows: Floats) -> Floats:
        """Unit vectors of each parameter's value side by side, shape (configurations, features)."""
        found = np.zeros((len(rows), len(self.owner)))
        codes = np.nan_to_num(rows[:, self._categories], nan=-1).astype(np.intp)
        found[np.arange(len(rows))[:, np.newaxis], self.starts[self._categories] + 1 + codes] = 1.0
        places = rows[:, self._numbers]
        row, number = np.nonzero(~np.isnan(places))
        angles, feature = np.pi * places[row, number], self.starts[self._numbers[number]]
        found[row, feature], found[row, feature + 1] = np.cos(angles), np.sin(angles)
        return found


class _Points(NamedTuple):
    """Features, each times the root of its parameter's weight."""

    places: Floats  # shape (n, features)
    squares: Floats  # their squared lengths, shape (n,)


def _distances(ones: _Points, others: _Points) -> Floats:
    apart: Floats = 0.5 * np.add.outer(ones.squares, others.squares) - ones.places @ others.places.T
    return np.maximum(apart, 0.0).round(_DIGITS)


class Surrogate:
    """A Gaussian process over features, for standardised costs."""

    def __init__(self, features: Features) -> None:
        self._owner = features.owner
        self._starts = features.starts
        self._log_median = math.log(_MEDIAN_WEIGHT)
        self._theta = np.append(np.full(features.n_parameters, self._log_median), 0.0)

    def fit(self, features: Floats, costs: Floats, noise: Floats) -> Floats:
        """Learn from costs of mean 0 and variance 1; return the expected ones, shape (n,).

        Args:
            features: shape (n, features).
            costs: shape (n,).
            noise: variances of the costs' errors, shape (n,).
        """
        self.adapt(features, costs, noise)
        noise = np.maximum(noise, _MIN_NOISE)
        self._scale = np.sqrt(np.exp(self._theta[:-1]))[self._owner]
        self._variance = math.exp(self._theta[-1])
        self._known = self._scaled(features)
        lower = np.linalg.cholesky(self._covariance(self._known, self._known) + np.diag(noise))
        self._whitening = np.linalg.inv(lower)
        self._weights = self._whitening.T @ (self._whitening @ costs)
        return np.round(costs - noise * self._weights, _DIGITS)

    def predict(self, features: Floats) -> tuple[Floats, Floats]:
        """Means and standard deviations, each of shape (n,)."""
        across = self._covariance(self._scaled(features), self._known)
        known = across @ self._whitening.T
        variance = np.maximum(self._variance - (known * known).sum(axis=1), 0.0)
        return np.round(across @ self._weights, _DIGITS), np.round(np.sqrt(variance), _DIGITS)

    def means(self, features: Floats) -> Floats:
        """The means of `predict`, in a small part of its time."""
        return np.round(self._covariance(self._scaled(features), self._known) @ self._weights, _DIGITS)

    def sample(self, features: Floats, n: int, generator: Generator) -> Floats:
        """Functions sampled from the posterior, at n_points points each, shape (n, n_points)."""
        here = self._scaled(features)
        across = self._covariance(here, self._known)
        known = across @ self._whitening.T
        posterior = self._covariance(here, here) - known @ known.T
        jitter = 1e-6 * self._variance * np.eye(len(features))
        lower = np.linalg.cholesky(posterior + jitter)
        draws = generator.normal(size=(n, len(features)))
        return np.round(across @ self._weights + draws @ lower.T, _DIGITS)

    def distances(self, features: Floats, others: Floats) -> Floats:
        """Distances of configurations, shape (n, others)."""
        return _distances(self._scaled(features), self._scaled(others))

    def _scaled(self, features: Floats) -> _Points:
        places = features * self._scale
        return _Points(places, (places * places).sum(axis=1))

    def _covariance(self, ones: _Points, others: _Points) -> Floats:
        return self._variance * np.exp(-_distances(ones, others))

    def adapt(self, features: Floats, costs: Floats, noise: Floats) -> None:
        """Take some steps up the log posterior density over the logarithms of weights and variance: a part of `fit`."""
        some = np.linspace(0, len(costs) - 1, min(len(costs), _MAX_ADAPTED)).astype(np.intp)
        features, costs, noise = features[some], costs[some], np.maximum(noise[some], _MIN_NOISE)
        squares = np.add.reduceat(features * features, self._starts, axis=1)
        centre = np.append(np.full(len(self._theta) - 1, self._log_median), 0.0)
        theta = self._theta
        momentum, power = np.zeros(len(theta)), np.zeros(len(theta))
        for step in range(1, _STEPS + 1):
            self._scale = np.sqrt(np.exp(theta[:-1]))[self._owner]
            self._variance = math.exp(theta[-1])
            here = self._scaled(features)
            signal = self._covariance(here, here)
            inverse = np.linalg.inv(signal + np.diag(noise))
            weights = inverse @ costs
            pull = (np.outer(weights, weights) - inverse) * signal
            apart = pull.sum(axis=1) @ squares
            together = np.add.reduceat((features * (pull @ features)).sum(axis=0), self._starts)
            slope = np.append(-0.5 * np.exp(theta[:-1]) * (apart - together), 0.5 * pull.sum()) - (theta - centre)
            slope = np.round(slope, _SLOPE_DIGITS)
            momentum = 0.9 * momentum + 0.1 * slope
            power = 0.99 * power + 0.01 * slope * slope
            direction = momentum / (1 - 0.9**step) / (np.sqrt(power / (1 - 0.99**step)) + 1e-8)
            theta = np.round(theta + _STEP * direction, _DIGITS)
        self._theta = theta
