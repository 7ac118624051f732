"""The largest group of linked robots; robots are linked if they are closer than a distance.

If several groups are largest, the best one counts. (The original takes the first, so the order of the robots matters
there.) Areas are measured on fixed grids of points; the original samples random points.
"""

from typing import Annotated

import numpy as np

from mercator_design.arrays import Flags, Floats, Numbers
from mercator_design.config.schema import Range
from mercator_design.jit import compiled, jittable
from mercator_design.missions.arena import Size
from mercator_design.missions.floor import FloorTable
from mercator_design.missions.floor_kernels import zone_contains
from mercator_design.missions.plugins import Zones, objective
from mercator_design.missions.score_limits import ExperimentSize
from mercator_design.missions.trace import Trace

Radius = Annotated[float, Range(0.01, 10.0)]

_FINE = 0.01
_COARSE = 0.03
"""[m] between points; errors average out in the sum over cycles."""


def _of_area(size: ExperimentSize, *, radius: float, **_: object) -> tuple[float, float]:  # noqa: ARG001
    return 0.0, len(_disc(radius, _FINE)) * _FINE * _FINE


@objective(limits=_of_area)
def network_area(
    trace: Trace,
    *,
    link: Size = 0.35,  # [m] below which two robots are linked
    sight: Size = 0.25,  # [m] that a robot sees
    radius: Radius = 1.2,  # [m] from the origin within which points count
) -> float:
    """LCN of Chocolate: the area [m2] that the largest group sees at the end, `radius` from the origin at most.

    Of points 1 cm apart; error about 0.002 m2 for 20 robots. (The original's box of points begins at the origin even
    if the group is far from it, which costs it precision and changes no expected score.)
    """
    points = _disc(radius, _FINE)
    seen = _covered(
        np.ascontiguousarray(trace.positions[-1:]), points, np.ones(trace.robots, dtype=np.bool_), link, sight
    )
    return float(seen[0]) * _FINE * _FINE


def _of_shares(size: ExperimentSize, **_: object) -> tuple[float, float]:
    return 0.0, float(size.cycles)


@objective(limits=_of_shares)
def network_share(
    trace: Trace,
    *,
    zones: Zones,  # zones whose share counts
    link: Size = 0.3,  # [m] below which two robots are linked
    sight: Size = 0.3,  # [m] that a robot sees
    radius: Radius = 1.2,  # [m] from the origin within which points count
) -> float:
    """LCF of Mate: the share of zones that robots in them see which are of the largest group, summed over cycles.

    Only points nearer than `radius` to the origin count, of a grid of 3 cm; error of a cycle's share about 0.5 %.
    """
    points = _disc(radius, _COARSE)
    rows = trace.rows_of(zones)
    in_zones = np.zeros(len(points), dtype=np.bool_)
    compiled(_mark_points)(trace.floor, rows, points, in_zones)
    points = np.ascontiguousarray(points[in_zones])
    seen = _covered(np.ascontiguousarray(trace.positions), points, trace.inside(zones, "always"), link, sight)
    return float(np.sum(seen)) / max(len(points), 1)


def _of_diameters(size: ExperimentSize, **_: object) -> tuple[float, float]:
    return 0.0, float(size.cycles * (size.robots - 1))


@objective(limits=_of_diameters)
def network_diameter(
    trace: Trace,
    *,
    link: Size = 0.3,  # [m] below which two robots are linked
) -> float:
    """SPD11 of Mate: the most links on a shortest way between two robots of the largest group, summed over cycles."""
    diameters = np.zeros(trace.cycles, dtype=np.int64)
    scratch = np.zeros((4, trace.robots), dtype=np.int64)
    compiled(_measure_diameters)(np.ascontiguousarray(trace.positions), link, scratch, diameters)
    return float(np.sum(diameters))


def _disc(radius: float, spacing: float) -> Floats:
    """Points (n, 2) of a square grid, symmetric about the origin, nearer to it than `radius`."""
    half = int(np.ceil(radius / spacing))
    along = spacing * (np.arange(-half, half) + 0.5)
    points = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
    return np.ascontiguousarray(points[np.hypot(points[:, 0], points[:, 1]) < radius])


