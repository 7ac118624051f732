"""What rays and lines of sight meet: walls, boxes and robots. Kernels.

A ray of a proximity sensor starts on the sensor ring and is cast as far as the sensors reach. Walls are the inner faces
of the arena; boxes are obstacles and the bodies of robots, which may also be discs.
"""

import math
from typing import TypeAlias

from mercator_design.arrays import Floats
from mercator_design.jit import jittable
from mercator_design.sim.kernels.overlaps import PlacedBody, box_at
from mercator_design.sim.kernels.scene import Proximity, Scene

Place: TypeAlias = tuple[float, float, float]
"""x, y and height [m]."""

# The sensor ring of a robot pressed against a wall may be this far [m] beyond the wall's face.
_CONTACT = 0.02
_PARALLEL = 1e-12


@jittable
def distance_to_wall(x: float, y: float, ray_x: float, ray_y: float, walls: Floats, i: int) -> float:
    """Distance [m] from (x, y) along the unit vector (ray_x, ray_y) to wall i, or infinity.

    A row of walls (walls, 6) is: start x, y; vector to the end x, y; unit normal x, y.
    """
    across = ray_x * walls[i, 3] - ray_y * walls[i, 2]
    if across < _PARALLEL:  # the arena is to the left of its walls; a ray to their right meets nothing
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
    enter_x, leave_x = _slab(x, ray_x, half_length)
    enter_y, leave_y = _slab(y, ray_y, half_width)
    enter, leave = max(0.0, enter_x, enter_y), min(leave_x, leave_y)
    return enter if enter <= leave else math.inf


@jittable
def _slab(x: float, ray_x: float, half: float) -> tuple[float, float]:
    """The distances along a ray [m] between which |x| <= half; infinity and minus infinity if there are none."""
    if abs(ray_x) < _PARALLEL:
        return (-math.inf, math.inf) if abs(x) <= half else (math.inf, -math.inf)
    first = (-half - x) / ray_x
    second = (half - x) / ray_x
    return min(first, second), max(first, second)


@jittable
def distance_to_disc(x: float, y: float, ray_x: float, ray_y: float, radius: float) -> float:
    """Distance [m] along a ray, given in the frame of a disc, to the disc; 0 from inside, infinity past it."""
    ahead = -(x * ray_x + y * ray_y)
    past = x * ray_y - y * ray_x
    half_chord = radius * radius - past * past
    if half_chord < 0.0:
        return math.inf
    half_chord = math.sqrt(half_chord)
    return math.inf if ahead + half_chord < 0.0 else max(0.0, ahead - half_chord)


@jittable
def _cast_at_walls(
    sensors: Proximity, walls: Floats, x: float, y: float, c: float, s: float, reach: float, found: Floats
) -> None:
    """Shorten the distances [m] found (sensors,) by a ring of proximity sensors to those of the walls.

    The robot is at (x, y); c and s are cosine and sine of its heading. Rays end within `reach` of its centre.
    """
    for i in range(len(walls)):
        # Few walls are in reach: the distance to a wall's line is a lower bound of that to the wall.
        if abs((x - walls[i, 0]) * walls[i, 4] + (y - walls[i, 1]) * walls[i, 5]) > reach:
            continue
        for k in range(len(found)):
            ray_x = c * sensors.directions_x[k] - s * sensors.directions_y[k]
            ray_y = s * sensors.directions_x[k] + c * sensors.directions_y[k]
            distance = distance_to_wall(x + sensors.ring * ray_x, y + sensors.ring * ray_y, ray_x, ray_y, walls, i)
            found[k] = min(found[k], distance)


@jittable
def _cast_at_box(sensors: Proximity, box: PlacedBody, x: float, y: float, c: float, s: float, found: Floats) -> None:
    """Shorten distances to those of a box; other arguments as in `_cast_at_walls`."""
    to_x = box.c * (x - box.x) + box.s * (y - box.y)
    to_y = -box.s * (x - box.x) + box.c * (y - box.y)
    turn_c = box.c * c + box.s * s
    turn_s = box.c * s - box.s * c
    corner = box.half_length + box.half_width  # an upper bound of the distance from the centre to a corner
    for k in range(len(found)):
        ray_x = turn_c * sensors.directions_x[k] - turn_s * sensors.directions_y[k]
        ray_y = turn_s * sensors.directions_x[k] + turn_c * sensors.directions_y[k]
        # Most rays pass by, or point away.
        if abs(to_x * ray_y - to_y * ray_x) > corner or to_x * ray_x + to_y * ray_y > corner:
            continue
        distance = distance_to_box(
            to_x + sensors.ring * ray_x, to_y + sensors.ring * ray_y, ray_x, ray_y, box.half_length, box.half_width
        )
        found[k] = min(found[k], distance)


@jittable
def _cast_at_disc(sensors: Proximity, disc: PlacedBody, x: float, y: float, c: float, s: float, found: Floats) -> None:
    """Shorten distances to those of a disc; other arguments as in `_cast_at_walls`."""
    for k in range(len(found)):
        ray_x = c * sensors.directions_x[k] - s * sensors.directions_y[k]
        ray_y = s * sensors.directions_x[k] + c * sensors.directions_y[k]
        distance = distance_to_disc(
            x - disc.x + sensors.ring * ray_x, y - disc.y + sensors.ring * ray_y, ray_x, ray_y, disc.half_length
        )
        found[k] = min(found[k], distance)


