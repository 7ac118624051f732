"""The limits of scores: an objective's `limits` receives an `ExperimentSize` and its parameters."""

import math
from collections.abc import Mapping
from itertools import combinations
from typing import NamedTuple

import numpy as np

from mercator_design.missions.floor import DISC, HALF_PLANE, RING, FloorTable
from mercator_design.missions.plugins import When, Zones
from mercator_design.missions.zone_distance import border_points


class ExperimentSize(NamedTuple):
    """The facts of an experiment, beside an objective's parameters, on which the limits of its scores may depend."""

    robots: int
    cycles: int
    floor: FloorTable  # at the start
    zone_rows: Mapping[str, tuple[int, ...]]  # name of a zone -> its rows in floor.zones

    def counted(self, when: When) -> int:
        """The number of cycles that count: all, or only the last."""
        return self.cycles if when == "always" else 1

    def are_apart(self, zones: Zones) -> bool:
        """Whether no robot can be in two of the named zones, because the boxes around them do not meet.

        It is False also where that is not known: of half planes, and of floors with dynamics.
        """
        boxes = [[self._box(row) for row in self.zone_rows[zone]] for zone in zones]
        return not len(self.floor.changes) and not any(
            _meet(one, other) for ours, theirs in combinations(boxes, 2) for one in ours for other in theirs
        )

    def _box(self, row: int) -> tuple[float, float, float, float]:
        """The left, right, bottom and top ends of the zone in a row."""
        kind, x, y, radius = self.floor.zones[row, :4].tolist()
        if kind == HALF_PLANE:
            return -math.inf, math.inf, -math.inf, math.inf
        if kind in {DISC, RING}:
            return x - radius, x + radius, y - radius, y + radius
        low, high = (of(border_points(self.floor, row), axis=0) for of in (np.min, np.max))
        return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def _meet(one: tuple[float, float, float, float], other: tuple[float, float, float, float]) -> bool:
    return one[0] <= other[1] and other[0] <= one[1] and one[2] <= other[3] and other[2] <= one[3]


def from_zero(size: ExperimentSize, **_: object) -> tuple[float, float]:
    """The limits of scores that are only known not to be negative."""
    del size
    return 0.0, math.inf
