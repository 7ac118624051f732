"""Errors of estimated trajectories against true ones. Metres and radians."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Flags, Floats, Numbers
from mercator_design.mapping.poses import between, transform, wrap
from mercator_design.mapping.rigid import fit

_MAX_LISTED = 500_000
"""Pairs of rows that are looked at for near ones."""


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

    @property
    def translation_rmse(self) -> float:
        """[m] evo's rmse of its relation trans_part."""
        return math.hypot(self.translation, self.translation_sd)

    @property
    def rotation_rmse(self) -> float:
        """[rad] evo's rmse of its relation angle_rad."""
        return math.hypot(self.rotation, self.rotation_sd)


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


def pairs_along(places: Floats, metres: float) -> Numbers:
    """Pairs (m, 2) of rows of places (n, 2) between which so many metres of way lie, or just more, one after the other.

    These are evo's for a delta in metres, without `all_pairs`.
    """
    ends, way = [0], 0.0
    for row, step in enumerate(np.hypot(*np.diff(places, axis=0).T).tolist(), 1):
        way += step
        if way >= metres:
            ends.append(row)
            way = 0.0
    return np.column_stack([ends[:-1], ends[1:]]).astype(np.int64).reshape(-1, 2)


def near_pairs(
    true: Floats,
    generator: np.random.Generator,
    is_wanted: Callable[[Numbers, Numbers], Flags],
    *,
    nearer: float = 2.0,
    limit: int = 4000,
) -> Numbers:
    """Pairs (m, 2) of rows that are wanted and nearer than so many metres, at most `limit`; the first is the lower.

    Of few rows, the pairs are drawn of all such pairs; of many, of pairs that are drawn first.

    Args:
        true: (n, 3) or (n, 2)
        generator: Draws them.
        is_wanted: Tells of rows (k,) and later ones (k,) which pairs are wanted.
        nearer: [m]
        limit: Of the number of pairs.
    """
    n = len(true)
    if n * (n - 1) // 2 <= _MAX_LISTED:
        first, second = np.triu_indices(n, 1)
    else:
        drawn = generator.integers(n, size=(_MAX_LISTED, 2))
        first, second = np.unique(np.sort(drawn[drawn[:, 0] != drawn[:, 1]], axis=1), axis=0).T
    kept = (np.linalg.norm(true[first, :2] - true[second, :2], axis=1) < nearer) & is_wanted(first, second)
    pairs: Numbers = np.column_stack([first, second])[kept]
    if len(pairs) > limit:
        pairs = pairs[np.sort(generator.permutation(len(pairs))[:limit])]
    return pairs


def _rms(values: Floats) -> float:
    return math.sqrt(float(np.mean(np.square(values))))
