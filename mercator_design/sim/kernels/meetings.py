"""Which robots could touch something in the next steps, and so have to be in Chipmunk's space. Kernels.

A robot outside the space moves by a formula. In each step of physics the robots enter that could touch something by the
end of the next step. So a robot's drive has made at least one step in the space when contacts are solved with it.
"""

import math

from mercator_design.jit import jittable
from mercator_design.sim.kernels.overlaps import PlacedBody, body_overlap, obstacle_overlap
from mercator_design.sim.kernels.scene import Scene
from mercator_design.sim.kernels.swarm import Swarm

ROBOT, OTHER, DUE = range(3)
"""Columns of `Swarm.meetings`: a robot; another one, or the number of robots for walls and boxes; the step of the cycle
until which they surely do not touch."""

AHEAD = 2
"""[steps] that a robot is in the space before it could touch something."""

_REST = 1e-9
"""[m/s, rad/s] A robot that is slower, and will be, is at rest; rounding errors remain when a drive has stopped."""

_MARGIN = 0.001
"""[m] Added to what velocities allow: Chipmunk also moves overlapping bodies apart, by less than this in a step."""

_NEVER = 1_000_000
"""[steps]"""


@jittable
def find_meetings(scene: Scene, swarm: Swarm) -> int:
    """List in `swarm.meetings` who could touch what in this cycle, and mark in `swarm.close` those that soon could.

    Robots at rest do not affect each other or walls. `swarm.reach` becomes how far [m] from its centre each robot's
    body can get in this cycle; 0 for a robot at rest.

    Returns:
        The number of rows of `swarm.meetings`.
    """
    poses, velocities, targets, reach = swarm.poses, swarm.velocities, swarm.targets, swarm.reach
    n = len(poses)
    cycle = scene.time_step * scene.sub_steps
    for i in range(n):
        now = velocities[i, 0] * velocities[i, 0] + velocities[i, 1] * velocities[i, 1]
        then = targets[i, 0] * targets[i, 0] + targets[i, 1] * targets[i, 1]
        speed = math.sqrt(max(now, then))
        moves = speed + max(abs(velocities[i, 2]), abs(targets[i, 2])) > _REST
        reach[i] = scene.corner + speed * cycle + _MARGIN if moves else 0.0
        swarm.close[i] = False
    meetings = 0
    for i in range(n):
        if reach[i] > 0.0 and is_near_walls(scene, poses[i, 0], poses[i, 1], reach[i]):
            meetings = _note(scene, swarm, meetings, i, n)
        for j in range(i):
            if reach[i] == 0.0 and reach[j] == 0.0:
                continue
            x, y = poses[i, 0] - poses[j, 0], poses[i, 1] - poses[j, 1]
            both = max(reach[i], scene.corner) + max(reach[j], scene.corner)
            if x * x + y * y < both * both:
                meetings = _note(scene, swarm, meetings, i, j)
    return meetings


@jittable
def _note(scene: Scene, swarm: Swarm, meetings: int, i: int, j: int) -> int:
    """List a meeting, or mark the robots if it could be soon or the list is full; return the number of rows."""
    rows, n = swarm.meetings, len(swarm.poses)
    steps = _safe_steps(scene, swarm, i, j)
    if steps >= scene.sub_steps + AHEAD:
        return meetings
    if steps < AHEAD or meetings == len(rows):
        swarm.close[i] = True
        if j < n:
            swarm.close[j] = True
        return meetings
    rows[meetings, ROBOT], rows[meetings, OTHER], rows[meetings, DUE] = i, j, steps - AHEAD + 1
    return meetings + 1


@jittable
def mark_close(scene: Scene, swarm: Swarm, meetings: int, step: int) -> None:
    """Mark in `swarm.close` the robots that could touch something by the end of the step after this one.

    Robots that are marked stay so for the rest of the cycle. What they touch is marked in turn.
    """
    rows, close, n = swarm.meetings, swarm.close, len(swarm.poses)
    if step > 0:
        for row in range(meetings):
            i, j = rows[row, ROBOT], rows[row, OTHER]
            if rows[row, DUE] > step or close[i] or (j < n and close[j]):
                continue  # what is near a marked robot is found below
            _face(swarm, i)
            if j < n:
                _face(swarm, j)
            steps = _safe_steps(scene, swarm, i, j)
            rows[row, DUE] = step + steps - AHEAD + 1
            if steps < AHEAD:
                close[i] = True
                if j < n:
                    close[j] = True
    order = swarm.order
    marked, others = 0, n
    for i in range(n):
        if close[i]:
            order[marked] = i
            marked += 1
        else:
            others -= 1
            order[others] = i
    done = 0
    while done < marked < n:
        marked = _mark_near(scene, swarm, order[done], marked)
        done += 1


