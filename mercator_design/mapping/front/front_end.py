"""Matches each turn of a log against the map of the turns before it, with the odometry as a prior."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.mapping import poses
from mercator_design.mapping.front.keeping import Kept
from mercator_design.mapping.front.matching import Match, Matcher, MatchSearch
from mercator_design.mapping.front.scans import Preparation, Scan
from mercator_design.mapping.front.surfels import SurfelMap
from mercator_design.mapping.logs import RobotLog
from mercator_design.mapping.track import Track

MIN_POINTS = 20
"""Points that a turn needs to be matched."""

_KEYFRAME_STEP = 0.10, 0.35  # [m] or [rad] since the last keyframe
_KEYFRAME_RATE = 0.6  # [rad/s] a keyframe turns slower,
_FAR_STEP, _LONG = 0.3, 2.0  # unless the last one is so far [m], or so long ago [s],
_NEW_SHARE = 0.85  # or so few points match: new walls have come in sight
_KEYFRAME_SHARE = 0.3
_LOST_SHARE, _LOST_TURNS = 0.5, 2
_BEHIND_SHARE, _SURE_SHARE = (
    0.1,
    0.95,
)  # of points behind walls of the map, looked for where fewer than the latter match
_JUMP = 0.08, 0.12  # [m], [rad] from the predicted pose that are none of a robot that drives,
_JUMP_DEVIATIONS = 6.0  # unless the prediction is so uncertain
_DENSE = 0.10, 0.5  # [m], [s] from turn to turn: less cannot bring more than half of the walls in sight
_WIDE = math.radians(300.0)  # a field of view that a turn of the robot does not change much
_MAX_GAP = 0.25  # [s] between samples of odometry that can place the beams between them
_GAP_SHARE = 0.9  # of a turn's points that must match if its beams could not be placed
_GAP_SPEED = 0.2, 1.0  # [m/s], [rad/s] by which a pose becomes uncertain in a gap of the odometry


@dataclass
class _Segment:
    """The map of one segment of the log, and the robot's latest pose in it."""

    number: int
    surfels: SurfelMap = field(default_factory=SurfelMap)
    pose: Floats = field(default_factory=lambda: np.zeros(3))
    turns: int = 0
    bad: int = 0  # turns running with a small share
    step: float = 0.0  # [m] since the last match
    turned: float = 0.0  # [rad] since the last match
    gap: float = 0.0  # [s] without odometry since the last match
    keyframe: tuple[float, Floats] | None = None  # time and pose of the last one


