"""How robots move where nothing is in their way, and where that is. Kernels."""

import math

from mercator_design.arrays import Flags, Floats
from mercator_design.jit import jittable
from mercator_design.sim.kernels.overlaps import is_inside, obstacle_overlap
from mercator_design.sim.kernels.scene import Scene

_REST = 1e-9
"""[m/s, rad/s] A robot that is and stays slower rests; a drive that has stopped leaves such remainders."""

_MARGIN = 0.005
"""[m] Allowed for beside velocities: Chipmunk also moves bodies apart that overlap."""

_PASSES = 8
"""Over walls and boxes: a way out of one may lead into another."""

_ROUNDING = 1e-9
"""[m]"""


@jittable
def glide(scene: Scene, poses: Floats, velocities: Floats, targets: Floats, i: int) -> None:
    """Move robot i for one control cycle, without contact.

    In each sub-step the position follows the velocity, then the velocity approaches the target as fast as the drive's
    force and torque allow: so a robot that begins to turn goes on sliding in its old direction. This is what
    Chipmunk's joints do to a body that touches nothing, and with them ARGoS (measured: 0.75 m/s2, 55 rad/s2).
    """
    dt = scene.time_step
    most = scene.force / scene.mass * dt
    most_turn = scene.torque / scene.inertia * dt
    x, y, heading = poses[i, 0], poses[i, 1], poses[i, 2]
    velocity_x, velocity_y, turn = velocities[i, 0], velocities[i, 1], velocities[i, 2]
    for _ in range(scene.sub_steps):
        x += velocity_x * dt
        y += velocity_y * dt
        heading += turn * dt
        change_x = targets[i, 0] - velocity_x
        change_y = targets[i, 1] - velocity_y
        size = math.sqrt(change_x * change_x + change_y * change_y)
        if size > most:
            change_x *= most / size
            change_y *= most / size
        velocity_x += change_x
        velocity_y += change_y
        turn += max(-most_turn, min(most_turn, targets[i, 2] - turn))
    poses[i, 0], poses[i, 1], poses[i, 2] = x, y, heading
    velocities[i, 0], velocities[i, 1], velocities[i, 2] = velocity_x, velocity_y, turn


@jittable
def mark_close(scene: Scene, poses: Floats, velocities: Floats, targets: Floats, reach: Floats, close: Flags) -> None:
    """Mark the robots that could touch something in this cycle.

    A robot by itself gets no farther than its present or its target speed takes it, whichever is higher. One that
    could touch something could also be pushed, as a rule no faster than the fastest corner of any robot moves; so those
    near it are marked in turn. (One that is pushed faster may overlap an unmarked robot for the rest of the cycle; in
    the next both are marked.) Robots at rest do nothing to each other, nor to walls.

    Args:
        scene: The arena and the robots' body.
        poses: (robots, 3 or more) x [m], y [m], ...
        velocities: (robots, 3) x, y [m/s], turn [rad/s]
        targets: (robots, 3) the same, aimed at.
        reach: (robots,) scratch: how far [m] from its centre each robot's body can get; 0 for one at rest.
        close: (robots,) the marks.
    """
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
def withdraw(scene: Scene, poses: Floats, velocities: Floats, former: Floats, i: int) -> bool:
    """Move robot i back if it reaches into walls or boxes too far; whether it did.

    Contacts act once bodies overlap, so in one sub-step a corner reaches as deep as it travels. Here the robot leaves
    by the shortest way until no overlap is larger than the scene allows. If that leads nowhere, as for one that turns
    where there is no room, it stands still where it began the cycle: there the overlaps were allowed.

    Args:
        scene: The arena and the robots' body.
        poses: (robots, 3 or more) x [m], y [m], heading [rad], ...
        velocities: (robots, 3)
        former: (robots, 3) poses at the beginning of the cycle.
        i: Which robot.
    """
    x, y = poses[i, 0], poses[i, 1]
    untouched = scene.wall_overlap == math.inf or not _near_walls(scene, x, y, scene.corner)
    if untouched and is_inside(scene.walls, x, y):
        return False  # one that is outside jumped over a wall
    c, s = math.cos(poses[i, 2]), math.sin(poses[i, 2])
    moved = False
    for _ in range(_PASSES):
        free = True
        for k in range(len(scene.walls) + len(scene.boxes)):
            overlap, out_x, out_y = obstacle_overlap(
                scene.walls, scene.boxes, k, scene.half_length, scene.half_width, scene.round, x, y, c, s
            )
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
        poses[i, k] = former[i, k]
        velocities[i, k] = 0.0
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
