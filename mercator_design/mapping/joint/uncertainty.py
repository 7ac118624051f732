"""How uncertain the poses of a component are: samples of them, by the normal equations of the joint refinement.

The inverse of the matrix is never made. Instead, each factor's gradient is drawn with the factor's information as its
covariance; the solution of the equations with these gradients is a draw from the inverse of the matrix. So a sample
costs as much as a step of the refinement.

The points of a pair share errors, and de-skewing errs alike in neighbouring turns, so the information of the factors is
ours rather than that of the lidar's noise. How well the deviations fit the errors of simulated maps is in
docs/explanation/mapping.md.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Floats, Numbers
from mercator_design.mapping.joint.solving import solve
from mercator_design.mapping.poses import compose, wrap
from mercator_design.mapping.rigid import fit

SAMPLES = 32
"""Their deviations are known to 1 in 8 (one standard deviation)."""

_HEADINGS_ALIKE = 3.0  # of a frame's deviation of heading: errors of its keyframes are alike; measured in simulation
_STANDS = 0.05  # [m] root mean square of the distances from the middle, below which a place has no direction


class Uncertainty(NamedTuple):
    """Covariances [m, m, rad] of poses in the axes of the map."""

    keyframes: list[Floats]  # of each part: (k, 3, 3), after the best alignment of the whole map
    frames: Floats  # (parts, 3, 3) of the middle of each part's way, and of its heading, in the frame of the first part


def sampled(poses: Floats, pairs: Numbers, information: Floats, count: int, generator: np.random.Generator) -> Floats:
    """Draws (count, k, 3) of small motions of keyframes in their own frames; those of the first one are 0.

    Args:
        poses: (k, 3)
        pairs: (m, 2)
        information: (m, 3, 3) of the pairs.
        count: How many.
        generator: Draws them.
    """
    values, vectors = np.linalg.eigh(information)
    roots = vectors * np.sqrt(np.maximum(values, 0.0))[:, np.newaxis, :]
    found = np.zeros((count, len(poses), 3))
    for one in found if len(pairs) else ():
        gradients = np.einsum("mab,mb->ma", roots, generator.standard_normal((len(pairs), 3)))
        one[:] = solve(poses, pairs, information, gradients)
    return found


def uncertainty_of(parts: Sequence[Floats], motions: Floats) -> Uncertainty:
    """The covariances that samples show.

    Args:
        parts: Of each part: (k, 3) the poses of its keyframes.
        motions: (samples, sum of k, 3) of them, as of `sampled`.
    """
    poses = np.concatenate(parts) if parts else np.zeros((0, 3))
    ends = np.cumsum([len(part) for part in parts])[:-1]
    own: list[Floats] = []
    of_frames = np.zeros((len(motions), len(parts), 3))
    for number, motion in enumerate(motions if len(poses) else ()):
        moved = compose(poses, motion)
        own.append(_apart(_aligned(moved, poses), poses))
        first = next(k for k, part in enumerate(parts) if len(part))
        chosen = np.repeat(np.arange(len(parts)), [len(part) for part in parts]) == first
        by_first = np.split(_apart(_aligned(moved, poses, chosen), poses), ends)
        of_frames[number] = [part.mean(axis=0) if len(part) else np.zeros(3) for part in by_first]
    count = max(len(motions), 1)
    spread = np.array(own).reshape(len(own), len(poses), 3)
    covariances = np.einsum("ska,skb->kab", spread, spread) / count
    of_frames[..., 2] *= _HEADINGS_ALIKE
    return Uncertainty(np.split(covariances, ends), np.einsum("spa,spb->pab", of_frames, of_frames) / count)


def _aligned(moved: Floats, poses: Floats, chosen: slice | np.ndarray = slice(None)) -> Floats:
    """Poses (k, 3), moved together so that chosen ones are as near as possible to others (k, 3)."""
    source, target = moved[chosen], poses[chosen]
    motion = fit(source[:, :2], target[:, :2])
    if np.sqrt(np.mean(np.var(target[:, :2], axis=0))) < _STANDS:
        turned = float(np.mean(wrap(target[:, 2] - source[:, 2])))
        middle = compose(np.array([0.0, 0.0, turned]), np.array([*source[:, :2].mean(axis=0), 0.0]))
        motion = np.array([*(target[:, :2].mean(axis=0) - middle[:2]), turned])
    return compose(motion, moved)


def _apart(one: Floats, other: Floats) -> Floats:
    """Differences (k, 3) of poses, with wrapped headings."""
    found = one - other
    found[:, 2] = wrap(found[:, 2])
    return found
