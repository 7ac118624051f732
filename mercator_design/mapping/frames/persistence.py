"""Furniture: small clusters that are always there, so they are no robots."""

import math

import numpy as np

from mercator_design.arrays import Flags, Floats, Numbers
from mercator_design.jit import compiled, jittable
from mercator_design.mapping.frames.evidence import row_at
from mercator_design.mapping.frames.fragment import Fragment

_CELL = 0.05
"""[m]"""
_MAX_SHARE = 0.20
"""Share of the turns that look at a place and have a cluster there; with more it is furniture."""
_MIN_LOOKS = 30
"""Turns that must have looked at a place before it can be furniture."""
_MAX_TURNS = 1000
"""Turns whose looks are counted, evenly spread over a fragment."""
_FARTHEST = 6.0
"""[m] Beyond it a beam may miss the cell."""
_BINS = 360


def furniture(fragment: Fragment) -> Flags:
    """Which of the sightings (k,) lie where a cluster is seen in more than 20 % of the turns that look there.

    Sightings are counted in cells of 5 cm and the 8 around each. A robot that stands nearly all the time counts as
    furniture, too.
    """
    points, rows = fragment.sightings.points, fragment.turns
    if len(points) == 0:
        return np.zeros(0, dtype=np.bool_)
    cells, of = np.unique(np.floor(points / _CELL).astype(np.int64), axis=0, return_inverse=True)
    counts = _sums_around(cells, np.bincount(of.reshape(-1), minlength=len(cells)))
    often = np.flatnonzero(counts > _MAX_SHARE * _MIN_LOOKS)
    chosen = rows[np.linspace(0, len(rows) - 1, min(_MAX_TURNS, len(rows))).astype(np.int64)]
    looks = np.zeros(len(often), dtype=np.int64)
    centres = np.asarray((cells[often] + 0.5) * _CELL, dtype=np.float64)
    _count_looks(fragment, chosen, centres, looks)
    estimated = looks * (len(rows) / len(chosen))
    is_furniture = np.zeros(len(cells), dtype=np.bool_)
    is_furniture[often] = (estimated >= _MIN_LOOKS) & (counts[often] > _MAX_SHARE * estimated)
    return np.asarray(is_furniture[of.reshape(-1)])


def _sums_around(cells: Numbers, counts: Numbers) -> Numbers:
    """The counts (n,) of different cells (n, 2), with those of the 8 around each."""
    of_cell = {(int(i), int(j)): int(n) for (i, j), n in zip(cells, counts, strict=True)}
    around = [(di, dj) for di in (-1, 0, 1) for dj in (-1, 0, 1)]
    return np.array([sum(of_cell.get((int(i) + di, int(j) + dj), 0) for di, dj in around) for i, j in cells])


def _count_looks(fragment: Fragment, chosen: Numbers, centres: Floats, looks: Numbers) -> None:
    track, bins = fragment.track, np.zeros((2, _BINS))
    count = compiled(count_looks)
    lidar = np.asarray(track.log.lidar_pose, dtype=np.float64)
    for number in chosen:
        turn = track.log.turns[number]
        times = np.asarray(turn.times, dtype=np.float64) + track.lag
        angles, ranges = np.asarray(turn.angles, dtype=np.float64), np.asarray(turn.ranges, dtype=np.float64)
        count(times, angles, ranges, lidar, fragment.poses, fragment.start, centres, bins, looks)


@jittable
def count_looks(
    times: Floats,
    angles: Floats,
    ranges: Floats,
    lidar: Floats,
    own: Floats,
    own_start: float,
    centres: Floats,
    bins: Floats,
    looks: Numbers,
) -> None:
    """Count for each place whether the beams of a turn reach it.

    Args:
        times: (beams,) [s]
        angles: (beams,) [rad]
        ranges: (beams,) [m]
        lidar: (3,) its pose on the robot.
        own: (m, 3) poses of the robot, every STEP.
        own_start: [s] the time of the first of them.
        centres: (n, 2) places.
        bins: (2, bins) scratch: the longest range in each direction, and its time.
        looks: (n,) counted up.
    """
    n_bins = bins.shape[1]
    per_radian = n_bins / (2.0 * math.pi)
    for k in range(n_bins):
        bins[0, k] = 0.0
    for k in range(len(times)):
        b = math.floor(angles[k] * per_radian) % n_bins
        if ranges[k] > bins[0, b]:
            bins[0, b], bins[1, b] = ranges[k], times[k]
    middle = 0.5 * (times[0] + times[-1])
    for n in range(len(centres)):
        time, b, distance = middle, 0, 0.0
        for _ in range(2):
            i, p = row_at(time, own_start, len(own))
            heading = (1.0 - p) * own[i, 2] + p * own[i + 1, 2]
            c, s = math.cos(heading), math.sin(heading)
            dx = centres[n, 0] - ((1.0 - p) * own[i, 0] + p * own[i + 1, 0] + c * lidar[0] - s * lidar[1])
            dy = centres[n, 1] - ((1.0 - p) * own[i, 1] + p * own[i + 1, 1] + s * lidar[0] + c * lidar[1])
            distance = math.hypot(dx, dy)
            if distance > _FARTHEST:
                break
            b = math.floor((math.atan2(dy, dx) - heading - lidar[2]) * per_radian) % n_bins
            if bins[0, b] > 0.0:
                time = bins[1, b]
        if distance <= _FARTHEST and bins[0, b] > distance - _CELL:
            looks[n] += 1
