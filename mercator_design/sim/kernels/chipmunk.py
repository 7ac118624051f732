"""The bridge to Chipmunk: how compiled code steps a space that pymunk built and owns.

pymunk's cffi library exports Chipmunk's functions, whose addresses compiled code can call. All arguments are pointers
and doubles: passing vectors by value differs between systems, so positions and velocities are read and written in the
memory of a body. Their offsets there are determined (not assumed) once in each process, by `body_layout`.

A robot is a body with a shape, and a drive: a kinematic body that has the target velocity, and two joints that pull the
robot's velocity towards it with limited force and torque. ARGoS drives its robots in the same way
(dynamics2d_velocity_control.cpp). The joints are solved together with the contacts, so a robot that pushes against a
wall keeps its heading.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pymunk
from pymunk._chipmunk_cffi import ffi, lib

from mercator_design.arrays import Floats, Numbers
from mercator_design.errors import SimulationError
from mercator_design.jit import c_call, jittable, memory_access

_call_pointer_double = c_call("pointer", "double")
_call_pointer_pointer = c_call("pointer", "pointer")
_load, _store = memory_access()

BODY, SHAPE, PIVOT, GEAR, GOAL = range(5)
"""Columns of `Bridge.robots`."""

# The fields lie in the first part of Chipmunk's struct cpBody, behind two pointers, masses and the centre of gravity.
_SEARCHED = 144  # [bytes]


class BodyLayout(NamedTuple):
    """Offsets [bytes] of a Chipmunk body's state in its memory, as doubles."""

    position: int  # x, then y
    velocity: int  # x, then y
    angle: int
    turn: int  # angular velocity


class Bridge(NamedTuple):
    """Addresses of Chipmunk's functions, of a space, and of its robots."""

    step: int
    set_angle: int
    add_body: int
    add_shape: int
    add_constraint: int
    remove_body: int
    remove_shape: int
    remove_constraint: int
    space: int
    robots: Numbers  # (robots, 5): body, shape, pivot joint, gear joint, body with the target velocity
    layout: BodyLayout


@dataclass(frozen=True, slots=True)
class ChipmunkRobot:
    """A robot as pymunk objects."""

    body: pymunk.Body
    shape: pymunk.Shape
    pivot: pymunk.PivotJoint
    gear: pymunk.GearJoint
    goal: pymunk.Body  # kinematic: has the target velocity of the drive; in no space


def new_bridge(space: pymunk.Space, robots: list[ChipmunkRobot]) -> Bridge:
    """The bridge to a space; valid as long as the space and the robots live."""

    def function(name: str) -> int:
        return _address(ffi.addressof(lib, name))

    # pymunk has no public names for the C objects.
    pointers = [
        [r.body._body, r.shape._shape, r.pivot._constraint, r.gear._constraint, r.goal._body]  # noqa: SLF001
        for r in robots
    ]
    return Bridge(
        step=function("cpSpaceStep"),
        set_angle=function("cpBodySetAngle"),
        add_body=function("cpSpaceAddBody"),
        add_shape=function("cpSpaceAddShape"),
        add_constraint=function("cpSpaceAddConstraint"),
        remove_body=function("cpSpaceRemoveBody"),
        remove_shape=function("cpSpaceRemoveShape"),
        remove_constraint=function("cpSpaceRemoveConstraint"),
        space=_address(space._space),  # noqa: SLF001
        robots=np.array([[_address(pointer) for pointer in row] for row in pointers], dtype=np.int64),
        layout=body_layout(),
    )


def _address(pointer: Any) -> int:  # noqa: ANN401 - cffi's pointers have no types
    return int(ffi.cast("intptr_t", pointer))


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
    _call_pointer_double(bridge.set_angle, (body, poses[i, 2]))  # also updates what Chipmunk derives
    _store(body + bridge.layout.velocity, velocities[i, 0])
    _store(body + bridge.layout.velocity + 8, velocities[i, 1])
    _store(body + bridge.layout.turn, velocities[i, 2])


@jittable
def enter(bridge: Bridge, i: int, poses: Floats, velocities: Floats) -> None:
    """Put robot i into the space, in the state of its row of poses and velocities."""
    write_state(bridge, i, poses, velocities)
    _call_pointer_pointer(bridge.add_body, (bridge.space, bridge.robots[i, BODY]))
    _call_pointer_pointer(bridge.add_shape, (bridge.space, bridge.robots[i, SHAPE]))
    _call_pointer_pointer(bridge.add_constraint, (bridge.space, bridge.robots[i, PIVOT]))
    _call_pointer_pointer(bridge.add_constraint, (bridge.space, bridge.robots[i, GEAR]))


@jittable
def leave(bridge: Bridge, i: int) -> None:
    """Take robot i out of the space."""
    _call_pointer_pointer(bridge.remove_constraint, (bridge.space, bridge.robots[i, PIVOT]))
    _call_pointer_pointer(bridge.remove_constraint, (bridge.space, bridge.robots[i, GEAR]))
    _call_pointer_pointer(bridge.remove_shape, (bridge.space, bridge.robots[i, SHAPE]))
    _call_pointer_pointer(bridge.remove_body, (bridge.space, bridge.robots[i, BODY]))


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
    _call_pointer_double(bridge.step, (bridge.space, time_step))
