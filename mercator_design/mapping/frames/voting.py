"""Frames by votes: where must robot B's frame stand in robot A's, so that each is where the other one saw a head?

Every sighting is paired with the place of the other robot at that time. Most of A's sightings are of third robots:
their pairs spread over many frames, those of B agree on one. So nobody has to know who was seen.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Floats
from mercator_design.jit import compiled, jittable
from mercator_design.mapping.frames.fragment import STEP, Fragment
from mercator_design.mapping.poses import compose, differ, transform, wrap

GATES = (0.4, 0.25, 0.15, 0.10, 0.08)
"""[m] The largest distance of a pair that counts, in the steps of the refinement."""

_CELL = 0.15
"""[m] Of the histogram of places."""
_N_ANGLES = 120
_PEAKS_OF_ANGLE = 3
DISTINCT = 0.5, math.radians(20.0)
"""[m], [rad] By which distinct frames differ in one or the other."""
_MAX_CELLS = 4_000_000


class Pairs(NamedTuple):
    """Pairs of points that vote for a frame of B in A, which should move each source onto its target."""

    sources: Floats  # (n, 2) in B's frame: B's places at A's sightings, then B's sightings
    targets: Floats  # (n, 2) in A's frame: A's sightings, then A's places at B's sightings
    source_speeds: Floats  # (n, 2) [m/s] of the sources, as the clock of B goes ahead of that of A
    target_speeds: Floats  # (n, 2) [m/s] of the targets


class FrameFit(NamedTuple):
    """A frame that was refined."""

    frame: Floats  # (3,) of B in A
    offset: float  # [s] B's clock less A's
    votes: int  # pairs nearer than the last gate
    residual: float  # [m] rms of these
    spread: float  # [m] length over which the sources of these spread
    distinct: int  # pairs at different places: cells of 10 cm of the sources and the targets


def pairs_of(a: Fragment, b: Fragment, offset: float) -> Pairs:
    """The pairs of two robots, if B's clock is so many seconds ahead of A's."""
    x_b = b.at(a.sightings.times + offset)[:, :2]
    x_a = a.at(b.sightings.times - offset)[:, :2]
    seen_a, seen_b = ~np.isnan(x_b[:, 0]), ~np.isnan(x_a[:, 0])
    at_a, at_b = a.sightings.times[seen_a], b.sightings.times[seen_b]
    nothing_a, nothing_b = np.zeros((len(at_a), 2)), np.zeros((len(at_b), 2))
    return Pairs(
        np.concatenate([x_b[seen_a], b.sightings.points[seen_b]]),
        np.concatenate([a.sightings.points[seen_a], x_a[seen_b]]),
        np.concatenate([_speeds(b, at_a + offset), nothing_b]),
        np.concatenate([nothing_a, -_speeds(a, at_b - offset)]),
    )


def candidates(pairs: Pairs, most: int = 5) -> list[tuple[Floats, int]]:
    """The distinct frames (3,) with the most votes, and these, best first."""
    if len(pairs.sources) == 0:
        return []
    reach = float(np.abs(pairs.sources).max() * math.sqrt(2.0))
    low, high = pairs.targets.min(axis=0) - reach, pairs.targets.max(axis=0) + reach
    cell = max(_CELL, math.sqrt(float(np.prod(high - low)) / _MAX_CELLS))
    columns, rows = (int(n) + 3 for n in np.ceil((high - low) / cell))
    angles = -math.pi + 2.0 * math.pi * np.arange(_N_ANGLES) / _N_ANGLES
    peaks = np.zeros((_N_ANGLES, _PEAKS_OF_ANGLE, 3))
    scratch: NDArray[np.int32] = np.zeros((3, rows, columns), dtype=np.int32)
    suppressed = math.ceil(DISTINCT[0] / cell)
    compiled(fill_peaks)(pairs.sources, pairs.targets, angles, low, cell, suppressed, scratch, peaks)
    order = sorted(
        ((int(v), float(x), float(y), float(angles[k])) for k in range(_N_ANGLES) for v, x, y in peaks[k] if v > 0),
        key=lambda one: (-one[0], one[3], one[1], one[2]),
    )
    found: list[tuple[Floats, int]] = []
    for votes, x, y, angle in order:
        frame = np.array([x, y, angle])
        if all(differ(frame, other, DISTINCT) for other, _ in found):
            found.append((frame, votes))
            if len(found) == most:
                break
    return found


def refined(a: Fragment, b: Fragment, frame: Floats, offset: float, *, with_clock: bool) -> FrameFit:
    """The frame (and the offset of the clocks) with the least squares of near pairs, by Gauss and Newton."""
    pairs = pairs_of(a, b, offset)
    for gate in GATES:
        later = 0.0  # [s] of the offset beyond that of the pairs
        for _ in range(3):
            left = (
                pairs.targets
                + later * pairs.target_speeds
                - transform(frame, pairs.sources + later * pairs.source_speeds)
            )
            near = np.einsum("ij,ij->i", left, left) <= gate * gate
            if np.count_nonzero(near) < 3:
                return _fit(pairs_of(a, b, offset + later) if later else pairs, frame, offset + later)
            step = _step(pairs, frame, left, near, with_clock=with_clock)
            frame = compose(frame, step[:3])
            frame[2] = wrap(frame[2])
            later += float(np.clip(step[3], -0.2, 0.2))
            if np.abs(step).max() < 1e-4:
                break
        if later:
            offset += later
            pairs = pairs_of(a, b, offset)
    return _fit(pairs, frame, offset)


def _step(pairs: Pairs, frame: Floats, left: Floats, near: NDArray[np.bool_], *, with_clock: bool) -> Floats:
    """The change (4,) of the frame, in itself, and of the offset."""
    c, s = math.cos(frame[2]), math.sin(frame[2])
    rotation = np.array([[c, -s], [s, c]])
    source = pairs.sources[near]
    own = left[near] @ rotation  # the residuals in the frame of B
    n = len(source)
    jacobian = np.zeros((2 * n, 4))
    jacobian[:n, 0] = jacobian[n:, 1] = 1.0
    jacobian[:n, 2], jacobian[n:, 2] = -source[:, 1], source[:, 0]
    speed = pairs.source_speeds[near] - pairs.target_speeds[near] @ rotation
    jacobian[:n, 3], jacobian[n:, 3] = speed[:, 0], speed[:, 1]
    if not with_clock:
        jacobian[:, 3] = 0.0
    information = jacobian.T @ jacobian
    information[np.diag_indices(4)] += 1e-9 * n
    found = np.linalg.solve(information, jacobian.T @ np.concatenate([own[:, 0], own[:, 1]]))
    return np.asarray(found if with_clock else found * (1.0, 1.0, 1.0, 0.0))


def _fit(pairs: Pairs, frame: Floats, offset: float) -> FrameFit:
    left = pairs.targets - transform(frame, pairs.sources)
    near = np.einsum("ij,ij->i", left, left) <= GATES[-1] ** 2
    votes = int(np.count_nonzero(near))
    if votes < 2:
        return FrameFit(frame, offset, votes, math.inf, 0.0, votes)
    source = pairs.sources[near]
    middle = source - source.mean(axis=0)
    axis = np.linalg.eigh(middle.T @ middle)[1][:, 1]
    along = middle @ axis
    cells = np.floor(np.column_stack([source, pairs.targets[near]]) / 0.1).astype(np.int64)
    return FrameFit(
        frame,
        offset,
        votes,
        math.sqrt(float(np.mean(np.sum(left[near] ** 2, axis=1)))),
        float(np.subtract(*np.percentile(along, (95.0, 5.0)))),
        len(np.unique(cells, axis=0)),
    )


def _speeds(fragment: Fragment, times: Floats) -> Floats:
    """Velocities (n, 2) of a robot at times within the fragment."""
    place = np.clip(((times - fragment.start) / STEP).astype(np.int64), 1, max(len(fragment.poses) - 2, 1))
    later, earlier = np.minimum(place + 1, len(fragment.poses) - 1), place - 1
    return np.asarray((fragment.poses[later, :2] - fragment.poses[earlier, :2]) / (STEP * (later - earlier))[:, None])


@jittable
def fill_peaks(
    sources: Floats,
    targets: Floats,
    angles: Floats,
    low: Floats,
    cell: float,
    suppressed: int,
    scratch: NDArray[np.int32],
    peaks: Floats,
) -> None:
    """Fill in the places with the most votes of each angle: peaks[angle, number] is (votes, x, y).

    Args:
        sources: (n, 2) points of B.
        targets: (n, 2) points of A.
        angles: (angles,) [rad] of B's frame.
        low: (2,) [m] the corner of the histogram.
        cell: [m] its cells.
        suppressed: Cells around a peak that have no other one.
        scratch: (3, rows, columns) votes, sums along x, and sums of 3 x 3 cells.
        peaks: (angles, peaks, 3) filled.
    """
    rows, columns = scratch.shape[1], scratch.shape[2]
    for k in range(len(angles)):
        c, s = math.cos(angles[k]), math.sin(angles[k])
        for i in range(rows):
            for j in range(columns):
                scratch[0, i, j] = 0
        for n in range(len(sources)):
            x = targets[n, 0] - (c * sources[n, 0] - s * sources[n, 1])
            y = targets[n, 1] - (s * sources[n, 0] + c * sources[n, 1])
            i, j = int((y - low[1]) / cell) + 1, int((x - low[0]) / cell) + 1
            if 0 < i < rows - 1 and 0 < j < columns - 1:
                scratch[0, i, j] += 1
        for i in range(rows):
            for j in range(1, columns - 1):
                scratch[1, i, j] = scratch[0, i, j - 1] + scratch[0, i, j] + scratch[0, i, j + 1]
        for i in range(1, rows - 1):
            for j in range(1, columns - 1):
                scratch[2, i, j] = scratch[1, i - 1, j] + scratch[1, i, j] + scratch[1, i + 1, j]
        for p in range(peaks.shape[1]):
            most, at_i, at_j = 0, 0, 0
            for i in range(1, rows - 1):
                for j in range(1, columns - 1):
                    if scratch[2, i, j] > most:
                        most, at_i, at_j = scratch[2, i, j], i, j
            peaks[k, p, 0] = float(most)
            peaks[k, p, 1] = low[0] + (at_j - 0.5) * cell
            peaks[k, p, 2] = low[1] + (at_i - 0.5) * cell
            if most == 0:
                break
            for i in range(max(1, at_i - suppressed), min(rows - 1, at_i + suppressed + 1)):
                for j in range(max(1, at_j - suppressed), min(columns - 1, at_j + suppressed + 1)):
                    scratch[2, i, j] = 0
