"""Errors of estimated trajectories against true ones. Metres and radians."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Floats, Numbers
from mercator_design.mapping.poses import between, transform, wrap
from mercator_design.mapping.rigid import fit


class AbsoluteError(NamedTuple):
    """Absolute trajectory error after one rigid alignment (Sturm et al. 2012; no scale)."""

    rmse: float  # [m] of positions
    median: float  # [m]
    largest: float  # [m]
    yaw_rms: float  # [rad], turned by the same alignment
    alignment: Floats  # (3,) the pose of the estimate's frame in that of the truth
    of_robots: tuple[float, ...]  # [m] rmse of each robot after the common alignment; nan without poses


class RelativeError(NamedTuple):
    """Errors of relative poses."""

    translation: float  # [m] mean
    translation_sd: float
    translation_median: float
    rotation: float  # [rad] mean of absolute angles
    rotation_sd: float
    rotation_median: float
    pairs: int


def swarm_error(estimates: Sequence[Floats], truths: Sequence[Floats]) -> AbsoluteError:
    """The error of all robots' poses (n_i, 3) together, so that wrong frames between robots count.

    Raises:
        ValueError: if there are no poses, or a robot has other numbers of estimated and true ones.
    """
    for estimated, true in zip(estimates, truths, strict=True):
        if len(estimated) != len(true):
            raise ValueError(f"expected as many estimated as true poses, found {len(estimated)} and {len(true)}")
    estimated, true = np.concatenate(estimates), np.concatenate(truths)
    alignment = fit(estimated[:, :2], true[:, :2])
    distances = np.linalg.norm(transform(alignment, estimated[:, :2]) - true[:, :2], axis=1)
    yaw = wrap(estimated[:, 2] + alignment[2] - true[:, 2])
    ends = np.cumsum([len(one) for one in estimates])[:-1]
    return AbsoluteError(
        _rms(distances),
        float(np.median(distances)),
        float(distances.max()),
        _rms(yaw),
        alignment,
        tuple(_rms(part) if len(part) else math.nan for part in np.split(distances, ends)),
    )


def robot_error(estimated: Floats, true: Floats) -> AbsoluteError:
    """The error of one robot's poses (n, 3), aligned by itself; it hides wrong frames between robots."""
    return swarm_error([estimated], [true])


def relative_error(estimated: Floats, true: Floats, pairs: Numbers) -> RelativeError:
    """Errors of the poses of pairs (m, 2) of rows relative to each other; no alignment is needed.

    The error of a pair (i, j) is `inverse(between(true i, true j)) compose between(estimated i, estimated j)`, as evo
    and Kuemmerle et al. (2009) define it.

    Raises:
        ValueError: without pairs.
    """
    if len(pairs) == 0:
        raise ValueError("expected at least one pair of poses")
    i, j = pairs[:, 0], pairs[:, 1]
    found, expected = between(estimated[i], estimated[j]), between(true[i], true[j])
    # Rotations keep the length, so that of the translation in the true frame is the difference's.
    translation = np.linalg.norm(found[:, :2] - expected[:, :2], axis=1)
    rotation = np.abs(wrap(found[:, 2] - expected[:, 2]))
    return RelativeError(
        float(translation.mean()),
        float(translation.std()),
        float(np.median(translation)),
        float(rotation.mean()),
        float(rotation.std()),
        float(np.median(rotation)),
        len(pairs),
    )


def pairs_apart(n: int, rows: int = 1, *, overlapping: bool = True) -> Numbers:
    """Pairs (m, 2) of n rows that are some rows apart: evo's relative poses (`all_pairs` if they overlap)."""
    first = np.arange(0, n - rows, 1 if overlapping else rows)
    return np.column_stack([first, first + rows])


def pairs_after(times: Floats, seconds: float) -> Numbers:
    """Pairs (m, 2) of each row and the first one that is at least so many seconds later; times (n,) rise."""
    later = np.searchsorted(times, times + seconds - 1e-9)
    first = np.flatnonzero(later < len(times))
    return np.column_stack([first, later[first]])


def near_pairs(
    true: Floats, generator: np.random.Generator, *, nearer: float = 2.0, apart: int = 30, limit: int = 4000
) -> Numbers:
    """Pairs (m, 2) of rows at least `apart` from each other and nearer than so many metres; at most `limit`, drawn."""
    from scipy.spatial import KDTree

    pairs: Numbers = np.sort(KDTree(true[:, :2]).query_pairs(nearer, output_type="ndarray").astype(np.int64), axis=1)
    pairs = pairs[pairs[:, 1] - pairs[:, 0] >= apart]
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    if len(pairs) > limit:
        pairs = pairs[np.sort(generator.permutation(len(pairs))[:limit])]
    return pairs


def _rms(values: Floats) -> float:
    return math.sqrt(float(np.mean(np.square(values))))