def _covered(positions: Floats, points: Floats, counts: Flags, link: float, sight: float) -> Numbers:
    """The number of points in each cycle (cycles,) that a robot sees which counts and is in the largest group."""
    seen = np.zeros(len(positions), dtype=np.int64)
    scratch = np.zeros((4, positions.shape[1]), dtype=np.int64)
    counting = np.broadcast_to(counts, positions.shape[:2]).copy()
    compiled(_count_points)(positions, points, counting, link, sight, scratch, seen)
    return seen


@jittable
def _group(positions: Floats, cycle: int, link: float, scratch: Numbers) -> int:
    """The size of the largest group. Row 0 of the scratch receives the group of each robot, row 1 the sizes."""
    robots = positions.shape[1]
    for i in range(robots):
        scratch[0, i] = scratch[3, i] = -1
        scratch[1, i] = 0
    largest = groups = 0
    for first in range(robots):
        if scratch[3, first] >= 0:
            continue
        size = _walk(positions, cycle, link, first, scratch)
        for k in range(size):
            scratch[0, scratch[2, k]] = groups
        scratch[1, groups] = size
        largest = max(largest, size)
        groups += 1
    return largest


@jittable
def _walk(positions: Floats, cycle: int, link: float, source: int, scratch: Numbers) -> int:
    """Visit the robots linked to a robot directly or indirectly, in the order of their distance in links.

    Row 2 of the scratch receives them in this order, row 3 their distances; robots not yet visited have -1 there.

    Returns:
        Their number.
    """
    scratch[3, source] = 0
    scratch[2, 0] = source
    size = 1
    done = 0
    while done < size:
        i = scratch[2, done]
        done += 1
        for j in range(positions.shape[1]):
            if scratch[3, j] < 0 and _linked(positions, cycle, i, j, link):
                scratch[3, j] = scratch[3, i] + 1
                scratch[2, size] = j
                size += 1
    return size


@jittable
def _linked(positions: Floats, cycle: int, i: int, j: int, link: float) -> bool:
    x = positions[cycle, j, 0] - positions[cycle, i, 0]
    y = positions[cycle, j, 1] - positions[cycle, i, 1]
    return bool(x * x + y * y < link * link)


def _mark_points(floor: FloorTable, rows: Numbers, points: Floats, inside: Flags) -> None:
    for k in range(len(points)):
        for row in rows:
            if zone_contains(floor, row, points[k, 0], points[k, 1]):
                inside[k] = True


def _count_points(
    positions: Floats,
    points: Floats,
    counts: Flags,
    link: float,
    sight: float,
    scratch: Numbers,
    seen: Numbers,
) -> None:
    robots = positions.shape[1]
    for cycle in range(len(positions)):
        largest = _group(positions, cycle, link, scratch)
        for group in range(robots):
            if scratch[1, group] != largest:
                continue
            members = 0
            for i in range(robots):
                if scratch[0, i] == group and counts[cycle, i]:
                    scratch[2, members] = i
                    members += 1
            found = 0
            for k in range(len(points)):
                for member in range(members):
                    x = positions[cycle, scratch[2, member], 0] - points[k, 0]
                    y = positions[cycle, scratch[2, member], 1] - points[k, 1]
                    if x * x + y * y <= sight * sight:
                        found += 1
                        break
            seen[cycle] = max(seen[cycle], found)


def _measure_diameters(positions: Floats, link: float, scratch: Numbers, diameters: Numbers) -> None:
    robots = positions.shape[1]
    for cycle in range(len(positions)):
        largest = _group(positions, cycle, link, scratch)
        for source in range(robots):
            if scratch[1, scratch[0, source]] == largest:
                diameters[cycle] = max(diameters[cycle], _farthest(positions, cycle, link, source, scratch))


@jittable
def _farthest(positions: Floats, cycle: int, link: float, source: int, scratch: Numbers) -> int:
    """The largest distance in links from a robot to another one of its group."""
    for i in range(positions.shape[1]):
        scratch[3, i] = -1
    size = _walk(positions, cycle, link, source, scratch)
    return int(scratch[3, scratch[2, size - 1]])
