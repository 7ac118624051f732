"""A turn of a lidar becomes points with normals in the robot's frame: de-skewing, small clusters, normals, thinning.

Kernels, and the class that calls them with arrays for a whole log. The reference time of a turn is its middle; each
beam is placed where the odometry says that the robot was at the beam's own time, relative to where it was then.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Floats, Numbers
from mercator_design.jit import compiled, jittable
from mercator_design.mapping.logs import RobotLog, Turn
from mercator_design.mapping.poses import relative

MIN_RANGE = 0.12
"""Readings [m] that count as returns are not less."""

NOTHING, RETURN, CLUSTERED = 0, 1, 2
"""Kinds of beams: without a return, with one, and with one in a small free-standing cluster."""

_CLUSTER_GAP = 0.10  # [m] between points of one cluster
_CLUSTER_MARGIN = 0.06  # [m] by which a cluster may be wider than a head
_CLUSTER_CLEARANCE = 0.06  # [m] that the beams beside it go farther
_LOST = 2  # beams without a return that may lie between neighbours
_NEIGHBOURS = 14  # points to each side of which a normal is made
_MIN_NEIGHBOURS = 4  # the point itself included
_FLATNESS = 9.0  # ratio of the eigenvalues of points on a line
_SPACING = 0.025  # [m] between the points that remain
_BEAM_SPACINGS = 3.4  # the reach of neighbours of far points, in distances between beams


class Beams(NamedTuple):
    """The beams of a turn in the order of time."""

    points: Floats  # (n, 2) [m] in the robot's frame at the reference time
    origins: Floats  # (n, 2) [m] of the lidar at the beam's time, in the same frame
    ages: Floats  # (n,) the beam's time in the turn, from -0.5 at its start to 0.5 at its end
    kinds: Numbers  # (n,) NOTHING, RETURN or CLUSTERED


class Thinned(NamedTuple):
    """Points with normals, of which the first ones are filled in."""

    points: Floats  # (n, 2) [m]
    normals: Floats  # (n, 2) towards the lidar
    ages: Floats  # (n,) as of Beams


@jittable
def odometry_at(times: Floats, poses: Floats, at: float, j: int) -> tuple[float, float, float, int]:
    """The pose at a time, and the sample after which it is; `j`: a sample to search from."""
    last = len(times) - 2
    j = min(max(j, 0), last)
    while j < last and times[j + 1] <= at:
        j += 1
    while j > 0 and times[j] > at:
        j -= 1
    part = min(max((at - times[j]) / (times[j + 1] - times[j]), 0.0), 1.0)
    x = poses[j, 0] + part * (poses[j + 1, 0] - poses[j, 0])
    y = poses[j, 1] + part * (poses[j + 1, 1] - poses[j, 1])
    return x, y, poses[j, 2] + part * (poses[j + 1, 2] - poses[j, 2]), j


@jittable
def deskew(
    times: Floats,
    angles: Floats,
    ranges: Floats,
    odometry_times: Floats,
    odometry: Floats,
    lag: float,
    lidar: Floats,
    most: float,
    beams: Beams,
) -> None:
    """Fill in the beams of a turn.

    Args:
        times: (n,) [s] of the beams; `lag` [s] is added to them.
        angles: (n,) [rad] in the frame of the lidar.
        ranges: (n,) [m].
        odometry_times: (m,) [s], two at least.
        odometry: (m, 3) with unwrapped headings.
        lag: [s].
        lidar: (3,) its pose on the robot.
        most: [m] Farther readings do not count.
        beams: Receives the beams, all but the clusters.
    """
    n = len(times)
    middle = 0.5 * (times[0] + times[n - 1]) + lag
    duration = max(times[n - 1] - times[0], 1e-9)
    x, y, theta, j = odometry_at(odometry_times, odometry, middle, np.searchsorted(odometry_times, middle))
    reference = (x, y, theta)
    for k in range(n):
        t = times[k] + lag
        x, y, theta, j = odometry_at(odometry_times, odometry, t, j)
        dx, dy, turned = relative(reference, (x, y, theta))
        c, s = math.cos(turned), math.sin(turned)
        ox, oy = dx + c * lidar[0] - s * lidar[1], dy + s * lidar[0] + c * lidar[1]
        direction = turned + lidar[2] + angles[k]
        r = ranges[k]
        beams.origins[k, 0], beams.origins[k, 1] = ox, oy
        beams.points[k, 0], beams.points[k, 1] = ox + r * math.cos(direction), oy + r * math.sin(direction)
        beams.ages[k] = (t - middle) / duration
        beams.kinds[k] = RETURN if MIN_RANGE <= r <= most else NOTHING


@jittable
def _next_return(kinds: Numbers, k: int, step: int) -> int:
    """The next beam with a return, at most _LOST without one later; the turn is a circle; -1: there is none."""
    n = len(kinds)
    for skipped in range(1, _LOST + 2):
        other = (k + step * skipped) % n
        if kinds[other] != NOTHING:
            return other
    return -1


@jittable
def _is_farther(beams: Beams, ranges: Floats, k: int, step: int) -> bool:
    """Whether the beam beside beam k goes on behind it. One without a return is no evidence."""
    other = _next_return(beams.kinds, k, step)
    return other >= 0 and ranges[other] > ranges[k] + _CLUSTER_CLEARANCE


@jittable
def mark_clusters(beams: Beams, ranges: Floats, widest: float, clusters: Floats) -> int:
    """Mark the small free-standing clusters of a turn.

    Args:
        beams: Of the turn; their kinds are changed.
        ranges: (n,) [m].
        widest: [m] Wider clusters are none.
        clusters: (m, 4) receives the centroid [m], the middle beam and the number of beams of each.

    Returns:
        How many there are, at most m.
    """
    n, found, k = len(ranges), 0, 0
    points, kinds = beams.points, beams.kinds
    while k < n and found < len(clusters):
        if kinds[k] == NOTHING:
            k += 1
            continue
        first, last, count = k, k, 1
        x, y = points[k, 0], points[k, 1]
        k += 1
        while k < n and k - last <= _LOST + 1:
            if kinds[k] != NOTHING:
                if math.hypot(points[k, 0] - points[last, 0], points[k, 1] - points[last, 1]) >= _CLUSTER_GAP:
                    break
                last, count = k, count + 1
                x, y = x + points[k, 0], y + points[k, 1]
            k += 1
        k = last + 1
        width = math.hypot(points[first, 0] - points[last, 0], points[first, 1] - points[last, 1])
        if count < 2 or width > widest:
            continue
        if _is_farther(beams, ranges, first, -1) and _is_farther(beams, ranges, last, 1):
            for i in range(first, last + 1):
                if kinds[i] == RETURN:
                    kinds[i] = CLUSTERED
            clusters[found, 0], clusters[found, 1] = x / count, y / count
            clusters[found, 2], clusters[found, 3] = (first + last) // 2, count
            found += 1
    return found


@jittable
def line_at(beams: Beams, k: int, reach: float) -> tuple[float, float]:
    """The unit normal, towards the lidar, of the line through the neighbours of beam k; (0, 0): they are on no line."""
    points, kinds = beams.points, beams.kinds
    px, py = points[k, 0], points[k, 1]
    count, sx, sy, sxx, sxy, syy = 1, 0.0, 0.0, 0.0, 0.0, 0.0
    for step in (-1, 1):
        for i in range(1, _NEIGHBOURS + 1):
            other = k + step * i
            if other < 0 or other >= len(kinds) or kinds[other] == CLUSTERED:
                break
            if kinds[other] == RETURN:
                x, y = points[other, 0] - px, points[other, 1] - py
                if x * x + y * y > reach * reach:
                    break
                count, sx, sy = count + 1, sx + x, sy + y
                sxx, sxy, syy = sxx + x * x, sxy + x * y, syy + y * y
    if count < _MIN_NEIGHBOURS:
        return 0.0, 0.0
    a, b, d = sxx - sx * sx / count, sxy - sx * sy / count, syy - sy * sy / count
    mean, spread = 0.5 * (a + d), math.hypot(0.5 * (a - d), b)
    if mean + spread < _FLATNESS * (mean - spread):
        return 0.0, 0.0
    along = 0.5 * math.atan2(2.0 * b, a - d)
    nx, ny = -math.sin(along), math.cos(along)
    if nx * (beams.origins[k, 0] - px) + ny * (beams.origins[k, 1] - py) < 0.0:
        nx, ny = -nx, -ny
    return nx, ny


@jittable
def thin(beams: Beams, ranges: Floats, reach: float, spacing: float, thinned: Thinned) -> int:
    """Fill in points that lie on lines, some way apart along the scan; how many there are.

    Args:
        beams: Of the turn.
        ranges: (n,) [m].
        reach: [m] how far the neighbours may be of which a normal is made.
        spacing: [rad] between beams; far points reach as far as some of them.
        thinned: Receives the points.
    """
    found, x, y = 0, math.inf, math.inf
    for k in range(len(ranges)):
        px, py = beams.points[k, 0], beams.points[k, 1]
        if beams.kinds[k] != RETURN or math.hypot(px - x, py - y) < _SPACING:
            continue
        nx, ny = line_at(beams, k, max(reach, _BEAM_SPACINGS * spacing * ranges[k]))
        if nx != 0.0 or ny != 0.0:
            thinned.points[found, 0], thinned.points[found, 1] = px, py
            thinned.normals[found, 0], thinned.normals[found, 1] = nx, ny
            thinned.ages[found] = beams.ages[k]
            found, x, y = found + 1, px, py
    return found


@dataclass(frozen=True)
class Scan:
    """A prepared turn. Its arrays are parts of scratch, which the next turn overwrites."""

    time: float  # [s] the reference time, on the clock of the odometry
    points: Floats  # (n, 2) [m] in the robot's frame at that time
    normals: Floats  # (n, 2)
    ages: Floats  # (n,) as of Beams
    clusters: Floats  # (m, 4) as of `mark_clusters`
    beams: Beams  # all beams
    ranges: Floats  # (b,) [m] of all beams


class Preparation:
    """Prepares the turns of a log."""

    def __init__(self, log: RobotLog, lag: float = 0.0, scale: float = 1.0) -> None:
        """`lag` [s] is added to the lidar's times; `scale`: a factor of the odometry's distances."""
        self.log, self.lag = log, lag
        self.times = np.ascontiguousarray(log.odometry_times, float)
        self.odometry = np.ascontiguousarray(log.odometry * (scale, scale, 1.0), float)
        self._lidar = np.ascontiguousarray(log.lidar_pose, float)
        size = max((len(turn.times) for turn in log.turns), default=1)
        self.spacing = _beam_spacing(log.turns)
        self.reach = 0.10 if self.spacing < math.radians(0.75) else 0.15
        self._points, self._origins, self._thinned, self._normals = np.zeros((4, size, 2))
        self._ages, self._thin_ages = np.zeros((2, size))
        self._kinds = np.zeros(size, np.int64)
        self._clusters = np.zeros((64, 4))

    def scan(self, number: int) -> Scan:
        """A turn of the log, prepared."""
        turn = self.log.turns[number]
        n = len(turn.times)
        beams = Beams(self._points[:n], self._origins[:n], self._ages[:n], self._kinds[:n])
        times, angles, ranges = (np.ascontiguousarray(one, float) for one in turn)
        compiled(deskew)(
            times, angles, ranges, self.times, self.odometry, self.lag, self._lidar, self.log.max_range, beams
        )
        widest = 2.0 * self.log.head_radius + _CLUSTER_MARGIN
        clusters = self._clusters[: compiled(mark_clusters)(beams, ranges, widest, self._clusters)]
        thinned = Thinned(self._thinned, self._normals, self._thin_ages)
        kept = compiled(thin)(beams, ranges, self.reach, self.spacing, thinned)
        points, normals, ages = (one[:kept] for one in thinned)
        return Scan(turn.middle + self.lag, points, normals, ages, clusters, beams, ranges)


def _beam_spacing(turns: list[Turn]) -> float:
    """The usual angle [rad] between beams."""
    widest = max(turns, key=lambda turn: len(turn.angles), default=None)
    if widest is None or len(widest.angles) < 2:
        return math.tau
    return float(np.median(np.abs(np.diff(np.unwrap(widest.angles)))))
