"""What the simulated sensors measure: rays against walls, boxes and robots; noise.

Kernels. A ray starts on the sensor ring and is cast as far as the sensors reach. Walls are the inner faces of the
arena; boxes are obstacles and the bodies of robots.
"""

import math

import numpy as np
from numpy.typing import NDArray

from mercator_design.jit import jittable
from mercator_design.seeds import gaussian, uniform
from mercator_design.sim.scene import Scene

Floats = NDArray[np.float64]

NO_NOISE, GAUSSIAN, UNIFORM = 0.0, 1.0, 2.0
"""Kinds of noise: a row of noise is (kind, mean, standard deviation or half width)."""

NOISE_DRAWS = 2
"""Draws that one noisy value may use."""

# A robot pressed against a wall may have its ring this far [m] beyond the wall's face; it still touches the wall.
_CONTACT = 0.02
_PARALLEL = 1e-12


@jittable
def noise(row: Floats, key: np.uint64, counter: int) -> float:
    """One noise value, from draws `counter` and `counter + 1` of a stream."""
    if row[0] == GAUSSIAN:
        return float(row[1] + row[2] * gaussian(key, counter))
    if row[0] == UNIFORM:
        return float(row[1] + row[2] * (2.0 * uniform(key, counter) - 1.0))
    return 0.0


@jittable
def distance_to_wall(x: float, y: float, ray_x: float, ray_y: float, walls: Floats, i: int) -> float:
    """Distance [m] from (x, y) along a unit vector to a wall, or infinity.

    Args:
        x: Start of the ray [m].
        y: The same.
        ray_x: Unit vector.
        ray_y: The same.
        walls: (walls, 6) start x, y; vector to the end x, y; unit normal x, y.
        i: Which of them.
    """
    across = ray_x * walls[i, 3] - ray_y * walls[i, 2]
    if across < _PARALLEL:  # the arena lies to the left of its walls; the ray does not go to their right
        return math.inf
    to_x = walls[i, 0] - x
    to_y = walls[i, 1] - y
    along_wall = (to_x * ray_y - to_y * ray_x) / across
    if along_wall < 0.0 or along_wall > 1.0:
        return math.inf
    distance = (to_x * walls[i, 3] - to_y * walls[i, 2]) / across
    if distance < -_CONTACT:
        return math.inf
    return float(max(distance, 0.0))


@jittable
def distance_to_box(x: float, y: float, ray_x: float, ray_y: float, half_length: float, half_width: float) -> float:
    """Distance [m] along a ray, given in the frame of a box, to the box; 0 from inside, infinity past it."""
    enter = 0.0
    leave = math.inf
    if abs(ray_x) < _PARALLEL:
        if abs(x) > half_length:
            return math.inf
    else:
        first = (-half_length - x) / ray_x
        second = (half_length - x) / ray_x
        enter = max(enter, min(first, second))
        leave = min(leave, max(first, second))
    if abs(ray_y) < _PARALLEL:
        if abs(y) > half_width:
            return math.inf
    else:
        first = (-half_width - y) / ray_y
        second = (half_width - y) / ray_y
        enter = max(enter, min(first, second))
        leave = min(leave, max(first, second))
    return enter if enter <= leave else math.inf


@jittable
def cast_at_walls(scene: Scene, x: float, y: float, c: float, s: float, reach: float, found: Floats) -> None:
    """Shorten distances to those of the walls.

    Args:
        scene: The arena and the robots' sensors.
        x: Where the robot is [m].
        y: The same.
        c: Cosine of its heading.
        s: Sine of its heading.
        reach: How far from its centre [m] a ray ends at most.
        found: (sensors,) the distances [m].
    """
    walls = scene.walls
    for i in range(len(walls)):
        # Few walls are in reach, and the distance to their line tells.
        if abs((x - walls[i, 0]) * walls[i, 4] + (y - walls[i, 1]) * walls[i, 5]) > reach:
            continue
        for k in range(len(found)):
            ray_x = c * scene.directions_x[k] - s * scene.directions_y[k]
            ray_y = s * scene.directions_x[k] + c * scene.directions_y[k]
            distance = distance_to_wall(x + scene.ring * ray_x, y + scene.ring * ray_y, ray_x, ray_y, walls, i)
            found[k] = min(found[k], distance)


@jittable
def cast_at_box(
    scene: Scene,
    box_x: float,
    box_y: float,
    box_c: float,
    box_s: float,
    half_length: float,
    half_width: float,
    x: float,
    y: float,
    c: float,
    s: float,
    found: Floats,
) -> None:
    """Shorten distances to those of a box at (box_x, box_y) with heading (box_c, box_s); else as `cast_at_walls`."""
    to_x = box_c * (x - box_x) + box_s * (y - box_y)
    to_y = -box_s * (x - box_x) + box_c * (y - box_y)
    turn_c = box_c * c + box_s * s
    turn_s = box_c * s - box_s * c
    corner = half_length + half_width  # a bound of the true one
    for k in range(len(found)):
        ray_x = turn_c * scene.directions_x[k] - turn_s * scene.directions_y[k]
        ray_y = turn_s * scene.directions_x[k] + turn_c * scene.directions_y[k]
        # Most rays pass by, or point away.
        if abs(to_x * ray_y - to_y * ray_x) > corner or to_x * ray_x + to_y * ray_y > corner:
            continue
        distance = distance_to_box(
            to_x + scene.ring * ray_x, to_y + scene.ring * ray_y, ray_x, ray_y, half_length, half_width
        )
        found[k] = min(found[k], distance)
