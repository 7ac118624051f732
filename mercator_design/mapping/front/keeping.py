"""Collects keyframes and clusters while a log is matched."""

from dataclasses import dataclass, field

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.mapping.front.scans import Scan
from mercator_design.mapping.track import Clusters, Keyframes, Points


@dataclass
class Kept:
    """Rows of keyframes and clusters, in the order of turns."""

    turns: list[int] = field(default_factory=list)
    poses: list[Floats] = field(default_factory=list)
    segments: list[int] = field(default_factory=list)
    points: list[Points] = field(default_factory=list)
    normals: list[Points] = field(default_factory=list)
    clusters: list[Floats] = field(default_factory=list)  # (m, 5) of a turn: turn, time, x, y, beams

    def add_keyframe(self, turn: int, segment: int, pose: Floats, bend: float, scan: Scan) -> None:
        """Keep the points of a turn, straightened by its bend."""
        self.turns.append(turn)
        self.segments.append(segment)
        self.poses.append(pose)
        for rows, vectors in ((self.points, scan.points), (self.normals, scan.normals)):
            rows.append(straightened(vectors, bend * scan.ages).astype(np.float32))

    def add_clusters(self, turn: int, bend: float, scan: Scan, times: Floats) -> None:
        """Keep the clusters of a turn, whose beams have times (n,) [s] on the clock of the odometry."""
        if len(scan.clusters):
            middle = scan.clusters[:, 2].astype(int)
            places = straightened(scan.clusters[:, :2], bend * scan.beams.ages[middle])
            turns = np.full(len(middle), float(turn))
            self.clusters.append(np.column_stack([turns, times[middle], places, scan.clusters[:, 3]]))

    def forget(self, turn: int) -> None:
        """Forget what is of this turn and of later ones."""
        while self.turns and self.turns[-1] >= turn:
            for rows in (self.turns, self.poses, self.segments, self.points, self.normals):
                rows.pop()
        while self.clusters and self.clusters[-1][0, 0] >= turn:
            self.clusters.pop()

    def keyframes(self) -> Keyframes:
        first = np.concatenate([[0], np.cumsum([len(one) for one in self.points], dtype=int)])
        empty = np.zeros((0, 2), np.float32)
        return Keyframes(
            np.array(self.turns, int),
            np.array(self.poses).reshape(-1, 3),
            np.array(self.segments, int),
            first,
            np.concatenate([empty, *self.points]),
            np.concatenate([empty, *self.normals]),
        )

    def all_clusters(self) -> Clusters:
        rows = np.concatenate([np.zeros((0, 5)), *self.clusters])
        return Clusters(rows[:, 0].astype(int), rows[:, 1], rows[:, 2:4].astype(np.float32), rows[:, 4].astype(int))


def straightened(vectors: Floats, angles: Floats) -> Floats:
    """Vectors (n, 2), each turned counter-clockwise by its angle (n,) [rad]."""
    c, s = np.cos(angles), np.sin(angles)
    x, y = vectors[:, 0], vectors[:, 1]
    return np.column_stack([c * x - s * y, s * x + c * y])
