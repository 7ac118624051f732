"""The bridge to Chipmunk: how compiled code builds a space, steps it and takes it down again.

pymunk's cffi library exports Chipmunk's functions, whose addresses compiled code can call. Positions and velocities are
read and written in the memory of a body. Their offsets there are determined (not assumed) once in each process, by
`body_layout`.

A robot is a body with a shape, and a drive: a kinematic body that has the target velocity, and two joints that pull the
robot's velocity towards it with limited force and torque. ARGoS drives its robots in the same way
(dynamics2d_velocity_control.cpp). The joints are solved together with the contacts, so a robot that pushes against a
wall keeps its heading.

The referee (referee.py) builds the same space of pymunk's objects.
"""

import weakref
from functools import cache
from typing import NamedTuple

import numpy as np
import pymunk
from pymunk._chipmunk_cffi import ffi, lib

from mercator_design.arrays import Floats, Numbers
from mercator_design.errors import SimulationError
from mercator_design.jit import c_call, compiled, jittable, memory_access
from mercator_design.sim.kernels.scene import Physics

_new = c_call(result="pointer")
_new_body = c_call("double", "double", result="pointer")
_new_polygon = c_call("pointer", "int", "pointer", "double", result="pointer")
_new_box = c_call("pointer", "double", "double", "double", result="pointer")
_new_disc = c_call("pointer", "double", "double", "double", result="pointer")  # the last two are a vector
_new_pivot = c_call("pointer", "pointer", "double", "double", "double", "double", result="pointer")  # two vectors
_new_gear = c_call("pointer", "pointer", "double", "double", result="pointer")
_call_pointer = c_call("pointer")
_call_pointer_int = c_call("pointer", "int")
_call_pointer_double = c_call("pointer", "double")
_call_pointer_pointer = c_call("pointer", "pointer")
_load, _store = memory_access()

BODY, SHAPE, PIVOT, GEAR, GOAL = range(5)
"""Columns of `Bridge.robots`."""
SPACE, STATIC, OBSTACLES = range(3)
"""Items of `Bridge.arena`: a space, the body of its obstacles, and the first of their shapes."""

# The fields lie in the first part of Chipmunk's struct cpBody, behind two pointers, masses and the centre of gravity.
_SEARCHED = 144  # [bytes]


class BodyLayout(NamedTuple):
    """Offsets [bytes] of a Chipmunk body's state in its memory, as doubles."""

    position: int  # x, then y
    velocity: int  # x, then y
    angle: int
    turn: int  # angular velocity


class Functions(NamedTuple):
    """Addresses of Chipmunk's functions: `space_new` is that of cpSpaceNew, and so on."""

    space_new: int
    space_free: int
    space_set_iterations: int
    space_set_collision_slop: int
    space_step: int
    space_add_body: int
    space_add_shape: int
    space_add_constraint: int
    space_remove_body: int
    space_remove_shape: int
    space_remove_constraint: int
    body_new: int
    body_new_static: int
    body_new_kinematic: int
    body_free: int
    body_set_angle: int
    poly_shape_new_raw: int
    box_shape_new: int
    circle_shape_new: int
    shape_set_friction: int
    shape_set_elasticity: int
    shape_free: int
    pivot_joint_new2: int
    gear_joint_new: int
    constraint_set_max_force: int
    constraint_set_max_bias: int
    constraint_set_error_bias: int
    constraint_free: int


class Bridge(NamedTuple):
    """Addresses of Chipmunk's functions, of a space, and of what is in it."""

    call: Functions
    layout: BodyLayout
    arena: Numbers  # (2 + obstacles,) the space, the static body, and the shapes of the obstacles
    robots: Numbers  # (robots, 5): body, shape, pivot joint, gear joint, body with the target velocity


def new_bridge(physics: Physics, robots: int) -> Bridge:
    """A bridge to no space yet; `build` makes one, `take_down` frees it."""
    arena = np.zeros(OBSTACLES + len(physics.ends), dtype=np.int64)
    return Bridge(_functions(), body_layout(), arena, np.zeros((robots, 5), dtype=np.int64))


