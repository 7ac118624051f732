"""One whole experiment: in every control cycle move, sense, control, record.

`experiment` is the compiled loop. It is made of kernels that the referee (simulate.py) also calls, one by one from
Python, stepping the space through pymunk's public functions; both give the same scores, bit for bit.

A robot that can touch nothing in a cycle moves by a formula (motion.py). Chipmunk's space holds the walls and the
robots that could touch something, and is stepped only where there are any.

The order in a cycle is that of ARGoS: the wheels carry out what was commanded in the cycle before, then each robot
senses and decides. So a command moves the robot one cycle later, and nothing moves in the first.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mercator_design.fsm.control import DRAWS, MEMORY, STATE, control_cycle
from mercator_design.fsm.perception import perceive
from mercator_design.fsm.pfsm import Program
from mercator_design.fsm.reference import Readings, ReferenceModel
from mercator_design.jit import jittable
from mercator_design.missions.floor_kernels import colour_at
from mercator_design.seeds import uniform
from mercator_design.sim.chipmunk import Bridge, aim_at, enter, leave, read_state, step, write_state
from mercator_design.sim.motion import glide, mark_close, withdraw
from mercator_design.sim.scene import Scene
from mercator_design.sim.sensors import NO_NOISE, NOISE_DRAWS, cast_at_box, cast_at_walls, noise

Floats = NDArray[np.float64]

_NO_LIGHT = (0.0, 0.0)
"""What a robot that does not perceive the direction of light reads."""

_NOISY_VALUES = 5
"""Of a robot in a cycle, beside its proximity sensors: three channels of the ground, two treads."""


@jittable
def _noise_counter(cycle: int, sensors: int, value: int) -> int:
    """Where in a robot's stream the draws for a noisy value begin: proximity sensors, then ground, then treads."""
    return NOISE_DRAWS * (cycle * (sensors + _NOISY_VALUES) + value)


class Swarm(NamedTuple):
    """What changes: one row a robot."""

    poses: Floats  # (robots, 5) x [m], y [m], heading [rad], its cosine and sine
    velocities: Floats  # (robots, 3) x, y [m/s], turn [rad/s]
    commands: Floats  # (robots, 2) speed of the left and right tread [m/s]
    targets: Floats  # (robots, 3) velocity that the drive aims at: x, y [m/s], turn [rad/s]
    close: NDArray[np.bool_]  # (robots,) whether a robot could touch something in this cycle
    held: NDArray[np.bool_]  # (robots,) whether it is in Chipmunk's space
    memory: Floats  # (robots, MEMORY) of the controllers
    control_keys: NDArray[np.uint64]  # (robots,) streams of draws
    noise_keys: NDArray[np.uint64]
    former: Floats  # (robots, 3) poses at the beginning of the cycle, of robots in Chipmunk's space
    reach: Floats  # (robots,) scratch of motion.mark_close
    # Scratch of one robot: what it senses.
    proximity: Floats  # (sensors,)
    distances: Floats  # (robots,) of neighbours
    bearings_x: Floats  # (robots,)
    bearings_y: Floats  # (robots,)
    ground: Floats  # (3,)
    draws: Floats  # (DRAWS,)


class History(NamedTuple):
    """What is recorded; the last three have no rows unless all is recorded."""

    poses: Floats  # (cycles + 1, robots, 3)
    states: NDArray[np.int8]  # (cycles, robots)
    readings: Floats  # (cycles, robots, fields of Readings)
    draws: Floats  # (cycles, robots, DRAWS)
    wheels: Floats  # (cycles, robots, 2) fractions of the maximum speed


def new_swarm(poses: Floats, control_keys: NDArray[np.uint64], noise_keys: NDArray[np.uint64], sensors: int) -> Swarm:
    """A swarm at rest at its poses (robots, 3), before its first cycle."""
    n = len(poses)
    return Swarm(
        poses=np.hstack([poses, np.zeros((n, 2))]),
        velocities=np.zeros((n, 3)),
        commands=np.zeros((n, 2)),
        targets=np.zeros((n, 3)),
        close=np.zeros(n, dtype=np.bool_),
        held=np.zeros(n, dtype=np.bool_),
        memory=np.zeros((n, MEMORY)),
        control_keys=control_keys,
        noise_keys=noise_keys,
        former=np.zeros((n, 3)),
        reach=np.zeros(n),
        proximity=np.zeros(sensors),
        distances=np.zeros(n),
        bearings_x=np.zeros(n),
        bearings_y=np.zeros(n),
        ground=np.zeros(3),
        draws=np.zeros(DRAWS),
    )


