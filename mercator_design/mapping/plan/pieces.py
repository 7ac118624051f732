"""Pieces of walls: surfels of sharp keyframes, of which neighbours of one wall lie on one line; and walls as lines."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from mercator_design.arrays import Flags, Floats
from mercator_design.mapping import poses
from mercator_design.mapping.front.surfels import CELL
from mercator_design.mapping.plan.occupancy import sharp_keyframes
from mercator_design.mapping.plan.ways import Way, map_of

_MIN_WEIGHT = 3.0  # points of a surfel, if there are as many keyframes
_NEAR = 0.11  # [m] between neighbours
_SAME = 0.95  # product of the normals of pieces of one wall
_BESIDE = 0.03  # [m] across a wall, within which pieces are of one face
_DUPLICATE = 0.02  # [m] along a wall, within which one of two pieces is superfluous
_AGREES = 0.8  # product of the normals of a point and of the piece that it is of
_STRAIGHT = 0.97  # product of the normals of pieces of one line
_ON_LINE = 0.015  # [m] of a piece from its line
_GAP = 0.12  # [m] along a line
_MIN_PIECES = 2
_GROWTHS = 4


def pieces_of(ways: Sequence[Way]) -> Floats:
    """The pieces of walls of ways in one frame: (n, 5) mean x, y [m], unit normal x, y, weight.

    A wall on the border of two rows of cells is split by them into two halves of its points. So each piece is moved
    across to the mean of its neighbours of the same face, and doubles are dropped.
    """
    sharp = [sharp_keyframes(way) for way in ways]
    rows = map_of(ways, CELL, sharp).surfels(min(_MIN_WEIGHT, float(sum(map(np.sum, sharp)))))
    if not len(rows):
        return rows
    rows = rows[np.lexsort(rows.T[::-1])]
    places, normals, weights = rows[:, :2], rows[:, 2:4], rows[:, 4]
    pairs = cKDTree(places).query_pairs(_NEAR, output_type="ndarray")
    apart = places[pairs[:, 1]] - places[pairs[:, 0]]
    across = np.sum(normals[pairs[:, 0]] * apart, axis=1)
    same = (np.sum(normals[pairs[:, 0]] * normals[pairs[:, 1]], axis=1) > _SAME) & (np.abs(across) < _BESIDE)
    pairs, across, apart = pairs[same], across[same], apart[same]
    back = -np.sum(normals[pairs[:, 1]] * apart, axis=1)
    total, sums = weights.copy(), np.zeros(len(rows))
    for one, other, far in ((0, 1, across), (1, 0, back)):
        np.add.at(total, pairs[:, one], weights[pairs[:, other]])
        np.add.at(sums, pairs[:, one], weights[pairs[:, other]] * far)
    moved = rows.copy()
    moved[:, :2] += normals * (sums / total)[:, np.newaxis]
    along = np.abs(normals[pairs[:, 0], 0] * apart[:, 1] - normals[pairs[:, 0], 1] * apart[:, 0])
    doubles = pairs[along < _DUPLICATE]
    weaker = np.where(weights[doubles[:, 0]] < weights[doubles[:, 1]], doubles[:, 0], doubles[:, 1])
    return np.delete(moved, np.unique(weaker), axis=0)


class Looks(NamedTuple):
    """When pieces of walls were seen, and how well the points of keyframes lie on them."""

    first: Floats  # (n,) [s] the first keyframe that saw a piece, on the clock of the map; inf: none
    residual: float  # [m] rms of the distances of points to the lines of the pieces


def looks_at(pieces: Floats, ways: Sequence[Way]) -> Looks:
    """The looks of all keyframes at pieces of walls (n, 5)."""
    first, squares, count = np.full(len(pieces), np.inf), 0.0, 0
    if not len(pieces):
        return Looks(first, 0.0)
    tree = cKDTree(pieces[:, :2])
    for way in ways:
        times = way.keyframe_times - way.offset
        sharp = sharp_keyframes(way)
        for k, (pose, number) in enumerate(zip(way.keyframe_poses, way.keyframes.tolist(), strict=True)):
            points, normals = (one.astype(float) for one in way.track.keyframes.of(number))
            placed, turned = poses.transform(pose, points), poses.rotate(float(pose[2]), normals)
            far, nearest = tree.query(placed, distance_upper_bound=CELL)
            which = np.flatnonzero(np.isfinite(far))
            found = nearest[which]
            same = np.sum(turned[which] * pieces[found, 2:4], axis=1) > _AGREES
            which, found = which[same], found[same]
            first[found] = np.minimum(first[found], times[k])
            if sharp[k]:
                left = np.sum(pieces[found, 2:4] * (placed[which] - pieces[found, :2]), axis=1)
                squares, count = squares + float(left @ left), count + len(left)
    return Looks(first, math.sqrt(squares / max(count, 1)))


def lines_of(pieces: Floats) -> Floats:
    """Walls as lines (m, 4): x, y [m] of the start and of the end; the free side is on the left of its direction.

    Args:
        pieces: (n, 5), as of `pieces_of`.
    """
    left, found = np.ones(len(pieces), bool), []
    tree = cKDTree(pieces[:, :2]) if len(pieces) else None
    for seed in np.argsort(-pieces[:, 4], kind="stable").tolist():
        if tree is None or not left[seed]:
            continue
        members, line = [seed], (pieces[seed, :2], pieces[seed, 2:4])
        for _ in range(_GROWTHS):  # the longer the line, the better its direction is known
            members = _grown(pieces, tree, left, seed, line)
            line = _fitted(pieces[members])
        left[members] = False
        if len(members) >= _MIN_PIECES:
            found.append(_line(pieces[members]))
    return np.array(found).reshape(-1, 4)


def _grown(pieces: Floats, tree: cKDTree, left: Flags, seed: int, line: tuple[Floats, Floats]) -> list[int]:
    """The pieces on a line (a place and the normal), from neighbour to neighbour."""
    members, waiting = {seed}, [seed]
    place, normal = line
    while waiting:
        for other in tree.query_ball_point(pieces[waiting.pop(), :2], _GAP):
            if other in members or not left[other] or pieces[other, 2:4] @ normal < _STRAIGHT:
                continue
            if abs(normal @ (pieces[other, :2] - place)) <= _ON_LINE:
                members.add(other)
                waiting.append(other)
    return sorted(members)


def _fitted(rows: Floats) -> tuple[Floats, Floats]:
    """The mean place, and the unit normal of the line through pieces, on the side of their normals."""
    if len(rows) == 1:
        return rows[0, :2], rows[0, 2:4]
    place = np.average(rows[:, :2], axis=0, weights=rows[:, 4])
    away = rows[:, :2] - place
    _, vectors = np.linalg.eigh((away * rows[:, 4:]).T @ away)
    normal = vectors[:, 0]
    return place, normal if normal @ rows[:, 2:4].sum(axis=0) > 0.0 else -normal


def _line(rows: Floats) -> Floats:
    place, normal = _fitted(rows)
    direction = np.array([normal[1], -normal[0]])
    along = (rows[:, :2] - place) @ direction
    ends = along.min() - 0.5 * CELL, along.max() + 0.5 * CELL
    return np.concatenate([place + ends[0] * direction, place + ends[1] * direction])
