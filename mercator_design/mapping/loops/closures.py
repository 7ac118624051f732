"""Finds where a robot came back to a place that it had seen, and makes its keyframes agree."""

from collections import defaultdict
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from mercator_design.arrays import Floats, Numbers
from mercator_design.mapping import poses
from mercator_design.mapping.front.matching import Matcher, MatchSearch
from mercator_design.mapping.front.surfels import SurfelMap
from mercator_design.mapping.loops import graph
from mercator_design.mapping.loops.correlation import Window, best_pose, likelihood_of
from mercator_design.mapping.track import Keyframes, Track

_AGO = 25  # nodes between a scan and those that it may close a loop with
_APART = 8  # nodes between candidates of one scan
_CANDIDATES = 4
_AROUND = 6  # nodes to each side of a candidate that belong to its submap
_NEAR = 3.0  # [m] beyond the window
_NODE_STEP = 0.4, 0.5  # [m] or [rad] between nodes
_WEAK = np.array([1.0, 1.0, 0.5])  # standard deviations [m, m, rad] of a pose that the search found
_SEARCH = MatchSearch(first_reach=0.3, last_reach=0.12, bend=0.0)
_POINT_WEIGHT = 0.02  # of the points' information: those of a scan are not independent
_FLOOR = np.diag([0.03, 0.03, np.radians(0.7)]) ** 2  # covariance of the best match


class Round(NamedTuple):
    """Conditions of a loop closure in a round."""

    window: Window
    mean: float  # of the field, 0 to 1
    share: float  # of the points that match
    ratio: float  # of the eigenvalues of the information on the place: wrong ones slid along a corridor


ROUNDS = (
    Round(Window(4.0, 0.5), 0.70, 0.80, 0.03),
    Round(Window(1.5, 0.3), 0.65, 0.75, 0.02),
    Round(Window(0.6, 0.3), 0.60, 0.75, 0.01),
)


def close_loops(track: Track, refine: Callable[[Track], Track] | None = None) -> Track:
    """A track whose keyframes agree where the robot came back.

    Args:
        track: Each of its segments is treated by itself.
        refine: Called after each round; for example, a joint refinement of all keyframes.
    """
    for one in ROUNDS:
        parts = [closed(track.keyframes.of_segment(number), one) for number in range(track.n_segments)]
        track = track.with_keyframes(np.concatenate([np.zeros((0, 3)), *parts]))
        if refine is not None:
            track = refine(track)
    return track


def closed(keyframes: Keyframes, needs: Round) -> Floats:
    """Poses (k, 3) of keyframes that agree where a robot came back, or where another one was.

    Args:
        keyframes: In one frame; those of a segment, one after the other, are a way.
        needs: What a loop needs.
    """
    loops = find_loops(keyframes, needs)
    if not len(loops.starts):
        return keyframes.poses
    return graph.optimise(keyframes.poses, graph.ways(keyframes.poses, keyframes.segments) + loops)[0]


def find_loops(keyframes: Keyframes, needs: Round, sides: Numbers | None = None) -> graph.Edges:
    """Edges between keyframes (n); each may be wrong.

    Args:
        keyframes: As those of `closed`.
        needs: What a loop needs.
        sides: (n,) if given, only loops from a lower to a higher number of these count.
    """
    places, ways = keyframes.poses, keyframes.segments
    nodes = nodes_of(places, ways)
    found: list[tuple[int, int, Floats, Floats]] = []
    matcher = Matcher()
    groups = ways[nodes], None if sides is None else sides[nodes]
    for candidate, scans in sorted(_candidates(places[nodes], *groups, _NEAR + needs.window.place).items()):
        own = np.flatnonzero(ways[nodes] == ways[nodes[candidate]])
        submap = _Submap(keyframes, nodes[own], int(np.searchsorted(own, candidate)))
        for scan in scans:
            guess = poses.between(places[nodes[candidate]], places[nodes[scan]])
            points, normals = (one.astype(float) for one in keyframes.of(nodes[scan]))
            match = submap.match(points, normals, guess, needs, matcher)
            if match is not None:
                found.append((nodes[candidate], nodes[scan], *match))
    n = len(found)
    return graph.Edges(
        np.array([one[0] for one in found], int),
        np.array([one[1] for one in found], int),
        np.array([one[2] for one in found]).reshape(n, 3),
        np.array([one[3] for one in found]).reshape(n, 3, 3),
        np.ones(n, bool),
    )


