"""Noise on what sensors measure and treads do: drawn from a robot's stream by device, cycle and value. Kernels.

A draw is a pure function of these, so that a device may be computed at any time, or never, and disturbs no other.
"""

import numpy as np
from numpy.typing import NDArray

from mercator_design.jit import jittable
from mercator_design.seeds import gaussian, uniform

Floats = NDArray[np.float64]

NO_NOISE, GAUSSIAN, UNIFORM = 0.0, 1.0, 2.0
"""Kinds of noise: a row of noise is (kind, mean, standard deviation or half width)."""

(
    PROXIMITY,
    PROXIMITY_WEIGHT,
    GROUND,
    WHEELS,
    NEIGHBOURS,
    NEIGHBOURS_ANGLE,
    NEIGHBOURS_LOSS,
    LIGHT,
    LIGHT_ANGLE,
    LIDAR,
    AMBIENT_LIGHT,
    VELOCITY,
    ACCELEROMETER,
    GYROSCOPE,
    IMU,
    LOCATOR,
    QUATERNION,
) = range(17)
"""Devices that draw."""

_DRAWS = 2  # that one value may use
_LANE = 1 << 44  # draws of a device in a robot's stream; more than an experiment has


@jittable
def noise(row: Floats, key: np.uint64, device: int, number: int) -> float:
    """Value number so and so of a device's noise, from 0 on through all cycles of an experiment."""
    if row[0] == GAUSSIAN:
        return float(row[1] + row[2] * gaussian(key, device * _LANE + _DRAWS * number))
    if row[0] == UNIFORM:
        return float(row[1] + row[2] * (2.0 * uniform(key, device * _LANE + _DRAWS * number) - 1.0))
    return 0.0


@jittable
def draw(key: np.uint64, device: int, number: int) -> float:
    """A uniform draw in [0, 1) of a device."""
    return uniform(key, device * _LANE + _DRAWS * number)