class Space:
    """A space of Chipmunk with obstacles, and robots that are not in it yet. It lives as long as this object.

    Args:
        physics: What it is built from.
        robots: Number of robots.
    """

    def __init__(self, physics: Physics, robots: int) -> None:
        self.bridge = new_bridge(physics, robots)
        compiled(build)(self.bridge, physics)
        weakref.finalize(self, compiled(take_down), self.bridge)


@cache
def _functions() -> Functions:
    names = [f"cp{field.title().replace('_', '')}" for field in Functions._fields]
    return Functions(*(int(ffi.cast("intptr_t", ffi.addressof(lib, name))) for name in names))


@cache
def body_layout() -> BodyLayout:
    """Determine the offsets of a body's state, by searching for a unique state in the memory of a body.

    Raises:
        SimulationError: if this version of pymunk does not keep it as doubles near the beginning of a body.
    """
    body = pymunk.Body(mass=2.0, moment=3.0)
    body.position = (1.25, -2.5)
    body.velocity = (0.375, -5.5)
    body.angle = 0.8125
    body.angular_velocity = -7.75
    memory = np.frombuffer(ffi.buffer(ffi.cast("char *", body._body), _SEARCHED), dtype=np.float64)  # noqa: SLF001
    values = memory.tolist()

    def offset(*pattern: float) -> int:
        places = [k for k in range(len(values)) if values[k : k + len(pattern)] == list(pattern)]
        if len(places) != 1:
            raise SimulationError(
                f"pymunk {pymunk.version} keeps the state of bodies in an unknown way; install "
                "the version that it was tested with: pip install 'pymunk==7.3.1'"
            )
        return places[0] * memory.itemsize

    return BodyLayout(offset(1.25, -2.5), offset(0.375, -5.5), offset(0.8125), offset(-7.75))


@jittable
def build(bridge: Bridge, physics: Physics) -> None:
    """Make a space with its obstacles, and the robots."""
    call, arena = bridge.call, bridge.arena
    space, static = _new(call.space_new, ()), _new(call.body_new_static, ())
    arena[SPACE], arena[STATIC] = space, static
    _call_pointer_int(call.space_set_iterations, (space, physics.iterations))
    _call_pointer_double(call.space_set_collision_slop, (space, physics.slop))
    _call_pointer_pointer(call.space_add_body, (space, static))
    first = 0
    for k in range(len(physics.ends)):
        n, address = physics.ends[k] - first, physics.corners[first].ctypes.data
        shape = _new_polygon(call.poly_shape_new_raw, (static, n, address, 0.0))
        _call_pointer_double(call.shape_set_friction, (shape, physics.obstacle_friction))
        _call_pointer_pointer(call.space_add_shape, (space, shape))
        arena[OBSTACLES + k] = shape
        first = physics.ends[k]
    for i in range(len(bridge.robots)):
        _build_robot(call, bridge.robots[i], physics)


@jittable
def _build_robot(call: Functions, robot: Numbers, physics: Physics) -> None:
    body, goal = _new_body(call.body_new, (physics.mass, physics.inertia)), _new(call.body_new_kinematic, ())
    if physics.radius > 0.0:
        shape = _new_disc(call.circle_shape_new, (body, physics.radius, 0.0, 0.0))
    else:
        shape = _new_box(call.box_shape_new, (body, physics.core_length, physics.core_width, physics.corner_radius))
    _call_pointer_double(call.shape_set_friction, (shape, physics.friction))
    _call_pointer_double(call.shape_set_elasticity, (shape, physics.elasticity))
    pivot = _new_pivot(call.pivot_joint_new2, (goal, body, 0.0, 0.0, 0.0, 0.0))
    gear = _new_gear(call.gear_joint_new, (goal, body, 0.0, 1.0))
    robot[BODY], robot[SHAPE], robot[PIVOT], robot[GEAR], robot[GOAL] = body, shape, pivot, gear, goal
    for column in (PIVOT, GEAR):
        limit = physics.force if column == PIVOT else physics.torque
        _call_pointer_double(call.constraint_set_max_bias, (robot[column], 0.0))  # velocities are to agree, not places
        _call_pointer_double(call.constraint_set_error_bias, (robot[column], 0.0))
        _call_pointer_double(call.constraint_set_max_force, (robot[column], limit))


