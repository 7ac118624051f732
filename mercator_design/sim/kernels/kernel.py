"""One whole experiment: in every control cycle move, sense, control, record.

`experiment` is the compiled loop. The referee (referee.py) calls the same kernels one by one from Python, and steps
the space through pymunk's public functions; both produce the same scores, bit for bit.

A robot that can touch nothing moves by a formula (motion.py). Chipmunk's space holds the walls and the robots that
could touch something in the next steps (meetings.py), and is stepped only if there are such robots.

The order in a cycle is that of ARGoS: the wheels execute the command of the previous cycle, then the floor may change,
then each robot senses and decides. So a command moves the robot one cycle later, and nothing moves in the first cycle.
"""

import math

from mercator_design.jit import jittable
from mercator_design.missions.dynamics import change_floor
from mercator_design.modules.architecture import ControlProgram
from mercator_design.modules.reference import (
    ACTIVE,
    EVERYTHING,
    Readings,
    ReferenceModel,
    led_colour_of,
    senses_bits,
    signal_of,
)
from mercator_design.seeds import uniform
from mercator_design.sim.kernels.chipmunk import (
    Bridge,
    aim_at,
    build,
    enter,
    leave,
    read_state,
    step,
    take_down,
    write_state,
)
from mercator_design.sim.kernels.meetings import find_meetings, mark_close
from mercator_design.sim.kernels.motion import glide, withdraw
from mercator_design.sim.kernels.noise import NO_NOISE, WHEELS_DRAWS, noise
from mercator_design.sim.kernels.scene import Scene
from mercator_design.sim.kernels.sensing import drift, sense
from mercator_design.sim.kernels.swarm import History, Swarm
from mercator_design.software.architectures import control

FREE = -1
_NEUTRAL = tuple(Readings())
_PROXIMITY, _NEIGHBOURS, _GROUND = (senses_bits({sense}) for sense in ("proximity", "neighbours", "ground"))


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
def begin_motion(scene: Scene, swarm: Swarm) -> int:
    """The part of a cycle's motion before its steps: set targets, list the meetings.

    Returns:
        The number of meetings; or FREE if no robot can touch anything. Then all robots have moved.
    """
    aim(scene, swarm)
    n = len(swarm.poses)
    for i in range(n):
        for k in range(3):
            swarm.former[i, k] = swarm.poses[i, k]
    meetings = find_meetings(scene, swarm)
    is_free = meetings == 0
    for i in range(n):
        is_free = is_free and not swarm.close[i]
    if not is_free:
        return meetings
    for i in range(n):
        glide(scene, swarm, i, scene.sub_steps)
    return FREE


@jittable
def begin_step(scene: Scene, swarm: Swarm, meetings: int, step: int) -> None:
    """The part of a step before Chipmunk's: mark close robots, move the others."""
    mark_close(scene, swarm, meetings, step)
    for i in range(len(swarm.poses)):
        if not swarm.close[i]:
            glide(scene, swarm, i, 1)


@jittable
def end_motion(scene: Scene, swarm: Swarm) -> None:
    """The part after the steps: move robots in Chipmunk's space that overlap walls too far, and mark them."""
    for i in range(len(swarm.poses)):
        swarm.moved[i] = swarm.close[i] and withdraw(scene, swarm, i)


@jittable
def move(bridge: Bridge, scene: Scene, swarm: Swarm) -> None:
    """One control cycle of motion."""
    n = len(swarm.poses)
    meetings = begin_motion(scene, swarm)
    if meetings == FREE:
        _part(bridge, swarm)
        return
    for k in range(scene.sub_steps):
        begin_step(scene, swarm, meetings, k)
        if k == 0:
            _part(bridge, swarm)
        held = 0
        for i in range(n):
            if swarm.close[i]:
                is_new = not swarm.held[i]
                if is_new:
                    enter(bridge, i, swarm.poses, swarm.velocities)
                    swarm.held[i] = True
                if is_new or k == 0:
                    aim_at(bridge, i, swarm.targets)
                held += 1
        if held > 0:
            step(bridge, scene.time_step)
            for i in range(n):
                if swarm.held[i]:
                    read_state(bridge, i, swarm.poses, swarm.velocities)
    end_motion(scene, swarm)
    for i in range(n):
        if swarm.moved[i]:
            write_state(bridge, i, swarm.poses, swarm.velocities)


@jittable
def _part(bridge: Bridge, swarm: Swarm) -> None:
    """Take the robots out of the space that are not close to anything; they glide from their last state there."""
    for i in range(len(swarm.poses)):
        if swarm.held[i] and not swarm.close[i]:
            leave(bridge, i)
            swarm.held[i] = False


