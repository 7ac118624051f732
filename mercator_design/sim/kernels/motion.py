"""How robots move without contact, and out of walls. Kernels."""

import math

from mercator_design.jit import jittable
from mercator_design.sim.kernels.meetings import is_near_walls
from mercator_design.sim.kernels.overlaps import PlacedBody, is_inside, obstacle_overlap
from mercator_design.sim.kernels.scene import Scene
from mercator_design.sim.kernels.swarm import Swarm

_PASSES = 8
"""Number of passes over walls and boxes: the way out of one may lead into another."""

_ROUNDING = 1e-9
"""[m]"""


@jittable
def glide(scene: Scene, swarm: Swarm, i: int, steps: int) -> None:
    """Move robot i for some steps of physics, without contact.

    In each step the position follows the velocity, then the velocity approaches the target as fast as the drive's
    force and torque allow. So a robot that begins to turn keeps sliding in its old direction. Chipmunk's joints, and
    so ARGoS, move a body that touches nothing in the same way (measured: 0.75 m/s2, 55 rad/s2).
    """
    poses, velocities, targets = swarm.poses, swarm.velocities, swarm.targets
    dt = scene.time_step
    max_change = scene.physics.force / scene.physics.mass * dt
    max_turn_change = scene.physics.torque / scene.physics.inertia * dt
    x, y, heading = poses[i, 0], poses[i, 1], poses[i, 2]
    velocity_x, velocity_y, turn = velocities[i, 0], velocities[i, 1], velocities[i, 2]
    for _ in range(steps):
        x += velocity_x * dt
        y += velocity_y * dt
        heading += turn * dt
        change_x = targets[i, 0] - velocity_x
        change_y = targets[i, 1] - velocity_y
        size = math.sqrt(change_x * change_x + change_y * change_y)
        if size > max_change:
            change_x *= max_change / size
            change_y *= max_change / size
        velocity_x += change_x
        velocity_y += change_y
        turn += max(-max_turn_change, min(max_turn_change, targets[i, 2] - turn))
    poses[i, 0], poses[i, 1], poses[i, 2] = x, y, heading
    velocities[i, 0], velocities[i, 1], velocities[i, 2] = velocity_x, velocity_y, turn


@jittable
def withdraw(scene: Scene, swarm: Swarm, i: int) -> bool:
    """Move robot i back if it overlaps walls or boxes too far; whether it was moved.

    Contacts act once bodies overlap, so in one sub-step a corner reaches as deep as it travels. Here the robot moves
    out by the shortest way until no overlap is larger than the scene allows. If this does not succeed, for example
    because the robot turns where there is no room, it stops at its pose at the beginning of the cycle: there the
    overlaps were allowed.
    """
    poses = swarm.poses
    x, y = poses[i, 0], poses[i, 1]
    untouched = scene.wall_overlap == math.inf or not is_near_walls(scene, x, y, scene.corner)
    if untouched and is_inside(scene.walls, x, y):
        return False  # a robot outside jumped over a wall
    c, s = math.cos(poses[i, 2]), math.sin(poses[i, 2])
    moved = False
    for _ in range(_PASSES):
        free = True
        for k in range(len(scene.walls) + len(scene.boxes)):
            body = PlacedBody(x, y, c, s, scene.half_length, scene.half_width)
            overlap, out_x, out_y = obstacle_overlap(scene.walls, scene.boxes, k, body, scene.round)
            excess = overlap - scene.wall_overlap
            if excess > _ROUNDING:
                x += excess * out_x
                y += excess * out_y
                free = False
        if free and is_inside(scene.walls, x, y):
            poses[i, 0], poses[i, 1] = x, y
            return moved
        moved = True
    for k in range(3):
        poses[i, k] = swarm.former[i, k]
        swarm.velocities[i, k] = 0.0
    return True