@jittable
def _robot_at(scene: Scene, poses: Floats, i: int) -> PlacedBody:
    """The body of robot i."""
    return PlacedBody(poses[i, 0], poses[i, 1], poses[i, 3], poses[i, 4], scene.half_length, scene.half_width)


@jittable
def cast(scene: Scene, poses: Floats, i: int, range_: float, found: Floats) -> None:
    """Measure the distances [m] that the proximity sensors of robot i see, up to a range [m]; infinity beyond.

    Args:
        scene: The arena and the robots.
        poses: (robots, 5) x, y [m], heading [rad], its cosine and sine.
        i: Which robot.
        range_: Of the sensors [m]; beyond it, obstacles may be missing.
        found: (sensors,) receives the distances.
    """
    x, y, c, s = poses[i, 0], poses[i, 1], poses[i, 3], poses[i, 4]
    sensors = scene.proximity
    for k in range(len(found)):
        found[k] = math.inf
    reach = sensors.ring + range_
    _cast_at_walls(sensors, scene.walls, x, y, c, s, reach, found)
    for b in range(len(scene.boxes)):
        _cast_at_box(sensors, box_at(scene.boxes, b), x, y, c, s, found)
    meets = (reach + scene.corner) * (reach + scene.corner)
    for j in range(len(poses)):
        to_x = poses[j, 0] - x
        to_y = poses[j, 1] - y
        if j == i or to_x * to_x + to_y * to_y >= meets:
            continue
        if scene.round:
            _cast_at_disc(sensors, _robot_at(scene, poses, j), x, y, c, s, found)
        else:
            _cast_at_box(sensors, _robot_at(scene, poses, j), x, y, c, s, found)


@jittable
def is_hidden(scene: Scene, poses: Floats, i: int, j: int, low: Place, high: Place) -> bool:
    """Whether something stands between two points and is high enough to hide one from the other.

    Args:
        scene: The arena, the boxes and the robots.
        poses: (robots, 5) as in `cast`.
        i: A robot that hides nothing, because it looks.
        j: Another one, because it is looked at.
        low: The lower point.
        high: The other point.
    """
    x, y, height = low
    away_x, away_y = high[0] - x, high[1] - y
    away = math.sqrt(away_x * away_x + away_y * away_y)
    if away == 0.0:
        return False
    ray_x, ray_y = away_x / away, away_y / away
    climb = (high[2] - height) / away
    walls, boxes = scene.walls, scene.boxes
    for k in range(len(walls)):
        across = ray_x * walls[k, 3] - ray_y * walls[k, 2]
        if abs(across) < _PARALLEL:
            continue
        start_x, start_y = walls[k, 0] - x, walls[k, 1] - y
        along_wall = (start_x * ray_y - start_y * ray_x) / across
        distance = (start_x * walls[k, 3] - start_y * walls[k, 2]) / across
        crosses = 0.0 <= along_wall <= 1.0 and 0.0 <= distance < away
        if crosses and height + climb * distance < scene.wall_height:
            return True
    for b in range(len(boxes)):
        distance = _distance_to_placed_box(x, y, ray_x, ray_y, box_at(boxes, b))
        if distance < away and height + climb * distance < boxes[b, 6]:
            return True
    for k in range(len(poses)):
        if k in (i, j):
            continue
        if scene.round:
            distance = distance_to_disc(x - poses[k, 0], y - poses[k, 1], ray_x, ray_y, scene.corner)
        else:
            distance = _distance_to_placed_box(x, y, ray_x, ray_y, _robot_at(scene, poses, k))
        if distance < away and height + climb * distance < scene.body_height:
            return True
    return False


@jittable
def is_lit(scene: Scene, poses: Floats, i: int, n: int, sensor: Place, range_: float, occlusion: bool) -> bool:
    """Whether light n is in the range [m] of a sensor of robot i at a point and, with occlusion, not hidden from it."""
    light = scene.light.lights[n, 0], scene.light.lights[n, 1], scene.light.lights[n, 2]
    to_x, to_y = light[0] - sensor[0], light[1] - sensor[1]
    if to_x * to_x + to_y * to_y > range_ * range_:
        return False
    if not occlusion:
        return True
    if light[2] < sensor[2]:
        return not is_hidden(scene, poses, i, i, light, sensor)
    return not is_hidden(scene, poses, i, i, sensor, light)


@jittable
def _distance_to_placed_box(x: float, y: float, ray_x: float, ray_y: float, box: PlacedBody) -> float:
    """As `distance_to_box`, in the world's frame."""
    from_x, from_y = x - box.x, y - box.y
    return distance_to_box(
        box.c * from_x + box.s * from_y,
        box.c * from_y - box.s * from_x,
        box.c * ray_x + box.s * ray_y,
        box.c * ray_y - box.s * ray_x,
        box.half_length,
        box.half_width,
    )