@jittable
def sense_and_control(
    scene: Scene, model: ReferenceModel, program: ControlProgram, swarm: Swarm, history: History, cycle: int
) -> None:
    """Change the floor; every robot senses what its state reads, decides and sets its wheels for the next cycle."""
    change_floor(scene.floor, history.poses[cycle + 1], (cycle + 1) * scene.control_period)
    records = len(history.readings) > 0
    read = 0
    for state in range(len(program.reads)):
        read |= _needed(model, program.reads[state])
    always = EVERYTHING if records else read & _remembered(model)
    n_draws = len(swarm.draws)
    may_fail = len(scene.stops) > 0
    for i in range(len(swarm.poses)):
        if scene.motion.drifts:
            before, after = history.poses[cycle], history.poses[cycle + 1]
            drift(scene, before, after, swarm.noise_keys[i], cycle, i, swarm.odometry)
        if may_fail and cycle >= scene.stops[i]:
            _rest(swarm, history, cycle, i)
            continue
        senses = _needed(model, program.reads[int(swarm.memory[i, ACTIVE])]) | always
        readings = sense(scene, model, swarm, cycle, i, senses)
        for k in range(n_draws):
            swarm.draws[k] = uniform(swarm.control_keys[i], cycle * n_draws + k)
        actions = swarm.actions[i]
        control(model, program, readings, swarm.memory[i], swarm.draws, actions)
        history.states[cycle, i] = int(swarm.memory[i, ACTIVE])
        history.led_colours[cycle, i] = led_colour_of(actions)
        history.signals[cycle, i] = signal_of(actions)
        for side in range(2):
            speed = actions[side] * scene.maximum_speed
            if scene.wheel_noise[0] != NO_NOISE:
                speed += speed * noise(scene.wheel_noise, swarm.noise_keys[i], WHEELS_DRAWS, 2 * cycle + side)
            swarm.commands[i, side] = speed
        if records:
            for k in range(len(readings)):
                history.readings[cycle, i, k] = readings[k]
            for k in range(n_draws):
                history.draws[cycle, i, k] = swarm.draws[k]
            for side in range(2):
                history.wheels[cycle, i, side] = actions[side]
                history.commands[cycle, i, side] = swarm.commands[i, side]


@jittable
def _rest(swarm: Swarm, history: History, cycle: int, i: int) -> None:
    """A cycle of robot i, which does not work any more: it perceives nothing, and all that it sets is off."""
    for side in range(2):
        swarm.commands[i, side] = 0.0
    history.states[cycle, i] = int(swarm.memory[i, ACTIVE])
    history.led_colours[cycle, i] = 0
    history.signals[cycle, i] = 0
    if len(history.readings) > 0:
        for k in range(len(_NEUTRAL)):
            history.readings[cycle, i, k] = _NEUTRAL[k]
        for k in range(len(swarm.draws)):
            history.draws[cycle, i, k] = 0.0
        for side in range(2):
            history.wheels[cycle, i, side] = 0.0
            history.commands[cycle, i, side] = 0.0


@jittable
def _needed(model: ReferenceModel, read: int) -> int:
    """The senses that a set of senses depends on: neighbours may count in the proximity vector."""
    if model.neighbour_obstacle_range > 0.0 and read & _PROXIMITY:
        return read | _NEIGHBOURS
    return read


@jittable
def _remembered(model: ReferenceModel) -> int:
    """The senses with a memory; they must sense in every cycle if any state reads them."""
    senses = 0
    if max(model.neighbour_memory, model.neighbour_count_memory) > 0.0:
        senses |= _NEIGHBOURS
    if model.ground_vote_cycles > 0.0:
        senses |= _GROUND
    return senses


@jittable
def experiment(
    bridge: Bridge, scene: Scene, model: ReferenceModel, program: ControlProgram, swarm: Swarm, history: History
) -> None:
    """Run a whole experiment from the poses that the swarm is in; its space is built, and then taken down.

    If a plugin's dynamic fails, the space is left to the caller.
    """
    build(bridge, scene.physics)
    note_poses(swarm, history, 0)
    for cycle in range(len(history.states)):
        move(bridge, scene, swarm)
        note_poses(swarm, history, cycle + 1)
        sense_and_control(scene, model, program, swarm, history, cycle)
    for i in range(len(swarm.poses)):
        if swarm.held[i]:
            leave(bridge, i)
            swarm.held[i] = False
    take_down(bridge)
