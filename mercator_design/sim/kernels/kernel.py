"""One whole experiment: in every control cycle move, sense, control, record.

`experiment` is the compiled loop. The referee (simulate.py) calls the same kernels one by one from Python, and steps
the space through pymunk's public functions; both produce the same scores, bit for bit.

A robot that can touch nothing in a cycle moves by a formula (motion.py). Chipmunk's space holds the walls and the
robots that could touch something, and is stepped only if there are such robots.

The order in a cycle is that of ARGoS: the wheels execute the command of the previous cycle, then the floor may change,
then each robot senses and decides. So a command moves the robot one cycle later, and nothing moves in the first cycle.
"""

import math

from mercator_design.fsm.control import DRAWS, STATE, control_cycle
from mercator_design.fsm.modules import GROUND, LIGHT, NEIGHBOURS, PROXIMITY
from mercator_design.fsm.pfsm import Program
from mercator_design.fsm.reference import ReferenceModel
from mercator_design.jit import jittable
from mercator_design.missions.dynamics import change_floor
from mercator_design.seeds import uniform
from mercator_design.sim.kernels.chipmunk import Bridge, aim_at, enter, leave, read_state, step, write_state
from mercator_design.sim.kernels.motion import glide, mark_close, withdraw
from mercator_design.sim.kernels.noise import NO_NOISE, WHEELS_DRAWS, noise
from mercator_design.sim.kernels.scene import Scene
from mercator_design.sim.kernels.sensing import sense
from mercator_design.sim.kernels.swarm import History, Swarm

EVERYTHING = PROXIMITY | NEIGHBOURS | GROUND | LIGHT
"""All senses; a sense that the robot lacks has neutral readings."""


@jittable
def note_poses(swarm: Swarm, history: History, row: int) -> None:
    """Record the poses of the robots, and update the cosines and sines of their headings."""
    for i in range(len(swarm.poses)):
        for k in range(3):
            history.poses[row, i, k] = swarm.poses[i, k]
        swarm.poses[i, 3] = math.cos(swarm.poses[i, 2])
        swarm.poses[i, 4] = math.sin(swarm.poses[i, 2])


@jittable
def aim(scene: Scene, swarm: Swarm) -> None:
    """Convert wheel commands to target velocities, which are constant in the world's frame for one control cycle."""
    for i in range(len(swarm.poses)):
        left, right = swarm.commands[i, 0], swarm.commands[i, 1]
        speed = 0.5 * (left + right)
        swarm.targets[i, 0] = speed * swarm.poses[i, 3]
        swarm.targets[i, 1] = speed * swarm.poses[i, 4]
        swarm.targets[i, 2] = (right - left) / scene.tread_distance


@jittable
def begin_motion(scene: Scene, swarm: Swarm) -> None:
    """The part of a cycle's motion before Chipmunk's: set targets, mark close robots, move the free ones."""
    aim(scene, swarm)
    mark_close(scene, swarm)
    for i in range(len(swarm.poses)):
        if swarm.close[i]:
            for k in range(3):
                swarm.former[i, k] = swarm.poses[i, k]
        else:
            glide(scene, swarm, i)


@jittable
def end_motion(scene: Scene, swarm: Swarm) -> None:
    """The part after Chipmunk's: move robots in its space that overlap walls too far, and mark them."""
    for i in range(len(swarm.poses)):
        swarm.moved[i] = swarm.close[i] and withdraw(scene, swarm, i)


@jittable
def move(bridge: Bridge, scene: Scene, swarm: Swarm) -> None:
    """One control cycle of motion."""
    # Robots leave with their state at the end of the previous cycle, and glide from there.
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
        end_motion(scene, swarm)
        for i in range(n):
            if swarm.moved[i]:
                write_state(bridge, i, swarm.poses, swarm.velocities)


@jittable
def sense_and_control(
    scene: Scene, model: ReferenceModel, program: Program, swarm: Swarm, history: History, cycle: int
) -> None:
    """Change the floor; every robot senses what its state reads, decides and sets its wheels for the next cycle."""
    change_floor(scene.floor, history.poses[cycle + 1], (cycle + 1) * scene.control_period)
    records = len(history.readings) > 0
    read = 0
    for state in range(len(program.reads)):
        read |= _needed(model, program.reads[state])
    always = EVERYTHING if records else read & _remembered(model)
    for i in range(len(swarm.poses)):
        senses = _needed(model, program.reads[int(swarm.memory[i, STATE])]) | always
        readings = sense(scene, model, swarm, cycle, i, senses)
        for k in range(DRAWS):
            swarm.draws[k] = uniform(swarm.control_keys[i], cycle * DRAWS + k)
        wheels = control_cycle(model, program, readings, swarm.memory[i], swarm.draws)
        history.states[cycle, i] = int(swarm.memory[i, STATE])
        for side in range(2):
            speed = wheels[side] * scene.maximum_speed
            if scene.wheel_noise[0] != NO_NOISE:
                speed += speed * noise(scene.wheel_noise, swarm.noise_keys[i], WHEELS_DRAWS, 2 * cycle + side)
            swarm.commands[i, side] = speed
        if records:
            for k in range(len(readings)):
                history.readings[cycle, i, k] = readings[k]
            for k in range(DRAWS):
                history.draws[cycle, i, k] = swarm.draws[k]
            for side in range(2):
                history.wheels[cycle, i, side] = wheels[side]
                history.commands[cycle, i, side] = swarm.commands[i, side]


@jittable
def _needed(model: ReferenceModel, read: int) -> int:
    """The senses that a set of senses depends on: neighbours may count in the proximity vector."""
    if model.neighbour_obstacle_range > 0.0 and read & PROXIMITY:
        return read | NEIGHBOURS
    return read


@jittable
def _remembered(model: ReferenceModel) -> int:
    """The senses with a memory; they must sense in every cycle if any state reads them."""
    senses = 0
    if max(model.neighbour_memory, model.neighbour_count_memory) > 0.0:
        senses |= NEIGHBOURS
    if model.ground_vote_cycles > 0.0:
        senses |= GROUND
    return senses


@jittable
def experiment(
    bridge: Bridge, scene: Scene, model: ReferenceModel, program: Program, swarm: Swarm, history: History
) -> None:
    """Run a whole experiment from the poses that the swarm is in."""
    note_poses(swarm, history, 0)
    for cycle in range(len(history.states)):
        move(bridge, scene, swarm)
        note_poses(swarm, history, cycle + 1)
        sense_and_control(scene, model, program, swarm, history, cycle)
    for i in range(len(swarm.poses)):
        if swarm.held[i]:
            leave(bridge, i)  # so the space is as pymunk knows it
            swarm.held[i] = False
