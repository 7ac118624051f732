"""Random walks of Mercators, to compare designs with: ballistic, Brownian, Levy, correlated.

Kegeleirs, Garzon Ramos and Birattari 2019 (Random walk exploration for swarm mapping, TAROS) compared such walks. These
are written anew, from the distributions. A walk is a series of steps: turn on the spot, then drive straight on for the
step's length. A robot measures both by its odometry. At an obstacle in front, each walk turns to a uniform direction
(ours; a step of another distribution might never leave a wall). The first direction is uniform, too.

The step is over once its length was driven; what a robot slides as it turns comes on top, up to 0.09 m on `mercator`.
"""

import math
from typing import Annotated

from mercator_design import Range, behaviour, drive, jittable

_TURNING, _DRIVING = 1.0, 2.0  # phases, memory[0]; 0 at the start
_EXACT = 0.01  # [rad] within which the robot drives in the direction of its step
_SOFT = 0.5  # [rad] below which it turns slower
_PATIENCE = 60.0  # cycles of a turn, after which robots or walls are thought to hinder it
_HUGE = 1e6  # [m]


@jittable
def wrapped(angle):
    """An angle [rad] from -pi to pi."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@jittable
def walk(model, readings, memory, u, turn, length):
    """A cycle of a walk whose next step has this turn [rad] and length [m], if it is drawn in this cycle."""
    heading = readings.heading
    away_x, away_y = readings.odometry_x - memory[2], readings.odometry_y - memory[3]
    near = math.sqrt(readings.proximity_x * readings.proximity_x + readings.proximity_y * readings.proximity_y)
    uniform = math.pi * (2.0 * u - 1.0)
    if memory[0] == _DRIVING:
        if readings.proximity_x >= 0.0 and near >= model.obstacle_threshold:
            memory[0], memory[1], memory[5] = _TURNING, heading + uniform, 0.0
        elif math.sqrt(away_x * away_x + away_y * away_y) >= memory[4]:
            memory[0], memory[1], memory[5] = _TURNING, heading + turn, 0.0
    elif memory[0] != _TURNING:
        memory[0], memory[1] = _TURNING, heading + uniform
    if memory[0] == _TURNING:
        left_to_turn = wrapped(memory[1] - heading)
        memory[5] += 1.0
        if abs(left_to_turn) > _EXACT and memory[5] < _PATIENCE:
            speed = max(-1.0, min(1.0, left_to_turn / _SOFT))
            return drive(-speed, speed)
        if memory[5] > 1.0:  # another draw than that of the turn
            memory[0], memory[2], memory[3], memory[4] = _DRIVING, readings.odometry_x, readings.odometry_y, length
        else:
            return drive(0.0, 0.0)
    return drive(1.0, 1.0)


@behaviour(reads={"proximity", "heading", "odometry"}, memory=6)
def ballistic_walk(model, readings, memory, u):
    """Drive straight on until there is an obstacle, then in a uniform direction."""
    return walk(model, readings, memory, u, 0.0, _HUGE)


@behaviour(reads={"proximity", "heading", "odometry"}, memory=6)
def brownian_walk(
    model,
    readings,
    memory,
    u,
    step: Annotated[float, Range(0.05, 2)],  # [m] length of a step
):
    """Drive steps of one length, each in a uniform direction."""
    return walk(model, readings, memory, u, math.pi * (2.0 * u - 1.0), step)


@behaviour(reads={"proximity", "heading", "odometry"}, memory=6)
def levy_walk(
    model,
    readings,
    memory,
    u,
    mu: Annotated[float, Range(1.1, 3)],  # exponent of the density l^-mu of a step's length l
    shortest: Annotated[float, Range(0.05, 2)],  # [m] length of a step, at least
):
    """Drive steps whose lengths have a power law, each in a uniform direction."""
    length = min(_HUGE, shortest * math.exp(-math.log(1.0 - u) / (mu - 1.0)))
    return walk(model, readings, memory, u, math.pi * (2.0 * u - 1.0), length)


@behaviour(reads={"proximity", "heading", "odometry"}, memory=6)
def correlated_walk(
    model,
    readings,
    memory,
    u,
    rho: Annotated[float, Range(0, 0.99)],  # mean cosine of the turns, which have a wrapped Cauchy distribution
    step: Annotated[float, Range(0.05, 2)],  # [m] length of a step
):
    """Drive steps of one length, each with a turn that is likely to be small."""
    turn = 2.0 * math.atan((1.0 - rho) / (1.0 + rho) * math.tan(math.pi * (u - 0.5)))
    return walk(model, readings, memory, u, turn, step)
