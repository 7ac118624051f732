"""Which keyframes are compared with which."""

import numpy as np

from mercator_design.arrays import Floats, Numbers

_NEAR = 2.0
"""[m] Keyframes farther apart are not compared."""
_TRIES = 8
"""Draws for each pair that is wanted, before all near keyframes are looked up."""


def pairs_of_nodes(poses: Floats, parts: Numbers, wanted: int, generator: np.random.Generator) -> Numbers:
    """Pairs (m, 2) of each keyframe with at most so many others within 2 m, spread over all robots and times.

    Args:
        poses: (k, 3) in the order of parts and times.
        parts: (k,) the part of each.
        wanted: Pairs of each keyframe.
        generator: Draws them.
    """
    k = len(poses)
    if k < 2:
        return np.empty((0, 2), dtype=np.int64)
    draws = _TRIES * wanted
    # A draw from each of equal parts of the order, so that they spread over robots and times.
    share = (np.arange(draws) + generator.uniform(size=(k, draws))) / draws
    others = np.minimum((share * k).astype(np.int64), k - 1)
    near = np.hypot(*(poses[others, c] - poses[:, None, c] for c in (0, 1))) <= _NEAR
    near &= others != np.arange(k)[:, None]
    found = []
    few = np.flatnonzero(near.sum(axis=1) < wanted)
    looked_up = _near_nodes(poses, few)
    for i in range(k):
        candidates = looked_up[i] if i in looked_up else others[i, near[i]]
        if len(candidates) > wanted:
            start = generator.uniform(0.0, len(candidates) / wanted)
            candidates = candidates[(start + np.arange(wanted) * len(candidates) / wanted).astype(np.int64)]
        found.append(np.column_stack([np.full(len(candidates), i), candidates]))
    pairs = np.concatenate(found).astype(np.int64)
    before = (parts[pairs[:, 0]] == parts[pairs[:, 1]]) & (np.abs(pairs[:, 0] - pairs[:, 1]) == 1)
    return np.asarray(np.unique(pairs[~before], axis=0))


def _near_nodes(poses: Floats, nodes: Numbers) -> dict[int, Numbers]:
    from scipy.spatial import KDTree

    if len(nodes) == 0:
        return {}
    found = KDTree(poses[:, :2]).query_ball_point(poses[nodes, :2], _NEAR, return_sorted=True)
    return {
        int(i): np.array([other for other in near if other != i], dtype=np.int64)
        for i, near in zip(nodes, found, strict=True)
    }
