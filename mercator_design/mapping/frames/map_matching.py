"""Frames by maps: where do the walls of one map lie on those of another one?

All places on a grid and all headings are tried by correlation. Symmetric rooms have several answers, so a frame is only
accepted if the second one is clearly worse.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Floats
from mercator_design.mapping.frames.walls import CELL, Field, Walls
from mercator_design.mapping.poses import compose, differ, rotate, wrap

MAX_SECOND = 0.80
"""Ratio of the second distinct peak's score to that of the first: wrong ones had 0.87 to 1.00."""
MIN_SCORE = 0.5
"""Mean value of the field at the walls."""
MIN_PIECES = 60
"""Pieces of walls in each map: some 3 m."""

_N_ANGLES = 180
_DISTINCT = 0.3, math.radians(12.0)
"""[m], [rad]"""
_PEAKS_OF_ANGLE = 2
_N_ANGLES_OF_LARGE = 360
_MAX_SIZE = 800
"""Cells along a side of the correlated grids, about; those of larger maps are coarser."""


class MapMatch(NamedTuple):
    """The best frame of one map in another one."""

    frame: Floats  # (3,)
    score: float  # mean value of the field at its walls
    second: float  # the score of the best frame that is distinct from it, over its own
    refusal: str  # why it is not enough; empty: it is
    peaks: tuple[Floats, ...]  # distinct frames (3,) before they were refined, those with the best scores first


def match_maps(walls: Walls, field: Field, of_field: Walls) -> MapMatch | None:
    """The best frame of walls in the map of a field; None if one of them has hardly any walls.

    Args:
        walls: The walls whose frame is searched.
        field: The other map as a field.
        of_field: The other map's walls.
    """
    if min(len(walls.points), len(of_field.points)) < MIN_PIECES:
        return None
    peaks = _peaks(walls, field)
    if not peaks:
        return None
    fine = [(_refined(walls, of_field, frame), score) for score, frame in peaks[:6]]
    scored = sorted(((_score(walls, field, frame), tuple(frame)) for frame, _ in fine), reverse=True)
    score, best = scored[0][0], np.array(scored[0][1])
    rivals = [one for one, frame in scored if differ(best, np.array(frame), _DISTINCT)]
    rivals += [one for one, frame in peaks if differ(best, frame, _DISTINCT)][:1]
    second = max([*rivals, 0.0]) / max(score, 1e-9)
    return MapMatch(best, score, second, _refusal(score, second), tuple(frame for _, frame in peaks))


def _refusal(score: float, second: float) -> str:
    if score < MIN_SCORE:
        return f"the maps agree in {score:.0%} of their walls, expected {MIN_SCORE:.0%}"
    if second > MAX_SECOND:
        return f"a second frame of the maps is {second:.0%} as good: the arena is symmetric, or little of it was seen"
    return ""


def _peaks(walls: Walls, field: Field) -> list[tuple[float, Floats]]:
    """Distinct frames with the best scores, best first."""
    from scipy import fft

    middle = walls.points.mean(axis=0)
    centred = walls.points - middle
    reach = float(np.linalg.norm(centred, axis=1).max())
    coarse = math.ceil((max(field.values.shape) * CELL + 2.0 * reach) / (CELL * _MAX_SIZE))
    values, cell = _coarser(field.values, coarse), CELL * coarse
    n_angles = _N_ANGLES if coarse == 1 else _N_ANGLES_OF_LARGE
    half = math.ceil(reach / cell) + 1
    shape = tuple(int(fft.next_fast_len(n + 2 * half + 1, real=True)) for n in values.shape)
    image = fft.rfft2(values, shape)  # padded: the correlation would wrap around
    found: list[tuple[float, Floats]] = []
    suppressed = math.ceil(_DISTINCT[0] / cell)
    for k in range(n_angles):
        angle = -math.pi + 2.0 * math.pi * k / n_angles
        cells = np.floor(rotate(angle, centred) / cell + 0.5).astype(np.int64) + half
        other = np.zeros((2 * half + 1, 2 * half + 1), dtype=np.float32)
        np.add.at(other, (cells[:, 1], cells[:, 0]), 1.0)
        sums = fft.irfft2(image * np.conj(fft.rfft2(other, shape)), shape)
        for _ in range(_PEAKS_OF_ANGLE):
            i, j = np.unravel_index(int(np.argmax(sums)), shape)
            score = float(sums[i, j]) / len(cells)
            row = int(i) - shape[0] if i >= values.shape[0] else int(i)  # shifts beyond the field are negative
            column = int(j) - shape[1] if j >= values.shape[1] else int(j)
            place = field.low + cell * (np.array([column, row]) + half + 0.5)
            turned = rotate(angle, middle[None])[0]
            found.append((score, np.array([place[0] - turned[0], place[1] - turned[1], angle])))
            rows = np.arange(i - suppressed, i + suppressed + 1) % shape[0]
            columns = np.arange(j - suppressed, j + suppressed + 1) % shape[1]
            sums[np.ix_(rows, columns)] = -math.inf
    found.sort(key=lambda one: (-one[0], *one[1]))
    distinct: list[tuple[float, Floats]] = []
    for score, frame in found:
        if all(differ(frame, other, _DISTINCT) for _, other in distinct):
            distinct.append((score, frame))
    return distinct


def _coarser(values: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    """A field of larger cells, each with the largest of its values."""
    if factor == 1:
        return values
    rows, columns = (factor * math.ceil(n / factor) for n in values.shape)
    padded = np.zeros((rows, columns), dtype=np.float32)
    padded[: values.shape[0], : values.shape[1]] = values
    blocks = padded.reshape(rows // factor, factor, columns // factor, factor)
    return np.asarray(blocks.max(axis=(1, 3)), dtype=np.float32)


def _score(walls: Walls, field: Field, frame: Floats) -> float:
    return float(field.at(walls.moved(frame)[0]).mean())


def _refined(walls: Walls, others: Walls, frame: Floats, steps: int = 15) -> Floats:
    """The frame after point-to-line ICP of the walls to the others."""
    from scipy.spatial import KDTree

    tree = KDTree(others.points)
    for step in range(steps):
        gate = 0.25 * (0.08 / 0.25) ** (step / (steps - 1))
        points, normals = walls.moved(frame)
        distance, nearest = tree.query(points, distance_upper_bound=gate)
        matched = np.isfinite(distance)
        matched[matched] = np.einsum("ij,ij->i", normals[matched], others.normals[nearest[matched]]) > 0.8
        if np.count_nonzero(matched) < 10:
            break
        at, lines = others.points[nearest[matched]], others.normals[nearest[matched]]
        middle = points[matched].mean(axis=0)
        arm = points[matched] - middle
        left = np.einsum("ij,ij->i", lines, at - points[matched])
        weights = (0.05**2 / (0.05**2 + left**2)) ** 2
        rows = np.column_stack([lines, lines[:, 1] * arm[:, 0] - lines[:, 0] * arm[:, 1]])
        normal = (rows * weights[:, None]).T @ rows + np.diag([1e-6, 1e-6, 1e-6])
        change = np.linalg.solve(normal, rows.T @ (weights * left))
        about = np.array([middle[0], middle[1], 0.0])
        turned = compose(about, compose(np.array([change[0], change[1], change[2]]), -about))
        frame = compose(turned, frame)
        if np.abs(change).max() < 1e-5:
            break
    frame[2] = wrap(frame[2])
    return frame
