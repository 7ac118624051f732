"""Rigid transforms of the plane that fit points to points."""

import math

import numpy as np

from mercator_design.arrays import Floats


def fit(source: Floats, target: Floats, weights: Floats | None = None) -> Floats:
    """The pose (3,) that moves points (n, 2) onto others with the least sum of squares (Umeyama 1991, no scale).

    With fewer than two different points the rotation is 0.

    Raises:
        ValueError: without points, or if no weight is above 0.
    """
    w = np.ones(len(source)) if weights is None else weights
    total = float(w.sum())
    if not total > 0.0:
        raise ValueError("expected at least one point with a weight above 0")
    a, b = (w @ source) / total, (w @ target) / total
    u, v = source - a, target - b
    turned = float(np.sum(w * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])))
    along = float(np.sum(w * (u[:, 0] * v[:, 0] + u[:, 1] * v[:, 1])))
    theta = math.atan2(turned, along)
    c, s = math.cos(theta), math.sin(theta)
    return np.array([b[0] - c * a[0] + s * a[1], b[1] - s * a[0] - c * a[1], theta])
