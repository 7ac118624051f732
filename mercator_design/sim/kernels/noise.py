"""Noise of sensors and treads, drawn from a robot's stream by device, cycle and value. Kernels.

A draw is a pure function of these. So a device may be computed at any time, or never, without effect on others.
"""

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.jit import jittable
from mercator_design.seeds import gaussian, uniform

NO_NOISE, GAUSSIAN, UNIFORM = 0.0, 1.0, 2.0
"""Kinds of noise: a row of noise is (kind, mean, standard deviation or half width)."""

(
    PROXIMITY_DRAWS,
    PROXIMITY_WEIGHT_DRAWS,
    GROUND_DRAWS,
    WHEELS_DRAWS,
    NEIGHBOURS_DRAWS,
    NEIGHBOURS_ANGLE_DRAWS,
    NEIGHBOURS_LOSS_DRAWS,
    LIGHT_DRAWS,
    LIGHT_ANGLE_DRAWS,
    LIDAR_DRAWS,
    AMBIENT_LIGHT_DRAWS,
    VELOCITY_DRAWS,
    ACCELEROMETER_DRAWS,
    GYROSCOPE_DRAWS,
    IMU_DRAWS,
    LOCATOR_DRAWS,
    QUATERNION_DRAWS,
    TURN_DRAWS,
    TURN_LOSS_DRAWS,
    TURN_PHASE_DRAWS,
    DRIFT_DRAWS,
    DRIFT_CONSTANTS_DRAWS,
    ODOMETRY_DRAWS,
    ODOMETRY_TIME_DRAWS,
) = range(24)
"""The streams of a robot: one for each purpose of draws."""

_DRAWS = 2  # draws for one value at most
_LANE = 1 << 44  # draws of one purpose in a robot's stream; more than an experiment uses


@jittable
def noise(row: Floats, key: np.uint64, stream: int, number: int) -> float:
    """A value of a stream's noise; its number counts through all cycles of an experiment, from 0."""
    if row[0] == GAUSSIAN:
        return float(row[1] + row[2] * gaussian(key, stream * _LANE + _DRAWS * number))
    if row[0] == UNIFORM:
        return float(row[1] + row[2] * (2.0 * uniform(key, stream * _LANE + _DRAWS * number) - 1.0))
    return 0.0


@jittable
def draw(key: np.uint64, stream: int, number: int) -> float:
    """A uniform draw in [0, 1)."""
    return uniform(key, stream * _LANE + _DRAWS * number)


@jittable
def standard(key: np.uint64, stream: int, number: int) -> float:
    """A normally distributed draw with mean 0 and standard deviation 1."""
    return float(gaussian(key, stream * _LANE + _DRAWS * number))
