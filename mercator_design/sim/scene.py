"""The part of an experiment that never changes, as numbers for the kernels."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mercator_design.missions.floor import FloorTable

Floats = NDArray[np.float64]


class Scene(NamedTuple):
    """What never changes during an experiment: the arena, the floor of this instance, and the robot's body."""

    walls: Floats  # (walls, 6) start x, y; vector to the end x, y; unit normal x, y [m]
    boxes: Floats  # (boxes, 6) centre x, y; cosine and sine of the angle; half length, half width [m]
    floor: FloorTable
    half_length: float  # of a robot [m]
    half_width: float
    corner: float  # distance from the centre to a corner [m]
    tread_distance: float  # [m]
    maximum_speed: float  # of a tread [m/s]
    mass: float  # [kg]
    inertia: float  # [kg m2]
    force: float  # most that the drive exerts [N]
    torque: float  # [N m]
    ring: float  # radius of the ring of proximity sensors [m]
    directions_x: Floats  # (sensors,) unit vector of each, forwards ...
    directions_y: Floats  # ... and to the left
    ground_x: float  # the ground sensor in the robot's frame [m]
    ground_y: float
    proximity_noise: Floats  # (3,) rows of noise, see sensors.py
    ground_noise: Floats
    wheel_noise: Floats
    wall_overlap: float  # largest of a robot and a wall or box at the end of a cycle [m]; may be infinite
    sub_steps: int  # physics steps in a control cycle
    time_step: float  # [s] of physics
