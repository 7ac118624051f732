"""Frames of maps that share only a part: scans of one are searched for in the other one, and must agree on one frame.

Correlation of whole maps proposes frames. Around each, scans of one map are matched to submaps of the other one; a
pose graph of both bends them so that most of these loops agree, and drops the others (GNC). A frame needs many scans
over a wide area, found nearly wherever both robots looked from one place, no walls of one where beams of the other one
went, and no rival. Arenas are too small for that: of a symmetric one, a part would fit in several ways.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from mercator_design.arrays import Floats, Numbers
from mercator_design.mapping.frames.walls import conflict, field_of, walls_seen
from mercator_design.mapping.loops import graph
from mercator_design.mapping.loops.closures import Round, find_loops, nodes_of
from mercator_design.mapping.loops.correlation import Window
from mercator_design.mapping.poses import between, compose, differ, wrap
from mercator_design.mapping.rigid import fit
from mercator_design.mapping.track import Keyframes

MIN_SCANS = 20
"""Scans of one map that are found in the other one; wrong frames had at most 14."""
MIN_SHARE = 0.6
"""Share of scans that must be found, of those with a scan of the other map near them: right frames had 0.84 at least,
wrong ones with more than 10 scans 0.3 at most."""
MIN_REACH = 8.0
"""[m] Over which the scans that are found spread."""
MAX_CONFLICT = 0.05
"""Share of one map's walls that may lie where the beams of the other one's robot went: right ones had 0.04 at most."""
MAX_SECOND = 0.35
"""The scans of a rival over those of the best frame: at the corners of a symmetric ring 0.4 to 0.7."""

_NEEDS = Round(Window(1.5, 0.3), 0.65, 0.75, 0.02)
_ROUNDS = 2  # of a search around the poses that were bent by the one before
_TRIED = 8  # frames
_SAME = 4.0, 0.5  # [m], [rad] between proposed frames that bend to one
_KEPT_WEIGHT = 0.25  # of a loop that agrees: its squared error is at most that of 1 in 100 right ones
_MIN_LOOPS = 5  # loops worth another step
_AT = 1.0, 0.6  # [m], [rad] between scans from one place
_STIFF_REACH, _STIFF_AGO = 2.0, 25  # [m], keyframes between two that a map's own loops hold together
_STIFFNESS = np.diag([100.0, 100.0, 1000.0])  # [1/m^2, 1/m^2, 1/rad^2] by which they do
_RIVAL_SHARE, _RIVAL_CONFLICT = 0.3, 0.15


class Overlap(NamedTuple):
    """How a map stands in another one with which it shares a part."""

    frame: Floats  # (3,) of the second map in the first one
    poses: Floats  # (k, 3) of the keyframes of the first map and then of the second one, bent to agree
    scans: int  # of the second map that are found in the first one
    share: float  # of those that should be
    reach: float  # [m] over which they spread
    conflict: float  # share of walls where beams of the other map went
    second: float  # scans of the best rival over these
    refusal: str  # why it is not enough; empty: it is


def overlap(first: Keyframes, second: Keyframes, proposed: Sequence[Floats]) -> Overlap | None:
    """The best of proposed frames of the second map in the first one; None: hardly any scans are found in any.

    Args:
        first: Of a map, in its frame; those of a segment are one way.
        second: Likewise, in a frame of its own.
        proposed: Frames (3,), the most likely first.
    """
    if min(reach_of(first.poses), reach_of(second.poses)) < MIN_REACH:
        return None
    found: list[Overlap] = []
    tried: list[Floats] = []
    for frame in proposed:
        if len(tried) == _TRIED:
            break
        if not all(differ(frame, other, _SAME) for other in tried):
            continue
        tried.append(frame)
        one = _followed(first, second, frame)
        if one is not None:
            found.append(one)
    if not found:
        return None
    best = max(found, key=lambda one: (not one.refusal, one.scans))
    rivals = [one.scans for one in found if _is_rival(one) and differ(one.frame, best.frame, _SAME)]
    best = best._replace(second=max(rivals, default=0) / best.scans)
    if not best.refusal and best.second > MAX_SECOND:
        return best._replace(refusal=f"in a second frame {best.second:.0%} as many scans fit")
    return best


def reach_of(poses: Floats) -> float:
    """Metres over which poses (n, 3) spread, along the axis where that is most."""
    if len(poses) < 2:
        return 0.0
    centred = poses[:, :2] - poses[:, :2].mean(axis=0)
    axis = np.linalg.eigh(centred.T @ centred)[1][:, 1]
    return float(np.ptp(centred @ axis))


def _is_rival(one: Overlap) -> bool:
    return one.share >= _RIVAL_SHARE and one.conflict <= _RIVAL_CONFLICT


def _followed(first: Keyframes, second: Keyframes, frame: Floats) -> Overlap | None:
    """Bend both maps by loops, from a proposed frame; None if there are too few loops."""
    n = len(first.turns)
    moved = second._replace(poses=compose(frame, second.poses), segments=second.segments + first.segments[-1] + 1)
    both = Keyframes.together([first, moved])._replace(segments=np.concatenate([first.segments, moved.segments]))
    sides = np.repeat([0, 1], [n, len(second.turns)])
    own = graph.ways(both.poses, both.segments) + _held(both.poses, sides)
    scans = searched = np.zeros(0, int)
    for _ in range(_ROUNDS):
        loops = find_loops(both, _NEEDS, sides)
        if len(loops.starts) < _MIN_LOOPS:
            return None
        searched = n + nodes_of(both.poses[n:], both.segments[n:])
        found, weights = graph.optimise(both.poses, own + loops)
        both = both._replace(poses=found)
        scans = np.unique(loops.ends[weights[-len(loops.starts) :] >= _KEPT_WEIGHT])
    if not len(scans):
        return None
    share, reach = _share(both.poses, n, searched, scans), reach_of(both.poses[scans])
    walls = [walls_seen(both.some(0, n)), walls_seen(both.some(n, len(sides)))]
    fields = [field_of(one) for one in walls]
    worst = max(conflict(walls[1], fields[0], np.zeros(3)), conflict(walls[0], fields[1], np.zeros(3)))
    at = fit(second.poses[:, :2], both.poses[n:, :2])
    return Overlap(at, both.poses, len(scans), share, reach, worst, 0.0, _refusal(len(scans), share, reach, worst))


def _refusal(scans: int, share: float, reach: float, worst: float) -> str:
    if scans < MIN_SCANS:
        return f"only {scans} scans of one map are found in the other one, expected {MIN_SCANS}"
    if share < MIN_SHARE:
        return (
            f"{share:.0%} of the scans from places that both saw are found in the other map, expected {MIN_SHARE:.0%}"
        )
    if reach < MIN_REACH:
        return f"the scans that are found spread over {reach:.1f} m, expected {MIN_REACH:.0f} m"
    if worst > MAX_CONFLICT:
        return f"{worst:.0%} of the walls of one map stand where beams went through in the other one"
    return ""


def _held(poses: Floats, sides: Numbers) -> graph.Edges:
    """Edges between near poses (n, 3) of one side, far apart in order, as they stand: a map's own loops are closed."""
    starts, ends = [], []
    for side in np.unique(sides):
        rows = np.flatnonzero(sides == side)
        near = cKDTree(poses[rows, :2]).query_ball_point(poses[rows, :2], _STIFF_REACH, return_sorted=True)
        for k, around in enumerate(near):
            before = [other for other in around if other <= k - _STIFF_AGO]
            if before:
                starts.append(rows[before[len(before) // 2]])
                ends.append(rows[k])
    first, last = np.array(starts, int), np.array(ends, int)
    motions = between(poses[first], poses[last]) if len(first) else np.zeros((0, 3))
    return graph.Edges(first, last, motions, np.tile(_STIFFNESS, (len(first), 1, 1)), np.zeros(len(first), bool))


def _share(poses: Floats, n: int, searched: Numbers, scans: Numbers) -> float:
    """How many are found of the scans that were searched, near those of the first map (n) and with their heading."""
    tree = cKDTree(poses[:n, :2])
    expected = found = 0
    known = set(scans.tolist())
    for k in searched.tolist():
        near = np.array(tree.query_ball_point(poses[k, :2], _AT[0]), int)
        if (np.abs(wrap(poses[near, 2] - poses[k, 2])) < _AT[1]).any():
            expected += 1
            found += k in known
    return found / max(expected, 1)