class FrontEnd:
    """Makes a track of a log, or of its first turns."""

    def __init__(self, log: RobotLog, lag: float = 0.0, scale: float = 1.0, search: MatchSearch | None = None) -> None:
        """`lag` [s] is added to the lidar's times; `scale`: a factor of the odometry's distances."""
        self.log, self.lag, self.scale = log, lag, scale
        self._search = search or MatchSearch()
        self._preparation = Preparation(log, lag, scale)
        self._matcher = Matcher()
        self._is_wide = any(len(turn.angles) and np.ptp(turn.angles) > _WIDE for turn in log.turns[:5])
        ends = np.array([(turn.times[0], turn.times[-1]) for turn in log.turns]).reshape(-1, 2) + lag
        self._times = ends.mean(axis=1)
        known, odometry = self._preparation.times, self._preparation.odometry
        self._places = poses.interpolate(known, odometry, self._times)
        self._steps = poses.between(self._places[:-1], self._places[1:])
        away = np.hypot(self._steps[:, 0], self._steps[:, 1])
        self._is_dense = bool(
            np.median([*away, 0.0]) < _DENSE[0] and np.median([*np.diff(self._times), 0.0]) < _DENSE[1]
        )
        self._gaps = _gaps(known, ends)
        turned = np.diff(np.interp(ends, known, odometry[:, 2]), axis=1)[:, 0]
        self._rates = turned / np.maximum(np.diff(ends, axis=1)[:, 0], 1e-3)

    def run(self, turns: int | None = None, advance: Callable[[int], None] | None = None) -> Track:
        """Match turns.

        Args:
            turns: How many of the first ones; None: all.
            advance: Called with the number of each turn when it was matched.
        """
        n = len(self.log.turns) if turns is None else min(turns, len(self.log.turns))
        found, shares, segments, bends = np.zeros((n, 3)), np.zeros(n), np.zeros(n, int), np.zeros(n)
        kept, segment, k = Kept(), _Segment(0), 0
        while k < n:
            match = self._match(k, segment, kept)
            if segment.bad == _LOST_TURNS:
                k -= _LOST_TURNS - 1
                kept.forget(k)
                segment = _Segment(segment.number + 1)
                continue
            found[k], segments[k] = segment.pose, segment.number
            if match is not None:
                shares[k], bends[k] = match.share, match.bend
            if advance is not None:
                advance(k)
            k += 1
        durations = np.array([turn.times[-1] - turn.times[0] for turn in self.log.turns[:n]])
        rates = self._rates[:n] + bends / np.maximum(durations, 1e-3)
        return Track(
            *(self.log, self._times[:n], found, segments, shares, rates),
            *(kept.keyframes(), kept.all_clusters(), self.lag, self.scale),
        )

    def _match(self, k: int, segment: _Segment, kept: Kept) -> Match | None:
        """Find the pose of a turn in its segment; None: it could not be matched, and has the predicted pose."""
        if segment.turns:
            step = self._steps[k - 1]
            segment.pose = poses.compose(segment.pose, step)
            segment.step += math.hypot(step[0], step[1])
            segment.turned += abs(step[2])
            segment.gap += self._gaps[k]
        segment.turns += 1
        scan = self._preparation.scan(k)
        has_gap = self._gaps[k] > 0.0
        bend, match = 0.0, None
        if len(scan.points) >= MIN_POINTS and segment.keyframe is not None:
            deviations = _deviations(segment)
            match = self._matcher.match(segment.surfels, segment.pose, deviations, scan, self._search)
            is_lost = self._is_dense and not has_gap and self._is_lost(segment, match, deviations, scan)
            segment.bad = segment.bad + 1 if is_lost else 0
            if segment.bad or match.share < (_GAP_SHARE if has_gap else _KEYFRAME_SHARE):
                match = None
            else:
                segment.pose, bend = match.pose, match.bend
                segment.step = segment.turned = segment.gap = 0.0
        if len(scan.points) >= MIN_POINTS and not has_gap and not segment.bad and self._is_keyframe(k, segment, match):
            kept.add_keyframe(k, segment.number, segment.pose, bend, scan)
            segment.surfels.insert(segment.pose, scan.points, scan.normals, scan.ages, bend)
            segment.keyframe = self._times[k], segment.pose
        kept.add_clusters(k, bend, scan, self.log.turns[k].times + self.lag)
        return match

    def _is_lost(self, segment: _Segment, match: Match, deviations: Floats, scan: Scan) -> bool:
        """Whether a turn cannot be of a robot that drives in this map."""
        if match.share < _LOST_SHARE or _is_jump(segment.pose, match.pose, deviations):
            return True
        if match.share >= _SURE_SHARE:
            return False
        lidar, reach = self.log.lidar_pose, self._search.first_reach
        return segment.surfels.share_behind(match.pose, lidar, scan.points, scan.normals, reach) > _BEHIND_SHARE

    def _is_keyframe(self, k: int, segment: _Segment, match: Match | None) -> bool:
        if segment.keyframe is None:
            return True
        if match is None:
            return not self._is_dense  # all may be new
        time, pose = segment.keyframe
        away = poses.between(pose, segment.pose)
        far = math.hypot(away[0], away[1])
        if far < _KEYFRAME_STEP[0] and abs(away[2]) < _KEYFRAME_STEP[1]:
            return False
        is_late = far >= _FAR_STEP or self._times[k] - time >= _LONG or match.share < _NEW_SHARE
        return bool(is_late or not self._is_wide or abs(self._rates[k]) < _KEYFRAME_RATE)


def _is_jump(predicted: Floats, found: Floats, deviations: Floats) -> bool:
    """Whether a robot that drives cannot be so far from where the odometry predicts it."""
    away = poses.between(predicted, found)
    far, turned = math.hypot(away[0], away[1]), abs(away[2])
    return bool(
        far > max(_JUMP[0], _JUMP_DEVIATIONS * deviations[0])
        or turned > max(_JUMP[1], _JUMP_DEVIATIONS * deviations[2])
    )


def _deviations(segment: _Segment) -> Floats:
    """Standard deviations (3,) [m, m, rad] of the pose that odometry predicts."""
    place = 0.01 + 0.08 * segment.step + _GAP_SPEED[0] * segment.gap
    heading = 0.01 + 0.03 * segment.turned + 0.02 * segment.step + _GAP_SPEED[1] * segment.gap
    return np.array([place, place, heading])


def _gaps(known: Floats, ends: Floats) -> Floats:
    """Seconds (n,) without odometry, which has samples at times (m,), in turns with ends (n, 2); 0: it is known."""
    before = np.clip(np.searchsorted(known, ends[:, 0], side="right") - 1, 0, len(known) - 1)
    after = np.clip(np.searchsorted(known, ends[:, 1]), 0, len(known) - 1)
    longest = np.zeros(len(ends))
    spaces = np.diff(known)
    for k in range(len(ends)):
        longest[k] = spaces[before[k] : after[k]].max(initial=0.0)
    outside = np.maximum(np.maximum(known[0] - ends[:, 0], ends[:, 1] - known[-1]), 0.0)
    longest = np.maximum(longest, np.where(outside > 0.05, outside + _MAX_GAP, 0.0))
    return np.where(longest > _MAX_GAP, longest, 0.0)
