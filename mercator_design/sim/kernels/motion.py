"""How robots move without contact, and which robots could have contact. Kernels."""

import math

from mercator_design.jit import jittable
from mercator_design.sim.kernels.overlaps import PlacedBody, is_inside, obstacle_overlap
from mercator_design.sim.kernels.scene import Scene
from mercator_design.sim.kernels.swarm import Swarm

_REST = 1e-9
"""[m/s, rad/s] A robot that is slower, and will be, is at rest; rounding errors remain when a drive has stopped."""

_MARGIN = 0.005
"""[m] Added to what velocities allow: Chipmunk also moves overlapping bodies apart."""

_PASSES = 8
"""Number of passes over walls and boxes: the way out of one may lead into another."""

_ROUNDING = 1e-9
"""[m]"""


@jittable
def glide(scene: Scene, swarm: Swarm, i: int) -> None:
    """Move robot i for one control cycle, without contact.

    In each sub-step the position follows the velocity, then the velocity approaches the target as fast as the drive's
    force and torque allow. So a robot that begins to turn keeps sliding in its old direction. Chipmunk's joints, and
    so ARGoS, move a body that touches nothing in the same way (measured: 0.75 m/s2, 55 rad/s2).
    """
    poses, velocities, targets = swarm.poses, swarm.velocities, swarm.targets
    dt = scene.time_step
    max_change = scene.physics.force / scene.physics.mass * dt
    max_turn_change = scene.physics.torque / scene.physics.inertia * dt
    x, y, heading = poses[i, 0], poses[i, 1], poses[i, 2]
    velocity_x, velocity_y, turn = velocities[i, 0], velocities[i, 1], velocities[i, 2]
    for _ in range(scene.sub_steps):
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
def mark_close(scene: Scene, swarm: Swarm) -> None:
    """Mark in `swarm.close` the robots that could touch something in this cycle.

    A robot moves at its present or its target speed at most, whichever is higher. A robot that could touch something
    could also be pushed, usually no faster than the fastest corner of any robot moves; so the robots near it are marked
    in turn. (A robot that is pushed faster may overlap an unmarked robot for the rest of the cycle; in the next both
    are marked.) Robots at rest do not affect each other or walls.

    `swarm.reach` is scratch: how far [m] from its centre each robot's body can get; 0 for a robot at rest.
    """
    poses, velocities, targets = swarm.poses, swarm.velocities, swarm.targets
    reach, close = swarm.reach, swarm.close
    n = len(poses)
    cycle = scene.time_step * scene.sub_steps
    fastest = 0.0
    for i in range(n):
        now = velocities[i, 0] * velocities[i, 0] + velocities[i, 1] * velocities[i, 1]
        then = targets[i, 0] * targets[i, 0] + targets[i, 1] * targets[i, 1]
        speed = math.sqrt(max(now, then))
        turn = max(abs(velocities[i, 2]), abs(targets[i, 2]))
        fastest = max(fastest, speed + turn * scene.corner)
        moves = speed + turn > _REST
        reach[i] = scene.corner + speed * cycle if moves else 0.0
        close[i] = moves and _near_walls(scene, poses[i, 0], poses[i, 1], reach[i])
    pushed = scene.corner + fastest * cycle + _MARGIN
    for i in range(n):
        if close[i]:
            reach[i] = pushed
    changed = True
    while changed:
        changed = False
        for i in range(n):
            for j in range(i):
                if (close[i] and close[j]) or (reach[i] == 0.0 and reach[j] == 0.0):
                    continue
                x = poses[i, 0] - poses[j, 0]
                y = poses[i, 1] - poses[j, 1]
                both = max(reach[i], scene.corner) + max(reach[j], scene.corner)
                if x * x + y * y < both * both:
                    close[i] = close[j] = changed = True
                    reach[i] = reach[j] = pushed


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
    untouched = scene.wall_overlap == math.inf or not _near_walls(scene, x, y, scene.corner)
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


@jittable
def _near_walls(scene: Scene, x: float, y: float, reach: float) -> bool:
    """Whether a wall or box is within reach [m] of a point inside the arena."""
    walls, boxes = scene.walls, scene.boxes
    for i in range(len(walls)):
        away = abs((x - walls[i, 0]) * walls[i, 4] + (y - walls[i, 1]) * walls[i, 5])
        if away >= reach:
            continue
        squared_length = walls[i, 2] * walls[i, 2] + walls[i, 3] * walls[i, 3]
        along = ((x - walls[i, 0]) * walls[i, 2] + (y - walls[i, 1]) * walls[i, 3]) / squared_length
        beyond = max(0.0, -along, along - 1.0)
        if away * away + beyond * beyond * squared_length < reach * reach:
            return True
    for i in range(len(boxes)):
        along = boxes[i, 2] * (x - boxes[i, 0]) + boxes[i, 3] * (y - boxes[i, 1])
        across = boxes[i, 2] * (y - boxes[i, 1]) - boxes[i, 3] * (x - boxes[i, 0])
        over = max(0.0, abs(along) - boxes[i, 4])
        aside = max(0.0, abs(across) - boxes[i, 5])
        if over * over + aside * aside < reach * reach:
            return True
    return False