def nodes_of(places: Floats, ways: Numbers) -> Numbers:
    """The numbers of poses (n, 3) of ways, which are numbered (n,), that are a step apart."""
    rows = [np.flatnonzero(ways == one) for one in np.unique(ways)]
    return np.concatenate([np.zeros(0, int), *(own[_nodes(places[own])] for own in rows)])


def _nodes(places: Floats) -> Numbers:
    """The numbers of poses (n, 3) that are a step apart."""
    chosen: list[int] = []
    far = turned = np.inf
    for k, motion in enumerate(poses.between(places[:-1], places[1:]) if len(places) else ()):
        if far >= _NODE_STEP[0] or turned >= _NODE_STEP[1]:
            chosen.append(k)
            far = turned = 0.0
        far, turned = far + float(np.hypot(motion[0], motion[1])), turned + abs(float(motion[2]))
    if len(places) and (far >= _NODE_STEP[0] or turned >= _NODE_STEP[1]):
        chosen.append(len(places) - 1)
    return np.array(chosen, int)


def _candidates(places: Floats, ways: Numbers, sides: Numbers | None, near: float) -> dict[int, list[int]]:
    """For nodes with poses (n, 3), by candidate: the scans that may see the same, later in its way or in later ways."""
    found: dict[int, list[int]] = defaultdict(list)
    if not len(places):
        return found
    tree = cKDTree(places[:, :2])
    for scan in range(len(places)):
        around = np.array(sorted(tree.query_ball_point(places[scan, :2], near)), int)
        is_own = ways[around] == ways[scan]
        if sides is None:
            kinds = around[is_own & (around <= scan - _AGO)], around[ways[around] < ways[scan]]
        else:
            kinds = around[:0], around[sides[around] < sides[scan]]
        for allowed in kinds:
            order = np.argsort(np.hypot(*(places[allowed, :2] - places[scan, :2]).T), kind="stable")
            chosen: list[int] = []
            for other in allowed[order].tolist():
                if all(abs(other - one) >= _APART for one in chosen):
                    chosen.append(other)
                    found[other].append(scan)
                    if len(chosen) == _CANDIDATES:
                        break
    return found


class _Submap:
    """The scans around a node, in its frame."""

    def __init__(self, keyframes: Keyframes, nodes: Numbers, centre: int) -> None:
        around = nodes[max(0, centre - _AROUND) : centre + _AROUND + 1]
        placed, self._surfels = [], SurfelMap()
        for pose, number in zip(
            poses.between(keyframes.poses[nodes[centre]], keyframes.poses[around]), around, strict=True
        ):
            points, normals = (one.astype(float) for one in keyframes.of(number))
            placed.append(poses.transform(pose, points))
            self._surfels.insert(pose, points, normals, np.zeros(len(points)))
        self._field = likelihood_of(np.concatenate(placed))

    def match(
        self, points: Floats, normals: Floats, guess: Floats, needs: Round, matcher: Matcher
    ) -> tuple[Floats, Floats] | None:
        """The pose (3,) of a scan in this map and its information (3, 3), if it is good enough."""
        found = best_pose(self._field, points, guess, needs.window, needs.mean)
        if found is None:
            return None
        flat = np.zeros(len(points))
        match = matcher.match_points(self._surfels, found[0], _WEAK, (points, normals, flat), _SEARCH)
        if match.share < needs.share or match.ratio < needs.ratio:
            return None
        weighted = _POINT_WEIGHT * match.information
        information = np.linalg.solve(np.eye(3) + weighted @ _FLOOR, weighted)
        return match.pose, 0.5 * (information + information.T)
