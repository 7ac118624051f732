"""The way of a robot in the frame of a map: poses of all its turns, matched against the final keyframes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mercator_design.arrays import Flags, Floats, Numbers
from mercator_design.mapping.front.front_end import MIN_POINTS
from mercator_design.mapping.front.matching import Matcher, MatchSearch
from mercator_design.mapping.front.scans import Preparation
from mercator_design.mapping.front.surfels import SurfelMap
from mercator_design.mapping.logs import RobotLog
from mercator_design.mapping.track import Track

_CELL = 0.025  # [m] of the map that all turns are matched against
_DEVIATIONS = np.array([0.004, 0.004, 0.006])  # [m, m, rad] of a turn's pose, which the front end has matched once
_SEARCH = MatchSearch(first_reach=0.15)
_MIN_SHARE = 0.5  # of a turn's points that must match, or it stays where the front end put it


@dataclass(frozen=True)
class Way:
    """A fragment's part of a map: a robot's log, or a segment of it, in the frame of the map."""

    name: str
    track: Track  # of the whole log, in the frames of its maps
    turns: Numbers  # (n,) its turns in the log
    times: Floats  # (n,) [s] their reference times on the robot's clock
    poses: Floats  # (n, 3) of the robot at these times
    shares: Floats  # (n,) of the points that match the map; 0: it was not matched
    keyframes: Numbers  # (k,) their numbers among the keyframes of the track
    furniture: Flags  # (s,) which clusters of the track are furniture
    covariances: Floats  # (k, 3, 3) [m, m, rad] of the poses of its keyframes, in the whole map
    frame_covariance: Floats  # (3, 3) of the middle of the way and its heading, against those of the map's first robot
    offset: float = 0.0  # [s] the robot's clock is ahead of that of the map by this; 0 if it is not known
    is_clock_known: bool = True

    @property
    def log(self) -> RobotLog:
        return self.track.log

    @property
    def is_keyframe(self) -> Flags:
        """Which turns (n,) are keyframes."""
        return np.isin(self.turns, self.track.keyframes.turns[self.keyframes])

    def preparation(self) -> Preparation:
        """Preparation of its turns, with its lag and scale."""
        return Preparation(self.log, self.track.lag, self.track.scale)

    @property
    def keyframe_times(self) -> Floats:
        """The times (k,) [s] of its keyframes on the robot's clock."""
        return self.track.times[self.track.keyframes.turns[self.keyframes]]

    @property
    def keyframe_poses(self) -> Floats:
        """The poses (k, 3) of its keyframes."""
        return self.track.keyframes.poses[self.keyframes]


def match_all(ways: Sequence[Way], advance: Callable[[int], None] | None = None) -> list[Way]:
    """Match all turns that are no keyframes against the map of all keyframes.

    Args:
        ways: Those of one map.
        advance: Called with the number of turns of a way that was matched.
    """
    surfels = map_of(ways, _CELL)
    found = []
    for way in ways:
        found.append(_matched(way, surfels))
        if advance is not None:
            advance(len(way.turns))
    return found


def map_of(ways: Sequence[Way], cell: float, chosen: Sequence[Flags] | None = None) -> SurfelMap:
    """The map of the keyframes of ways.

    Args:
        ways: Those of one map.
        cell: [m].
        chosen: Of each way, which of its keyframes; None: all.
    """
    surfels = SurfelMap(cell)
    for number, way in enumerate(ways):
        which = np.arange(len(way.keyframes)) if chosen is None else np.flatnonzero(chosen[number])
        poses = way.keyframe_poses
        for k in which:
            points, normals = (one.astype(float) for one in way.track.keyframes.of(int(way.keyframes[k])))
            surfels.insert(poses[k], points, normals, np.zeros(len(points)))
    return surfels


def _matched(way: Way, surfels: SurfelMap) -> Way:
    found, shares = way.poses.copy(), np.zeros(len(way.turns))
    matcher, preparation = Matcher(), way.preparation()
    is_keyframe = way.is_keyframe
    for row, turn in enumerate(way.turns.tolist()):
        if is_keyframe[row]:
            shares[row] = 1.0
            continue
        scan = preparation.scan(turn)
        if len(scan.points) < MIN_POINTS or way.track.shares[turn] == 0.0:
            continue
        match = matcher.match(surfels, found[row], _DEVIATIONS, scan, _SEARCH)
        if match.share >= _MIN_SHARE:
            found[row], shares[row] = match.pose, match.share
    found[:, 2] = np.unwrap(found[:, 2])
    return replace(way, poses=found, shares=shares)
