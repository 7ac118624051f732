"""Measurements of lidar and odometry at their own times: turns, each beam at its time, and poses between cycles.

Control software senses once in a cycle (devices.py). The lidar of a robot turns on without regard to cycles or to the
other robots, and its beams leave one after the other; so a robot that turns sees a skewed room.
"""

from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.errors import SimulationError
from mercator_design.jit import compiled
from mercator_design.sim.devices import Recording, check_size, measured_poses
from mercator_design.sim.kernels.measuring import fill_samples, fill_turns

ODOMETRY_PERIOD = 0.05
"""[s] from one sample of odometry to the next."""

_TIME_ERROR = 0.005
"""[s] by which the stamp of a sample of odometry is off at most; ours."""


class LidarTurns(NamedTuple):
    """Turns of the lidars of a swarm."""

    starts: Floats  # (turns, robots) time of the first beam [s]
    times: Floats  # (beams,) of each beam after the first [s]
    angles: Floats  # (beams,) [rad] in the frame of the lidar; the X4 turns clockwise, so they fall
    ranges: Floats  # (turns, robots, beams) [m]; 0: nothing came back


class Odometry(NamedTuple):
    """The poses that the robots measure."""

    times: Floats  # (samples, robots) [s]
    poses: Floats  # (samples, robots, 3) x, y [m], heading [rad, not limited to one turn] against those at the start


def number_of_turns(recording: Recording, cycles: int) -> int:
    """The number of complete turns in an experiment of so many cycles."""
    return max(0, int(cycles * recording.control_period / recording.scene.lidar.turn) - 1)


def turns_of(recording: Recording) -> LidarTurns:
    """The complete turns of an experiment; a lidar turns before it begins.

    Raises:
        SimulationError: if the robot has no lidar, or the result would be larger than devices.MAX_SIZE.
    """
    _check_device(recording, "lidar")
    lidar, keys = recording.scene.lidar, recording.noise_keys
    turns, beams = number_of_turns(recording, len(recording.history.states)), len(lidar.beams_x)
    check_size("turns", turns * len(keys) * beams)
    starts, found = np.zeros((turns, len(keys))), np.zeros((turns, len(keys), beams))
    poses, scratch = np.ascontiguousarray(recording.history.poses), np.zeros((len(keys), 3))
    with np.errstate(over="ignore"):  # as in devices.py
        compiled(fill_turns)(recording.scene, poses, keys, scratch, starts, found)
    parts = np.arange(beams) / beams
    return LidarTurns(starts, lidar.turn * parts, -2.0 * np.pi * parts, found)


def odometry_of(recording: Recording, period: float = ODOMETRY_PERIOD) -> Odometry:
    """Samples of the place by the locator and of the yaw by the imu, with their noise and drift.

    Between the ends of two cycles poses are linear. A stamp is off by up to 5 ms, as those of a robot's program may be.

    Raises:
        SimulationError: if the robot has no locator or no imu.
    """
    _check_device(recording, "locator")
    _check_device(recording, "imu")
    cycles, robots = recording.history.states.shape
    samples = int(cycles * recording.control_period / period + 1e-9) + 1
    times, found, scratch = np.zeros((samples, robots)), np.zeros((samples, robots, 3)), np.zeros((robots, 3))
    measured, keys = measured_poses(recording), recording.noise_keys
    with np.errstate(over="ignore"):
        compiled(fill_samples)(recording.scene, measured, keys, period, _TIME_ERROR, scratch, times, found)
    return Odometry(times, found)


def _check_device(recording: Recording, part: str) -> None:
    if getattr(recording.robot_model, part) is None:
        raise SimulationError(f"robot {recording.robot_model.name} has no {part}")
