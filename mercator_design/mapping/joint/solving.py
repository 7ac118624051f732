"""Conjugate gradients with the inverse blocks of the diagonal as preconditioner.

Random pairs of keyframes make a direct factor dense; the matrix itself is never made.
"""

import numpy as np

from mercator_design.arrays import Floats, Numbers
from mercator_design.jit import compiled
from mercator_design.mapping.joint.kernels import apply_blocks, invert_blocks, multiply, set_up


def solve(
    poses: Floats,
    pairs: Numbers,
    information: Floats,
    gradients: Floats,
    *,
    tolerance: float = 1e-3,
    iterations: int = 300,
) -> Floats:
    """The small motions (k, 3) of keyframes in their own frames that solve the normal equations; the first one's is 0.

    Args:
        poses: (k, 3)
        pairs: (m, 2)
        information: (m, 3, 3) of the pairs.
        gradients: (m, 3)
        tolerance: Of the residual, relative to the right side, both measured by the preconditioner.
        iterations: At most.
    """
    k = len(poses)
    inverses, blocks, left = np.zeros((len(pairs), 3)), np.zeros((k, 3, 3)), np.zeros((k, 3))
    compiled(set_up)(poses, pairs, information, gradients, inverses, blocks, left)
    compiled(invert_blocks)(blocks)
    left[0] = 0.0
    found, product, prepared = np.zeros((k, 3)), np.zeros((k, 3)), np.zeros((k, 3))
    times, precondition = compiled(multiply), compiled(apply_blocks)
    precondition(blocks, left, prepared)
    direction = prepared.copy()
    size = begin = float(np.vdot(left, prepared))
    for _ in range(iterations):
        if size <= tolerance * tolerance * begin:
            break
        times(pairs, information, inverses, direction, product)
        product[0] = 0.0
        step = size / float(np.vdot(direction, product))
        found += step * direction
        left -= step * product
        precondition(blocks, left, prepared)
        size, before = float(np.vdot(left, prepared)), size
        direction *= size / before
        direction += prepared
    return found
