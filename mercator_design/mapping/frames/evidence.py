"""Contradictions: does a robot's lidar see the other one where a frame says that it is?

A frame from wrong pairs has votes, too, but in most turns the beams go through where the other robot should be.
"""

import math
from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Floats, Numbers
from mercator_design.jit import compiled, jittable
from mercator_design.mapping.frames.fragment import STEP, Fragment, to_frame
from mercator_design.mapping.poses import inverse

NEAREST, FARTHEST = 0.2, 4.0
"""[m] Distances between robots at which beams say something."""

_HEAD_FRONT = 0.03 / 0.035
"""Part of a head's radius: its centre is so far behind the nearest return, and beams meet it so far to each side."""
_TOLERANCE = 0.10
"""[m]"""
_HIT, _MISS = 1, -1


class Evidence(NamedTuple):
    """Turns of a lidar in which the other robot was where a frame says, and in which it was not."""

    hits: int
    misses: int

    @property
    def share(self) -> float:
        """The share of hits; 0 without evidence."""
        return self.hits / max(self.hits + self.misses, 1)

    def __add__(self, other: "Evidence") -> "Evidence":  # type: ignore[override]  # no concatenation is wanted
        return Evidence(self.hits + other.hits, self.misses + other.misses)


def evidence(a: Fragment, b: Fragment, frame: Floats, offset: float, most: int = 400) -> Evidence:
    """Hits and misses of both lidars for a frame of B in A, with B's clock ahead by an offset.

    At most so many turns of each robot are looked at, evenly spread over those with the other one in reach.
    """
    return _seen_by(a, b, frame, offset, most) + _seen_by(b, a, inverse(frame), -offset, most)


def _seen_by(a: Fragment, b: Fragment, frame: Floats, offset: float, most: int) -> Evidence:
    times = a.track.times[a.turns]
    others = b.at(times + offset)
    c, s = math.cos(frame[2]), math.sin(frame[2])
    own = a.track.poses[a.turns]
    distances = np.hypot(
        frame[0] + c * others[:, 0] - s * others[:, 1] - own[:, 0],
        frame[1] + s * others[:, 0] + c * others[:, 1] - own[:, 1],
    )
    near = np.flatnonzero((distances >= NEAREST) & (distances <= FARTHEST))  # nan is neither
    if len(near) == 0:
        return Evidence(0, 0)
    near = near[np.linspace(0, len(near) - 1, min(most, len(near))).astype(np.int64)]
    turns = [a.track.log.turns[k] for k in a.turns[near]]
    first = np.concatenate([[0], np.cumsum([len(turn.times) for turn in turns])]).astype(np.int64)
    found = np.zeros(len(turns), dtype=np.int64)
    compiled(fill_evidence)(
        np.concatenate([turn.times for turn in turns]).astype(np.float64) + a.track.lag,
        np.concatenate([turn.angles for turn in turns]).astype(np.float64),
        np.concatenate([turn.ranges for turn in turns]).astype(np.float64),
        first,
        np.asarray(a.track.log.lidar_pose, dtype=np.float64),
        _HEAD_FRONT * b.track.log.head_radius,
        a.poses,
        a.start,
        to_frame(frame, b),
        b.start - offset,
        found,
    )
    return Evidence(int(np.count_nonzero(found == _HIT)), int(np.count_nonzero(found == _MISS)))


@jittable
def fill_evidence(
    times: Floats,
    angles: Floats,
    ranges: Floats,
    first: Numbers,
    lidar: Floats,
    head: float,
    own: Floats,
    own_start: float,
    other: Floats,
    other_start: float,
    found: Numbers,
) -> None:
    """Fill in what turns say of another robot: 1 it is where it should be, -1 beams go through its place, 0 neither.

    Args:
        times: (beams,) [s] of all turns.
        angles: (beams,) [rad]
        ranges: (beams,) [m], 0 where nothing returned.
        first: (turns + 1,) the first beam of each turn.
        lidar: (3,) its pose on the robot.
        head: [m] from the centre of the other robot's head to the nearest return.
        own: (m, 3) poses of the robot, every STEP.
        own_start: [s] the time of the first of them.
        other: (k, 3) poses of the other robot in the same frame.
        other_start: [s]
        found: (turns,) filled.
    """
    for turn in range(len(found)):
        low, high = first[turn], first[turn + 1]
        nearest_beam = (low + high) // 2
        bearing, distance = 0.0, 0.0
        for _ in range(3):  # the other robot at the time at which the beams pass it
            bearing, distance = sight(times[nearest_beam], lidar, own, own_start, other, other_start)
            least = 10.0
            for k in range(low, high):
                away = abs(angle_between(angles[k], bearing))
                if away < least:
                    least, nearest_beam = away, k
        window = max(0.02, head / max(distance, 0.01))
        n, nearest = 0, math.inf
        for k in range(low, high):
            if ranges[k] > 0.0 and abs(angle_between(angles[k], bearing)) <= window:
                n += 1
                nearest = min(nearest, ranges[k])
        found[turn] = 0
        if n >= 2 and distance >= NEAREST:
            if abs(nearest - (distance - head)) <= _TOLERANCE:
                found[turn] = _HIT
            elif nearest > distance + _TOLERANCE:
                found[turn] = _MISS


@jittable
def sight(
    time: float, lidar: Floats, own: Floats, own_start: float, other: Floats, other_start: float
) -> tuple[float, float]:
    """Bearing [rad] and distance [m] of another robot from the lidar of a robot at a time; arguments as above."""
    i, p = row_at(time, own_start, len(own))
    x = (1.0 - p) * own[i, 0] + p * own[i + 1, 0]
    y = (1.0 - p) * own[i, 1] + p * own[i + 1, 1]
    heading = (1.0 - p) * own[i, 2] + p * own[i + 1, 2]
    j, q = row_at(time, other_start, len(other))
    c, s = math.cos(heading), math.sin(heading)
    dx = (1.0 - q) * other[j, 0] + q * other[j + 1, 0] - (x + c * lidar[0] - s * lidar[1])
    dy = (1.0 - q) * other[j, 1] + q * other[j + 1, 1] - (y + s * lidar[0] + c * lidar[1])
    return math.atan2(dy, dx) - heading - lidar[2], math.hypot(dx, dy)


@jittable
def row_at(time: float, start: float, n: int) -> tuple[int, float]:
    """The row of n >= 2 poses before a time, and the share of the way to the next one; the ends outside."""
    place = max(0.0, min((time - start) / STEP, n - 1.000001))
    row = int(place)
    return row, place - row


@jittable
def angle_between(a: float, b: float) -> float:
    """The difference of two angles in -pi..pi [rad]."""
    turn = 2.0 * math.pi
    return a - b - turn * math.floor((a - b) / turn + 0.5)