def new_history(cycles: int, robots: int, *, everything: bool) -> History:
    """Room for what an experiment records."""
    rows = cycles if everything else 0
    return History(
        poses=np.empty((cycles + 1, robots, 3)),
        states=np.empty((cycles, robots), dtype=np.int8),
        readings=np.empty((rows, robots, len(Readings._fields))),
        draws=np.empty((rows, robots, DRAWS)),
        wheels=np.empty((rows, robots, 2)),
    )


@jittable
def note_poses(swarm: Swarm, history: History, row: int) -> None:
    """Record the poses that the robots arrived at, and bring what is derived from them up to date."""
    for i in range(len(swarm.poses)):
        for k in range(3):
            history.poses[row, i, k] = swarm.poses[i, k]
        swarm.poses[i, 3] = math.cos(swarm.poses[i, 2])
        swarm.poses[i, 4] = math.sin(swarm.poses[i, 2])


@jittable
def aim(scene: Scene, swarm: Swarm) -> None:
    """Turn wheel commands to target velocities, which stay fixed in the world's frame for one control cycle."""
    for i in range(len(swarm.poses)):
        left, right = swarm.commands[i, 0], swarm.commands[i, 1]
        speed = 0.5 * (left + right)
        swarm.targets[i, 0] = speed * swarm.poses[i, 3]
        swarm.targets[i, 1] = speed * swarm.poses[i, 4]
        swarm.targets[i, 2] = (right - left) / scene.tread_distance


@jittable
def begin_motion(scene: Scene, swarm: Swarm) -> None:
    """What comes before Chipmunk's part of a cycle's motion: targets, who is close to something, who moves freely."""
    aim(scene, swarm)
    mark_close(scene, swarm.poses, swarm.velocities, swarm.targets, swarm.reach, swarm.close)
    for i in range(len(swarm.poses)):
        if swarm.close[i]:
            for k in range(3):
                swarm.former[i, k] = swarm.poses[i, k]
        else:
            glide(scene, swarm.poses, swarm.velocities, swarm.targets, i)


@jittable
def _move(bridge: Bridge, scene: Scene, swarm: Swarm) -> None:
    """One control cycle of motion."""
    # Robots leave with the state that they had at the end of the cycle before, and glide on from there.
    begin_motion(scene, swarm)
    n = len(swarm.poses)
    held = 0
    for i in range(n):
        if swarm.held[i] and not swarm.close[i]:
            leave(bridge, i)
            swarm.held[i] = False
    for i in range(n):
        if swarm.close[i]:
            if not swarm.held[i]:
                enter(bridge, i, swarm.poses, swarm.velocities)
                swarm.held[i] = True
            aim_at(bridge, i, swarm.targets)
            held += 1
    if held > 0:
        for _ in range(scene.sub_steps):
            step(bridge, scene.time_step)
        for i in range(n):
            if swarm.held[i]:
                read_state(bridge, i, swarm.poses, swarm.velocities)
                if withdraw(scene, swarm.poses, swarm.velocities, swarm.former, i):
                    write_state(bridge, i, swarm.poses, swarm.velocities)


