"""A part of a robot's way that has one frame: a whole log, or what lies between two moments when the robot was lost."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mercator_design.arrays import Flags, Floats, Numbers
from mercator_design.mapping.poses import between, compose, interpolate, inverse, transform, wrap
from mercator_design.mapping.track import Keyframes, Track

STEP = 0.02
"""[s] Between the poses of a fragment."""
HEAD_DEPTH = 0.25 * math.pi
"""Part of a head's radius by which the centroid of its returns lies before its centre."""

_MARGIN = 0.1
"""[s] About half a turn of a lidar: by it the odometry continues a fragment at its ends."""


@dataclass(frozen=True)
class Sightings:
    """Heads of other robots in the frame of a fragment."""

    times: Floats  # (k,) [s]
    points: Floats  # (k, 2) their centres
    rows: Numbers  # (k,) the clusters of the track that they are


_NOTHING = Sightings(np.empty(0), np.empty((0, 2)), np.empty(0, dtype=np.int64))


@dataclass(frozen=True)
class Fragment:
    """Poses at every moment of a segment, and what was seen then."""

    track: Track
    segment: int
    turns: Numbers  # (n,) its turns in the log
    start: float  # [s] the time of the first of the poses
    poses: Floats  # (m, 3) of the robot, every STEP; the headings are unwrapped
    sightings: Sightings

    @property
    def name(self) -> str:
        """The robot's name, with the segment's number if there are several."""
        return self.track.log.name + (f" (part {self.segment + 1})" if self.track.n_segments > 1 else "")

    @property
    def end(self) -> float:
        """The time of the last of the poses [s]."""
        return self.start + STEP * (len(self.poses) - 1)

    def at(self, times: Floats) -> Floats:
        """Poses (n, 3) at times (n,) [s]; nan outside the fragment."""
        place = (np.asarray(times, float) - self.start) / STEP
        inside = (place >= 0.0) & (place <= len(self.poses) - 1)
        row = np.minimum(np.where(inside, place, 0.0).astype(np.int64), max(len(self.poses) - 2, 0))
        share = (place - row)[:, np.newaxis]
        following = np.minimum(row + 1, len(self.poses) - 1)
        found: Floats = (1.0 - share) * self.poses[row] + share * self.poses[following]
        found[~inside] = math.nan
        return found

    def with_sightings(self, kept: Flags | Numbers) -> "Fragment":
        """The same with some of its sightings."""
        times, points, rows = self.sightings.times, self.sightings.points, self.sightings.rows
        return replace(self, sightings=Sightings(times[kept], points[kept], rows[kept]))

    @property
    def beginning(self) -> Floats:
        """The robot's pose (3,) at the first time of the log's odometry; of the first fragment of a log."""
        log = self.track.log
        at = np.array([log.odometry_times[0], self.track.times[self.turns[0]]])
        first, turn = interpolate(log.odometry_times, self.track.odometry, at)
        return compose(self.track.poses[self.turns[0]], between(turn, first))

    @property
    def keyframes(self) -> Keyframes:
        """Its keyframes."""
        return self.track.keyframes.of_segment(self.segment)

    def with_keyframes(self, found: Floats) -> "Fragment":
        """The same with other poses (k, 3) of its keyframes; its turns, poses and sightings follow."""
        of_track = self.track.keyframes.poses.copy()
        of_track[self.track.keyframes.segments == self.segment] = found
        moved = _fragment(self.track.with_keyframes(of_track), self.segment)
        return moved.with_sightings(np.isin(moved.sightings.rows, self.sightings.rows))

    def is_of_robot(self, other: "Fragment") -> bool:
        """Whether both are of one robot."""
        return self.track.log is other.track.log


def keyframes_of(parts: Sequence[Fragment], frames: Floats) -> Keyframes:
    """The keyframes of fragments that stand at frames (parts, 3), all in one frame."""
    own = [part.keyframes for part in parts]
    return Keyframes.together([one._replace(poses=compose(at, one.poses)) for one, at in zip(own, frames, strict=True)])


def bent(parts: Sequence[Fragment], frames: Floats, poses: Floats) -> list[Fragment]:
    """Fragments, at frames (parts, 3), whose keyframes have new poses (k, 3) in the frame of these."""
    found, begin = [], 0
    for part, frame in zip(parts, frames, strict=True):
        end = begin + len(part.keyframes.turns)
        found.append(part.with_keyframes(compose(inverse(frame), poses[begin:end])))
        begin = end
    return found


def fragments(track: Track, min_turns: int = 10) -> list[Fragment]:
    """The fragments of a robot's way; parts of fewer turns are left out, unless the robot has no other."""
    counts = np.bincount(track.segments, minlength=track.n_segments)
    wanted = np.flatnonzero(counts >= min(min_turns, counts.max(initial=0)))
    return [_fragment(track, int(segment)) for segment in wanted if counts[segment]]


def _fragment(track: Track, segment: int) -> Fragment:
    rows = np.flatnonzero(track.segments == segment)
    times, known = track.times[rows], track.poses[rows]
    odometry_times, odometry = track.log.odometry_times, track.odometry
    start = times[0] - _MARGIN
    at = start + STEP * np.arange(math.ceil((times[-1] + _MARGIN - start) / STEP) + 1)
    moved = interpolate(odometry_times, odometry, at)
    turned = interpolate(odometry_times, odometry, times)
    before = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 1)
    after = np.minimum(before + 1, len(times) - 1)
    # Between two turns the odometry continues from the first one and leads to the second one.
    forwards = compose(known[before], compose(inverse(turned[before]), moved))
    back = compose(known[after], compose(inverse(turned[after]), moved))
    gap = np.maximum(times[after] - times[before], 1e-9)
    share = np.clip((at - times[before]) / gap, 0.0, 1.0)[:, np.newaxis]
    difference = back - forwards
    difference[:, 2] = wrap(difference[:, 2])
    poses = forwards + share * difference
    poses[:, 2] = np.unwrap(poses[:, 2])
    bare = Fragment(track, segment, rows, float(start), poses, _NOTHING)
    return replace(bare, sightings=_sightings(bare))


def _sightings(fragment: Fragment) -> Sightings:
    """The small clusters, each as the centre of a head in the fragment's frame."""
    track = fragment.track
    clusters = track.clusters
    chosen = np.flatnonzero(track.segments[clusters.turns] == fragment.segment)
    turns, times = clusters.turns[chosen], clusters.times[chosen]
    at, moment = track.poses[turns], fragment.at(times)
    chosen = chosen[~np.isnan(moment[:, 0])]
    turns, times = clusters.turns[chosen], clusters.times[chosen]
    at, moment = track.poses[turns], fragment.at(times)
    c, s = np.cos(at[:, 2]), np.sin(at[:, 2])
    x, y = clusters.points[chosen, 0].astype(float), clusters.points[chosen, 1].astype(float)
    points = np.column_stack([at[:, 0] + c * x - s * y, at[:, 1] + s * x + c * y])
    lidar = compose(moment, track.log.lidar_pose)[:, :2]
    away = points - lidar
    away *= HEAD_DEPTH * track.log.head_radius / np.maximum(np.linalg.norm(away, axis=1), 1e-6)[:, np.newaxis]
    return Sightings(times, points + away, chosen)


def to_frame(frame: Floats, fragment: Fragment) -> Floats:
    """The fragment's poses (m, 3) in the frame in which its own frame stands at a pose (3,)."""
    return np.column_stack([transform(frame, fragment.poses[:, :2]), fragment.poses[:, 2] + frame[2]])
