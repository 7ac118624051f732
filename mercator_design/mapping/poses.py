"""Poses (x, y, theta) [m, m, rad] in the plane, and motions between them.

The marked functions are kernels for single poses (rows or tuples of three numbers), which return tuples. The others
take arrays (..., 3), and broadcast. Headings are not wrapped, except where it is said.
"""

import math
from typing import TypeAlias

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.jit import jittable

Motion: TypeAlias = tuple[float, float, float]
"""A pose relative to another one."""


@jittable
def wrapped(angle: float) -> float:
    """An angle [rad] in -pi..pi."""
    return math.atan2(math.sin(angle), math.cos(angle))


@jittable
def product(a: Motion, b: Motion) -> Motion:
    """The pose that `b`, relative to `a`, has in the frame of `a`."""
    c, s = math.cos(a[2]), math.sin(a[2])
    return a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], a[2] + b[2]


@jittable
def relative(a: Motion, b: Motion) -> Motion:
    """The pose `b` relative to `a`; its heading is wrapped."""
    c, s = math.cos(a[2]), math.sin(a[2])
    x, y = b[0] - a[0], b[1] - a[1]
    return c * x + s * y, c * y - s * x, wrapped(b[2] - a[2])


def compose(a: Floats, b: Floats) -> Floats:
    """As `product`, for arrays (..., 3)."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + c * b[..., 0] - s * b[..., 1]
    y = a[..., 1] + s * b[..., 0] + c * b[..., 1]
    return np.stack([x, y, a[..., 2] + b[..., 2]], axis=-1)


def between(a: Floats, b: Floats) -> Floats:
    """As `relative`, for arrays (..., 3): `compose(inverse(a), b)`, with wrapped headings."""
    found = compose(inverse(a), b)
    found[..., 2] = wrap(found[..., 2])
    return found


def inverse(a: Floats) -> Floats:
    """The pose of the frame itself in the frame of `a`, for arrays (..., 3)."""
    a = np.asarray(a, float)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    return np.stack([-c * a[..., 0] - s * a[..., 1], s * a[..., 0] - c * a[..., 1], -a[..., 2]], axis=-1)


def wrap(angles: Floats) -> Floats:
    """Angles [rad] in -pi..pi."""
    return np.asarray(np.arctan2(np.sin(angles), np.cos(angles)))


def differ(a: Floats, b: Floats, limits: tuple[float, float]) -> bool:
    """Whether two poses (3,) are farther apart than limits [m], [rad], in one or the other."""
    far = math.hypot(a[0] - b[0], a[1] - b[1]) > limits[0]
    return far or abs(float(wrap(a[2] - b[2]))) > limits[1]


def transform(pose: Floats, points: Floats) -> Floats:
    """Points (n, 2) in the frame of a pose (3,), in the frame in which the pose is given."""
    return np.asarray(rotate(float(pose[2]), points) + np.asarray(pose, float)[:2])


def rotate(angle: float, vectors: Floats) -> Floats:
    """Vectors (n, 2), turned counter-clockwise by an angle [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    x, y = vectors[:, 0], vectors[:, 1]
    return np.column_stack([c * x - s * y, s * x + c * y])


def interpolate(times: Floats, poses: Floats, at: Floats) -> Floats:
    """Poses (n, 3) at times (n,), linear between poses (m, 3) at rising times (m,); the nearest one outside them.

    The headings of `poses` must be unwrapped.
    """
    return np.column_stack([np.interp(at, times, poses[:, k]) for k in range(3)])
