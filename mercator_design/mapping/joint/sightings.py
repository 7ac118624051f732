"""Sightings as factors: a head in the frame of one keyframe is the robot in the frame of its own keyframe."""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from mercator_design.arrays import Floats, Numbers
from mercator_design.mapping.frames.fragment import Fragment
from mercator_design.mapping.poses import transform

_GATE = 0.25
"""[m] Between a head and the robot that it should be."""
_PER_KEYFRAME = 2
"""Sightings of a robot by another one that belong to the same keyframe."""
_MAX_TIME_APART = 3.0
"""[s] From a sighting to its keyframe."""


class SightingFactors(NamedTuple):
    """Heads and the robots that they are."""

    pairs: Numbers  # (m, 2) the keyframe that saw and the keyframe of the robot that was seen
    heads: Floats  # (m, 2) in the frame of the former
    places: Floats  # (m, 2) in the frame of the latter

    @classmethod
    def none(cls) -> Self:
        return cls(np.empty((0, 2), dtype=np.int64), np.empty((0, 2)), np.empty((0, 2)))


def sighting_factors(
    parts: Sequence[Fragment], frames: Floats, offsets: Floats, keyframe_times: Sequence[Floats], clocks: Numbers
) -> SightingFactors:
    """The sightings of all parts that are explained by another part.

    Args:
        parts: The fragments.
        frames: (parts, 3) where they stand.
        offsets: (parts,) [s] of their clocks.
        keyframe_times: The times of each part's keyframes.
        clocks: (parts,) the offsets of two parts are known to each other if these are the same.
    """
    starts = np.cumsum([0, *map(len, keyframe_times)])
    found = [SightingFactors.none()]
    for a, part in enumerate(parts):
        times = part.sightings.times
        seen = transform(frames[a], part.sightings.points)
        nearest, distance = np.full(len(times), -1), np.full(len(times), _GATE)
        for b, other in enumerate(parts):
            if other.is_of_robot(part) or clocks[a] != clocks[b]:
                continue
            place = transform(frames[b], other.at(times + offsets[b] - offsets[a])[:, :2])
            away = np.hypot(*(seen - place).T)
            better = away < distance  # never where it is nan
            nearest[better], distance[better] = b, away[better]
        for b in sorted(set(nearest[nearest >= 0].tolist())):
            rows = np.flatnonzero(nearest == b)
            found.append(_between(parts, starts, keyframe_times, a, b, rows, float(offsets[b] - offsets[a])))
    return SightingFactors(*(np.ascontiguousarray(np.concatenate(column)) for column in zip(*found, strict=True)))


def _between(
    parts: Sequence[Fragment],
    starts: Numbers,
    keyframe_times: Sequence[Floats],
    a: int,
    b: int,
    rows: Numbers,
    later: float,
) -> SightingFactors:
    """Factors of sightings (rows) of b by a."""
    if min(len(keyframe_times[a]), len(keyframe_times[b])) == 0:
        return SightingFactors.none()
    part, other = parts[a], parts[b]
    times = part.sightings.times[rows]
    i, j = _nearest(keyframe_times[a], times), _nearest(keyframe_times[b], times + later)
    near = np.abs(keyframe_times[a][i] - times) <= _MAX_TIME_APART
    near &= np.abs(keyframe_times[b][j] - times - later) <= _MAX_TIME_APART
    # Of the sightings at one keyframe the middle ones count: they are nearest to it.
    order = np.lexsort((np.abs(keyframe_times[a][i] - times), i))
    rank = np.empty(len(rows), dtype=np.int64)
    rank[order] = np.arange(len(rows)) - np.searchsorted(i[order], i[order])
    kept = np.flatnonzero(near & (rank < _PER_KEYFRAME))
    i, j, times = i[kept], j[kept], times[kept]
    seen, at = part.sightings.points[rows[kept]], other.at(times + later)[:, :2]
    heads = _in_frames(_keyframe_poses(part)[i], seen)
    return SightingFactors(
        np.column_stack([starts[a] + i, starts[b] + j]), heads, _in_frames(_keyframe_poses(other)[j], at)
    )


def _keyframe_poses(part: Fragment) -> Floats:
    keyframes = part.track.keyframes
    return np.asarray(keyframes.poses[keyframes.segments == part.segment])


def _in_frames(poses: Floats, points: Floats) -> Floats:
    """Points (n, 2), each in the frame that stands at its pose (n, 3)."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x, y = points[:, 0] - poses[:, 0], points[:, 1] - poses[:, 1]
    return np.column_stack([c * x + s * y, c * y - s * x])


def _nearest(rising: Floats, values: Floats) -> Numbers:
    """The rows (n,) of the nearest of rising numbers (m,) to values (n,)."""
    after = np.clip(np.searchsorted(rising, values), 1, max(len(rising) - 1, 1))
    after = np.minimum(after, len(rising) - 1)
    before = np.maximum(after - 1, 0)
    return np.asarray(np.where(np.abs(rising[before] - values) <= np.abs(rising[after] - values), before, after))