@jittable
def _mark_near(scene: Scene, swarm: Swarm, i: int, marked: int) -> int:
    """Mark the robots that marked robot i could touch, and return how many are marked.

    These are first in `swarm.order`.
    """
    poses, velocities, order = swarm.poses, swarm.velocities, swarm.order
    speed = math.sqrt(velocities[i, 0] * velocities[i, 0] + velocities[i, 1] * velocities[i, 1])
    near = 2.0 * scene.corner + _MARGIN + speed * AHEAD * scene.time_step
    is_faced = False
    for place in range(marked, len(order)):
        j = order[place]
        x, y = poses[i, 0] - poses[j, 0], poses[i, 1] - poses[j, 1]
        both = near + max(0.0, swarm.reach[j] - scene.corner)
        if x * x + y * y >= both * both:
            continue
        if not is_faced:
            _face(swarm, i)
            is_faced = True
        _face(swarm, j)
        if _safe_steps(scene, swarm, i, j) < AHEAD:
            swarm.close[j] = True
            order[place], order[marked] = order[marked], j
            marked += 1
    return marked


@jittable
def _face(swarm: Swarm, i: int) -> None:
    """Update cosine and sine of a robot's heading."""
    swarm.poses[i, 3] = math.cos(swarm.poses[i, 2])
    swarm.poses[i, 4] = math.sin(swarm.poses[i, 2])


@jittable
def _safe_steps(scene: Scene, swarm: Swarm, i: int, j: int) -> int:
    """The number of steps in which robot i surely does not touch robot j, or walls and boxes if j is no robot."""
    turn = _turn(swarm, i)
    body = _body_after(scene, swarm, i, 0)
    if j < len(swarm.poses):
        gap, x, y = body_overlap(body, _body_after(scene, swarm, j, 0), scene.round)
        approach = _speed_against(swarm, i, x, y) + _speed_against(swarm, j, -x, -y)
        steps = _steps_to_close(scene, -gap, approach, turn, _turn(swarm, j))
    else:
        steps = _NEVER
        for k in range(len(scene.walls) + len(scene.boxes)):
            gap, x, y = obstacle_overlap(scene.walls, scene.boxes, k, body, scene.round)
            steps = min(steps, _steps_to_close(scene, -gap, _speed_against(swarm, i, x, y), turn, 0.0))
    if 0 <= steps < AHEAD:
        for ahead in range(1, AHEAD + 1):
            if _overlap_after(scene, swarm, i, j, ahead) > -_MARGIN * ahead:
                return 0
        return AHEAD
    return steps


@jittable
def _overlap_after(scene: Scene, swarm: Swarm, i: int, j: int, steps: int) -> float:
    """Overlap [m] of robot i with robot j, or walls and boxes, after some steps, if they move on as they do."""
    body = _body_after(scene, swarm, i, steps)
    if j < len(swarm.poses):
        overlap, _, _ = body_overlap(body, _body_after(scene, swarm, j, steps), scene.round)
        return overlap
    deepest = -math.inf
    for k in range(len(scene.walls) + len(scene.boxes)):
        overlap, _, _ = obstacle_overlap(scene.walls, scene.boxes, k, body, scene.round)
        deepest = max(deepest, overlap)
    return deepest


@jittable
def _steps_to_close(scene: Scene, gap: float, approach: float, turn: float, other_turn: float) -> int:
    """The number of steps in which a gap [m] surely stays open, at a speed of approach [m/s] and of turns [rad/s].

    It is -1 if there is no gap now.
    """
    room = gap - _MARGIN
    if room <= 0.0:
        return -1
    dt = scene.time_step
    approach = max(0.0, approach)
    if scene.round:
        turn = other_turn = 0.0
    closing = (approach + (turn + other_turn) * scene.corner) * dt
    steps = room / closing if closing > 0.0 else _NEVER
    # However far a body turns, it extends by its corner at most.
    extent = scene.corner - min(scene.half_length, scene.half_width)
    room -= (extent if turn > 0.0 else 0.0) + (extent if other_turn > 0.0 else 0.0)
    if room > 0.0:
        steps = max(steps, room / (approach * dt) if approach > 0.0 else _NEVER)
    return int(min(steps, _NEVER))


@jittable
def _speed_against(swarm: Swarm, i: int, x: float, y: float) -> float:
    """The highest speed [m/s] of robot i against a direction, as its velocity approaches the target."""
    now = swarm.velocities[i, 0] * x + swarm.velocities[i, 1] * y
    then = swarm.targets[i, 0] * x + swarm.targets[i, 1] * y
    return max(-float(now), -float(then))


@jittable
def _turn(swarm: Swarm, i: int) -> float:
    """The highest turning speed [rad/s] of robot i."""
    return max(abs(float(swarm.velocities[i, 2])), abs(float(swarm.targets[i, 2])))


@jittable
def _body_after(scene: Scene, swarm: Swarm, i: int, steps: int) -> PlacedBody:
    """The body of robot i after some steps, if it moves on as it does."""
    poses, velocities = swarm.poses, swarm.velocities
    dt = scene.time_step * steps
    angle = velocities[i, 2] * dt
    c, s = 1.0 - 0.5 * angle * angle, angle  # of a small angle
    x, y = poses[i, 0] + velocities[i, 0] * dt, poses[i, 1] + velocities[i, 1] * dt
    turned_c, turned_s = c * poses[i, 3] - s * poses[i, 4], s * poses[i, 3] + c * poses[i, 4]
    return PlacedBody(x, y, turned_c, turned_s, scene.half_length, scene.half_width)


@jittable
def is_near_walls(scene: Scene, x: float, y: float, reach: float) -> bool:
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