@jittable
def take_down(bridge: Bridge) -> None:
    """Free all that `build` has made; the bridge is then to no space."""
    call, arena, robots = bridge.call, bridge.arena, bridge.robots
    _call_pointer(call.space_free, (arena[SPACE],))
    for i in range(len(robots)):
        _call_pointer(call.constraint_free, (robots[i, PIVOT],))
        _call_pointer(call.constraint_free, (robots[i, GEAR],))
        _call_pointer(call.shape_free, (robots[i, SHAPE],))
        _call_pointer(call.body_free, (robots[i, BODY],))
        _call_pointer(call.body_free, (robots[i, GOAL],))
    for k in range(OBSTACLES, len(arena)):
        _call_pointer(call.shape_free, (arena[k],))
    _call_pointer(call.body_free, (arena[STATIC],))
    arena[SPACE] = 0


@jittable
def read_state(bridge: Bridge, i: int, poses: Floats, velocities: Floats) -> None:
    """Copy the state of robot i to its row of poses (x, y, heading, ...) and velocities (x, y, turn)."""
    body = bridge.robots[i, BODY]
    poses[i, 0] = _load(body + bridge.layout.position)
    poses[i, 1] = _load(body + bridge.layout.position + 8)
    poses[i, 2] = _load(body + bridge.layout.angle)
    velocities[i, 0] = _load(body + bridge.layout.velocity)
    velocities[i, 1] = _load(body + bridge.layout.velocity + 8)
    velocities[i, 2] = _load(body + bridge.layout.turn)


@jittable
def write_state(bridge: Bridge, i: int, poses: Floats, velocities: Floats) -> None:
    """Give robot i the state of its row of poses and velocities."""
    body = bridge.robots[i, BODY]
    _store(body + bridge.layout.position, poses[i, 0])
    _store(body + bridge.layout.position + 8, poses[i, 1])
    _call_pointer_double(bridge.call.body_set_angle, (body, poses[i, 2]))  # also updates what Chipmunk derives
    _store(body + bridge.layout.velocity, velocities[i, 0])
    _store(body + bridge.layout.velocity + 8, velocities[i, 1])
    _store(body + bridge.layout.turn, velocities[i, 2])


@jittable
def enter(bridge: Bridge, i: int, poses: Floats, velocities: Floats) -> None:
    """Put robot i into the space, in the state of its row of poses and velocities."""
    write_state(bridge, i, poses, velocities)
    _call_pointer_pointer(bridge.call.space_add_body, (bridge.arena[SPACE], bridge.robots[i, BODY]))
    _call_pointer_pointer(bridge.call.space_add_shape, (bridge.arena[SPACE], bridge.robots[i, SHAPE]))
    _call_pointer_pointer(bridge.call.space_add_constraint, (bridge.arena[SPACE], bridge.robots[i, PIVOT]))
    _call_pointer_pointer(bridge.call.space_add_constraint, (bridge.arena[SPACE], bridge.robots[i, GEAR]))


@jittable
def leave(bridge: Bridge, i: int) -> None:
    """Take robot i out of the space."""
    _call_pointer_pointer(bridge.call.space_remove_constraint, (bridge.arena[SPACE], bridge.robots[i, PIVOT]))
    _call_pointer_pointer(bridge.call.space_remove_constraint, (bridge.arena[SPACE], bridge.robots[i, GEAR]))
    _call_pointer_pointer(bridge.call.space_remove_shape, (bridge.arena[SPACE], bridge.robots[i, SHAPE]))
    _call_pointer_pointer(bridge.call.space_remove_body, (bridge.arena[SPACE], bridge.robots[i, BODY]))


@jittable
def aim_at(bridge: Bridge, i: int, targets: Floats) -> None:
    """Set the target velocity of the drive of robot i to its row of targets (x, y, turn)."""
    goal = bridge.robots[i, GOAL]
    _store(goal + bridge.layout.velocity, targets[i, 0])
    _store(goal + bridge.layout.velocity + 8, targets[i, 1])
    _store(goal + bridge.layout.turn, targets[i, 2])


@jittable
def step(bridge: Bridge, time_step: float) -> None:
    """Advance the space by a time [s]: positions first, then velocities, joints and contacts."""
    _call_pointer_double(bridge.call.space_step, (bridge.arena[SPACE], time_step))
