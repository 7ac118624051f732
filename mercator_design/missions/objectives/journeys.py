"""Objectives of robots that go from one place to another."""

import math
from collections.abc import Iterator, Mapping

import numpy as np

from mercator_design.arrays import Floats, Numbers
from mercator_design.config.schema import FieldError
from mercator_design.jit import compiled
from mercator_design.missions.arena import Angle, Point, Size
from mercator_design.missions.dynamics import change_floor
from mercator_design.missions.floor import FloorTable
from mercator_design.missions.floor_kernels import any_contains, first_containing
from mercator_design.missions.objectives.in_zones import Value
from mercator_design.missions.plugins import Zone, Zones, objective
from mercator_design.missions.score_limits import ExperimentSize, from_zero
from mercator_design.missions.trace import Trace

_ALIKE: Mapping[str, float] = {}


def _two_places(sources: Zones, nests: Zones) -> Iterator[FieldError]:
    for index, zone in enumerate(nests):
        if zone in sources:
            yield FieldError(f"nests[{index}]", f"'{zone}' is a source too; a nest must be another zone")


def _values_of_sources(sources: Zones, values: Mapping[str, float]) -> Iterator[FieldError]:
    for zone in values:
        if zone not in sources:
            yield FieldError(f"values.{zone}", f"'{zone}' is not among the sources; a value belongs to a source")
    if not any(values.get(zone, 1.0) for zone in sources):
        yield FieldError("values", "expected a source whose value is not 0; else every score is 0")


def _of_trips(size: ExperimentSize, *, values: Mapping[str, float], **_: object) -> tuple[float, float]:  # noqa: ARG001
    return -math.inf if any(value < 0.0 for value in values.values()) else 0.0, math.inf


@objective(checks=(_two_places, _values_of_sources), by_zones=True, limits=_of_trips)
def trips(
    trace: Trace,
    *,
    sources: Zones,  # zones where a robot picks a thing up
    nests: Zones,  # zones where it puts it down
    values: Mapping[Zone, Value] = _ALIKE,  # what a thing from each source counts; 1 from one that is not named
) -> float:
    """Foraging: how often a robot that was on a source came to a nest; it carries one thing at a time.

    It keeps what it carries until it is in a nest, whichever sources it crosses before. A robot on a source and in a
    nest at once is on the source; one on several sources takes from the first in the list.
    """
    rows = [(row, values.get(zone, 1.0)) for zone in sources for row in trace.zone_rows[zone]]
    source_rows, row_values = np.array([row for row, _ in rows]), np.array([value for _, value in rows])
    carried = np.full(trace.robots, -1)
    poses, nest_rows = np.ascontiguousarray(trace.poses), trace.rows_of(nests)
    period = trace.control_period
    counted = compiled(_sum_trips)(trace.floor.copy(), poses, period, source_rows, nest_rows, row_values, carried)
    return float(counted)


def _sum_trips(
    floor: FloorTable,
    poses: Floats,
    period: float,
    sources: Numbers,
    nests: Numbers,
    values: Floats,
    carried: Numbers,
) -> float:
    """The sum of `values` of sources over trips. `carried` is the number in `sources` of each robot's, -1 without."""
    total = 0.0
    for cycle in range(1, len(poses)):
        change_floor(floor, poses[cycle], cycle * period)
        for i in range(poses.shape[1]):
            x, y = poses[cycle, i, 0], poses[cycle, i, 1]
            source = first_containing(floor, sources, x, y)
            if source >= 0:
                if carried[i] < 0:
                    carried[i] = source
            elif carried[i] >= 0 and any_contains(floor, nests, x, y):
                total += values[carried[i]]
                carried[i] = -1
    return total


@objective(limits=from_zero)
def gate_crossings(
    trace: Trace,
    *,
    width: Size,  # [m] of the gate
    center: Point = (0.0, 0.0),  # [m] x, y of the gate's middle
    angle: Angle = -math.pi / 2.0,  # [rad] of the direction in which a crossing counts
) -> float:
    """How often robots cross a gate's line in a direction, less how often against it, but not less than 0.

    The line is `width` long, has its middle at `center`, and lies across the direction `angle` [rad]. Whoever is on it
    exactly has not crossed it, nor who crosses it in the first cycle (DirectionalGate of NEATvsEvo).
    """
    ahead_x, ahead_y = math.cos(angle), math.sin(angle)
    dx = trace.positions[..., 0] - center[0]
    dy = trace.positions[..., 1] - center[1]
    ahead = dx * ahead_x + dy * ahead_y
    in_gate = np.abs(dx * ahead_y - dy * ahead_x)[1:] < 0.5 * width
    forwards = int(np.sum(in_gate & (ahead[:-1] < 0.0) & (ahead[1:] > 0.0)))
    backwards = int(np.sum(in_gate & (ahead[:-1] > 0.0) & (ahead[1:] < 0.0)))
    return float(max(0, forwards - backwards))
