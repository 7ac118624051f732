"""The methods of a race by name: what proposes configurations, and decides which of them run on which instances."""

from collections.abc import Mapping
from functools import partial
from typing import Protocol

from mercator_design.race.asking import Asking
from mercator_design.race.iterated import IteratedRace
from mercator_design.race.options import RaceOptions
from mercator_design.race.space import Space


class Method(Protocol):
    """Makes a race over a space."""

    def __call__(self, space: Space, *, budget: int, seed: int) -> Asking: ...


METHODS: Mapping[str, Method] = {
    "irace": partial(IteratedRace, options=RaceOptions.irace()),
    "surrogate": partial(IteratedRace, options=RaceOptions()),
}
"""Iterated F-race exactly as irace's; and with the library's own options, a surrogate above all."""
