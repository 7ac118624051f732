"""Objectives of robots that go from one place to another."""

import math
from collections.abc import Iterator

import numpy as np

from mercator_design.arrays import Flags, Floats, Numbers
from mercator_design.config.schema import FieldError
from mercator_design.jit import compiled
from mercator_design.missions.arena import Angle, Point, Size
from mercator_design.missions.dynamics import change_floor
from mercator_design.missions.floor import FloorTable
from mercator_design.missions.floor_kernels import any_contains
from mercator_design.missions.plugins import Zones, objective
from mercator_design.missions.trace import Trace


def _two_places(sources: Zones, nests: Zones) -> Iterator[FieldError]:
    for index, zone in enumerate(nests):
        if zone in sources:
            yield FieldError(f"nests[{index}]", f"'{zone}' is a source too; a nest must be another zone")


@objective(checks=(_two_places,), by_zones=True)
def trips(
    trace: Trace,
    *,
    sources: Zones,  # zones where a robot picks a thing up
    nests: Zones,  # zones where it puts it down
) -> float:
    """Foraging: how often a robot that was on a source came to a nest; it carries one thing at a time.

    A robot on both at once is on the source.
    """
    rows, carrying = (trace.rows_of(sources), trace.rows_of(nests)), np.zeros(trace.robots, dtype=np.bool_)
    poses = np.ascontiguousarray(trace.poses)
    return float(compiled(_count_trips)(trace.floor.copy(), poses, trace.control_period, *rows, carrying))


def _count_trips(
    floor: FloorTable, poses: Floats, period: float, sources: Numbers, nests: Numbers, carrying: Flags
) -> int:
    trips = 0
    for cycle in range(1, len(poses)):
        change_floor(floor, poses[cycle], cycle * period)
        for i in range(poses.shape[1]):
            x, y = poses[cycle, i, 0], poses[cycle, i, 1]
            if any_contains(floor, sources, x, y):
                carrying[i] = True
            elif carrying[i] and any_contains(floor, nests, x, y):
                carrying[i] = False
                trips += 1
    return trips


@objective
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
