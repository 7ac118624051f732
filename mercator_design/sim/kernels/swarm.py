"""The changing part of an experiment, and its record."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Flags, Floats, Keys, Numbers
from mercator_design.modules.reference import ACTIONS, N_READINGS, ReferenceModel
from mercator_design.sim.kernels.lidar import GROUP
from mercator_design.sim.kernels.scene import Scene

_MEETINGS = 16
"""For each robot, on average; more than there is room for around robots that are as slow as real ones."""


class Swarm(NamedTuple):
    """The changing state: one row for each robot."""

    poses: Floats  # (robots, 5) x [m], y [m], heading [rad], its cosine and sine
    starts: Floats  # (robots, 5) the same at the start
    odometry: Floats  # (robots, 3) measured x, y [m] against the start, error of the yaw [rad]; only if they drift
    velocities: Floats  # (robots, 3) x, y [m/s], turn [rad/s]
    commands: Floats  # (robots, 2) speed of the left and right tread [m/s]
    targets: Floats  # (robots, 3) velocity that the drive aims at: x, y [m/s], turn [rad/s]
    close: Flags  # (robots,) whether a robot could touch something in this cycle
    held: Flags  # (robots,) whether it is in Chipmunk's space
    memory: Floats  # (robots, numbers) of the controllers
    actions: Floats  # (robots, ACTIONS) what they do in this cycle
    control_keys: Keys  # (robots,) streams of draws
    noise_keys: Keys
    # What robots remember of what they perceived; no rows if the reference model remembers nothing.
    heard: Floats  # (robots, robots, latest cycles, 3) of each other: 1 if perceived; where, ahead and to the left [m]
    votes: Floats  # (robots, ground_vote_cycles, 2) black and white ground readings of the latest cycles
    moved: Flags  # (robots,) whether it was moved out of a wall at the end of this cycle
    former: Floats  # (robots, 3) poses at the beginning of the cycle
    # Scratch of meetings.py.
    reach: Floats  # (robots,)
    meetings: Numbers  # (so many fit in, 3)
    order: Numbers  # (robots,)
    # Scratch for the senses of one robot.
    proximity: Floats  # (sensors,)
    readings: Floats  # (N_READINGS,)
    light: Floats  # (sensors,) of the ring of light sensors
    scan: Floats  # (beams,) of the lidar
    hits: Numbers  # (beams,) those that something is in range of
    covered: Flags  # (groups of beams,) false between scans
    distances: Floats  # (robots or more,) of neighbours; one that attracts several times is there several times
    bearings_x: Floats  # (the same,)
    bearings_y: Floats  # (the same,)
    ground: Floats  # (3,)
    levels: Floats  # (ground sensors,)
    draws: Floats  # (draws of a control cycle,)


class History(NamedTuple):
    """The record of an experiment; the last four have no rows unless everything is recorded."""

    poses: Floats  # (cycles + 1, robots, 3)
    states: NDArray[np.int8]  # (cycles, robots) active parts of the control software
    led_colours: NDArray[np.int8]  # (cycles, robots) that modules have set so far; -1: none
    signals: NDArray[np.int8]  # (cycles, robots) sent in each cycle; 0: none
    readings: Floats  # (cycles, robots, fields of Readings)
    draws: Floats  # (cycles, robots, draws)
    wheels: Floats  # (cycles, robots, 2) fractions of the maximum speed
    commands: Floats  # (cycles, robots, 2) what the treads then do [m/s], noise included


def new_swarm(scene: Scene, model: ReferenceModel, poses: Floats, *, control_keys: Keys, noise_keys: Keys) -> Swarm:
    """A swarm at rest at its poses (robots, 3), before its first cycle."""
    n, beams = len(poses), len(scene.lidar.beams_x)
    recalled = math.ceil(max(model.neighbour_memory, model.neighbour_count_memory))
    max_neighbours = max(n * (1 + recalled), beams)  # a cluster of beams need not be a robot
    directed = np.zeros((n, 5))
    directed[:, :3] = poses
    starts = directed.copy()
    starts[:, 3:] = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    return Swarm(
        poses=directed,
        starts=starts,
        odometry=np.zeros((n, 3)),
        velocities=np.zeros((n, 3)),
        commands=np.zeros((n, 2)),
        targets=np.zeros((n, 3)),
        close=np.zeros(n, dtype=np.bool_),
        held=np.zeros(n, dtype=np.bool_),
        memory=np.zeros((n, 0)),
        actions=np.zeros((n, ACTIONS)),
        control_keys=control_keys,
        noise_keys=noise_keys,
        heard=np.zeros((n, n, 1 + recalled, 3) if recalled else (0, 0, 1, 3)),
        votes=np.zeros((n, math.ceil(model.ground_vote_cycles), 2)),
        moved=np.zeros(n, dtype=np.bool_),
        former=np.zeros((n, 3)),
        reach=np.zeros(n),
        meetings=np.zeros((n + min(n * (n - 1) // 2, _MEETINGS * n), 3), dtype=np.int64),
        order=np.zeros(n, dtype=np.int64),
        proximity=np.zeros(len(scene.proximity.directions_x)),
        readings=np.zeros(N_READINGS),
        light=np.zeros(len(scene.light.directions_x)),
        scan=np.zeros(beams),
        hits=np.zeros(beams, dtype=np.int64),
        covered=np.zeros(math.ceil(beams / GROUP), dtype=np.bool_),
        distances=np.zeros(max_neighbours),
        bearings_x=np.zeros(max_neighbours),
        bearings_y=np.zeros(max_neighbours),
        ground=np.zeros(3),
        levels=np.zeros(len(scene.ground.places)),
        draws=np.zeros(0),
    )


def controlled(swarm: Swarm, *, memory: int, draws: int) -> Swarm:
    """A swarm with room for control software that keeps so many numbers, and makes so many draws in a cycle."""
    n = len(swarm.poses)
    actions = np.zeros((n, ACTIONS))
    actions[:, 2] = -1.0  # no LED colour is set
    return swarm._replace(memory=np.zeros((n, memory)), actions=actions, draws=np.zeros(draws))


def new_history(cycles: int, robots: int, *, everything: bool, draws: int = 0) -> History:
    """Arrays for the record of an experiment whose control software makes so many draws in a cycle."""
    rows = cycles if everything else 0
    return History(
        poses=np.empty((cycles + 1, robots, 3)),
        states=np.empty((cycles, robots), dtype=np.int8),
        led_colours=np.empty((cycles, robots), dtype=np.int8),
        signals=np.empty((cycles, robots), dtype=np.int8),
        readings=np.empty((rows, robots, N_READINGS)),
        draws=np.empty((rows, robots, draws)),
        wheels=np.empty((rows, robots, 2)),
        commands=np.empty((rows, robots, 2)),
    )
