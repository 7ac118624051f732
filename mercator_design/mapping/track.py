"""The result of the front end for a robot's log: poses of all turns, and keyframes with their points."""

from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Floats, Numbers
from mercator_design.mapping import poses
from mercator_design.mapping.logs import RobotLog

Points: TypeAlias = NDArray[np.float32]
"""Points or unit normals (n, 2) [m] in the robot's frame at the reference time of a turn."""


class Keyframes(NamedTuple):
    """The turns of one robot of which a map is made; `first` and `points` are as rows of all keyframes together."""

    turns: Numbers  # (k,) their turns in the log, rising
    poses: Floats  # (k, 3) of the robot at the reference times, in the frame of the segment
    segments: Numbers  # (k,) the segments that they belong to
    first: Numbers  # (k + 1,) those of keyframe i are the points first[i] to first[i + 1]
    points: Points  # (p, 2), de-skewed, without those of small clusters
    normals: Points  # (p, 2) towards the lidar

    def of(self, number: int) -> tuple[Points, Points]:
        """The points and normals of a keyframe."""
        one = slice(self.first[number], self.first[number + 1])
        return self.points[one], self.normals[one]

    def of_segment(self, number: int) -> "Keyframes":
        """Those of a segment."""
        return self.some(*np.searchsorted(self.segments, [number, number + 1]).tolist())

    def some(self, low: int, high: int) -> "Keyframes":
        """Those of the numbers from the first one to before the last one."""
        points = slice(self.first[low], self.first[high])
        return Keyframes(
            *(self.turns[low:high], self.poses[low:high], self.segments[low:high]),
            *(self.first[low : high + 1] - self.first[low], self.points[points], self.normals[points]),
        )

    @classmethod
    def together(cls, ways: "list[Keyframes]") -> "Keyframes":
        """The keyframes of several ways in one frame; the number of the way stands for that of the segment."""
        lengths = np.concatenate([[0], *(np.diff(way.first) for way in ways)])
        return cls(
            np.concatenate([way.turns for way in ways]),
            np.concatenate([way.poses for way in ways]),
            np.repeat(np.arange(len(ways)), [len(way.turns) for way in ways]),
            np.cumsum(lengths),
            np.concatenate([way.points for way in ways]),
            np.concatenate([way.normals for way in ways]),
        )


class Clusters(NamedTuple):
    """Small free-standing clusters of returns: heads of other robots, and thin furniture."""

    turns: Numbers  # (s,) rising
    times: Floats  # (s,) [s] of their middle beam, on the clock of the odometry
    points: Points  # (s, 2) their centroids in the robot's frame at the turn's reference time
    beams: Numbers  # (s,) how many beams they have


@dataclass(frozen=True)
class Track:
    """A robot's way. Poses of different segments are in different frames: between them the robot was lost."""

    log: RobotLog
    times: Floats  # (n,) [s] reference times of all turns, on the clock of the odometry: middle + lag
    poses: Floats  # (n, 3) of the robot at these times, in the frame of the turn's segment
    segments: Numbers  # (n,) the segment of each turn, from 0
    shares: Floats  # (n,) of the points of a turn that match the map; 0 for turns that could not be matched
    rates: Floats  # (n,) [rad/s] mean yaw rate during a turn
    keyframes: Keyframes
    clusters: Clusters
    lag: float = 0.0  # [s] to add to the times of the lidar; negative if these are late
    scale: float = 1.0  # by which the distances of the odometry are multiplied

    @property
    def n_segments(self) -> int:
        return int(self.segments.max(initial=-1)) + 1

    def with_keyframes(self, found: Floats) -> "Track":
        """This track with other poses (k, 3) of its keyframes; the turns between two of them follow in proportion."""
        moved = poses.compose(found, poses.inverse(self.keyframes.poses))  # from old to new places
        changed = self.poses.copy()
        for number in range(self.n_segments):
            turns, keyframes = np.nonzero(self.segments == number)[0], np.nonzero(self.keyframes.segments == number)[0]
            if len(keyframes):
                at = self.keyframes.turns[keyframes]
                after = np.clip(np.searchsorted(at, turns), 0, len(at) - 1)
                before = np.clip(np.searchsorted(at, turns, side="right") - 1, 0, len(at) - 1)
                one, other = (poses.compose(moved[keyframes[k]], self.poses[turns]) for k in (before, after))
                apart = np.maximum(self.times[at[after]] - self.times[at[before]], 1e-9)
                part = np.clip((self.times[turns] - self.times[at[before]]) / apart, 0.0, 1.0)
                difference = other - one
                difference[:, 2] = poses.wrap(difference[:, 2])
                changed[turns] = one + part[:, np.newaxis] * difference
        return replace(self, poses=changed, keyframes=self.keyframes._replace(poses=found))

    @property
    def odometry(self) -> Floats:
        """Poses (m, 3) of the log's odometry, with corrected scale."""
        return self.log.odometry * (self.scale, self.scale, 1.0)