@jittable
def sense(scene: Scene, model: ReferenceModel, swarm: Swarm, cycle: int, i: int) -> Readings:
    """What robot i perceives."""
    poses, seen, boxes = swarm.poses, swarm.proximity, scene.boxes
    x, y, c, s = poses[i, 0], poses[i, 1], poses[i, 3], poses[i, 4]
    for k in range(len(seen)):
        seen[k] = math.inf
    reach = scene.ring + model.proximity_range
    cast_at_walls(scene, x, y, c, s, reach, seen)
    for b in range(len(boxes)):
        cast_at_box(
            scene,
            boxes[b, 0],
            boxes[b, 1],
            boxes[b, 2],
            boxes[b, 3],
            boxes[b, 4],
            boxes[b, 5],
            x,
            y,
            c,
            s,
            seen,
        )
    meets = (reach + scene.corner) * (reach + scene.corner)
    in_range = model.neighbour_range * model.neighbour_range
    n = 0
    for j in range(len(poses)):
        to_x = poses[j, 0] - x
        to_y = poses[j, 1] - y
        squared = to_x * to_x + to_y * to_y
        if j == i or squared >= max(meets, in_range):
            continue
        if squared < meets:
            cast_at_box(
                scene,
                poses[j, 0],
                poses[j, 1],
                poses[j, 3],
                poses[j, 4],
                scene.half_length,
                scene.half_width,
                x,
                y,
                c,
                s,
                seen,
            )
        if 0.0 < squared < in_range:
            distance = math.sqrt(squared)
            swarm.distances[n] = distance
            swarm.bearings_x[n] = (c * to_x + s * to_y) / distance
            swarm.bearings_y[n] = (c * to_y - s * to_x) / distance
            n += 1
    ground_x = x + c * scene.ground_x - s * scene.ground_y
    ground_y = y + s * scene.ground_x + c * scene.ground_y
    red, green, blue = colour_at(scene.floor, ground_x, ground_y)
    swarm.ground[0] = red
    swarm.ground[1] = green
    swarm.ground[2] = blue
    _disturb(scene, model, swarm, cycle, i)
    return perceive(
        model,
        seen,
        scene.directions_x,
        scene.directions_y,
        swarm.distances,
        swarm.bearings_x,
        swarm.bearings_y,
        n,
        swarm.ground,
        _NO_LIGHT,
    )


@jittable
def _disturb(scene: Scene, model: ReferenceModel, swarm: Swarm, cycle: int, i: int) -> None:
    """Add noise to what robot i senses: proximity readings that hit something, and the ground's channels."""
    key = swarm.noise_keys[i]
    sensors = len(swarm.proximity)
    if scene.proximity_noise[0] != NO_NOISE:
        for k in range(sensors):
            if swarm.proximity[k] <= model.proximity_range:
                disturbed = swarm.proximity[k] + noise(scene.proximity_noise, key, _noise_counter(cycle, sensors, k))
                swarm.proximity[k] = max(0.0, disturbed)
    if scene.ground_noise[0] != NO_NOISE:
        for k in range(3):
            disturbed = swarm.ground[k] + noise(scene.ground_noise, key, _noise_counter(cycle, sensors, sensors + k))
            # A colour sensor delivers whole numbers from 0 to 255.
            swarm.ground[k] = max(0.0, min(255.0, float(math.floor(disturbed + 0.5))))


@jittable
def sense_and_control(
    scene: Scene, model: ReferenceModel, program: Program, swarm: Swarm, history: History, cycle: int
) -> None:
    """Every robot senses, decides and sets its wheels for the next cycle."""
    for i in range(len(swarm.poses)):
        readings = sense(scene, model, swarm, cycle, i)
        for k in range(DRAWS):
            swarm.draws[k] = uniform(swarm.control_keys[i], cycle * DRAWS + k)
        wheels = control_cycle(model, program, readings, swarm.memory[i], swarm.draws)
        history.states[cycle, i] = int(swarm.memory[i, STATE])
        sensors = len(swarm.proximity)
        for side in range(2):
            speed = wheels[side] * scene.maximum_speed
            if scene.wheel_noise[0] != NO_NOISE:
                speed += speed * noise(
                    scene.wheel_noise, swarm.noise_keys[i], _noise_counter(cycle, sensors, sensors + 3 + side)
                )
            swarm.commands[i, side] = speed
        if len(history.readings) > 0:
            for k in range(len(readings)):
                history.readings[cycle, i, k] = readings[k]
            for k in range(DRAWS):
                history.draws[cycle, i, k] = swarm.draws[k]
            for side in range(2):
                history.wheels[cycle, i, side] = wheels[side]


@jittable
def experiment(
    bridge: Bridge, scene: Scene, model: ReferenceModel, program: Program, swarm: Swarm, history: History
) -> None:
    """Run a whole experiment from the poses that the swarm is in."""
    note_poses(swarm, history, 0)
    for cycle in range(len(history.states)):
        _move(bridge, scene, swarm)
        note_poses(swarm, history, cycle + 1)
        sense_and_control(scene, model, program, swarm, history, cycle)
    for i in range(len(swarm.poses)):
        if swarm.held[i]:
            leave(bridge, i)  # pymunk finds its space as it left it
            swarm.held[i] = False
