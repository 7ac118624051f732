"""Moves from configurations to new ones nearby: change a few parameters of one, or cross two.

The sampling model draws all parameters of a child again, so with many parameters most children lose what made their
parent good. A move changes only a few parameters. Values of parameters that become active are copied from another good
configuration or drawn uniformly; those of parameters that become inactive are dropped.

Configurations are rows of numbers (encoding.py), so that many are made at once. Children have values for all
parameters: `Encoding.settled` drops those of inactive ones.
"""

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from mercator_design.arrays import Floats
from mercator_design.race.space.encoding import Encoding

_MORE_CHANGES = 0.5
"""One parameter changes, and a Poisson number of others with this mean."""
_STEP = 0.15
"""Standard deviation of a small step of a number, relative to the width of its domain."""


class Moves:
    """The moves of a space, with the draws of one generator."""

    def __init__(self, encoding: Encoding, generator: Generator) -> None:
        self._encoding = encoding
        self._generator = generator

    def mutated(self, parents: Floats, donors: Floats) -> Floats:
        """A child of each parent, with one or a few parameters changed; donors lend values to what becomes active."""
        draws, n = self._generator, len(parents)
        values = self._encoding.uniform(n, draws)
        if len(donors):
            lent = donors[draws.integers(len(donors), size=n)]
            values = np.where(np.isnan(lent) | (draws.random(lent.shape) < 0.5), values, lent)
        is_active = ~np.isnan(parents)
        order = np.where(is_active, draws.random(parents.shape), np.inf)
        n_changed = np.minimum(1 + draws.poisson(_MORE_CHANGES, n), is_active.sum(axis=1))
        limit = np.sort(order, axis=1)[np.arange(n), n_changed - 1]
        row, column = np.nonzero(is_active & (order <= limit[:, np.newaxis]))
        values = np.where(is_active, parents, values)
        values[row, column] = self._changed(parents[row, column], column)
        return values

    def crossed(self, ones: Floats, others: Floats) -> Floats:
        """A child of each pair, in which each parameter has its value of one of its parents."""
        first = self._generator.random(ones.shape) < 0.5
        values = np.where(first, ones, others)
        values = np.where(np.isnan(values), np.where(first, others, ones), values)
        return np.where(np.isnan(values), self._encoding.uniform(len(ones), self._generator), values)

    def _changed(self, places: Floats, columns: NDArray[np.intp]) -> Floats:
        """Another category; a number near the present one or anywhere, equally often."""
        draws, n = self._generator, len(places)
        found, near = draws.random(n), places + _STEP * draws.normal(size=n)
        is_near = (draws.random(n) < 0.5) & (near >= 0) & (near <= 1)
        is_category = self._encoding.is_category[columns]
        n_values = self._encoding.n_values[columns[is_category]]
        category = (places[is_category] + 1 + np.floor(found[is_category] * (n_values - 1))) % n_values
        found[is_near] = near[is_near]
        found[is_category] = category
        return found
