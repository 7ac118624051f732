"""What a lidar sees: walls, boxes and bodies that are higher than it, and the heads of other lidars. Kernels.

Beams start at the robot's centre. Each object covers a range of beams, and only these are computed: beams are cleared
and read in groups, and groups that no object covers are passed over.
"""

import math

import numpy as np

from mercator_design.arrays import Flags, Floats, Numbers
from mercator_design.jit import jittable
from mercator_design.missions.walls import meets_side
from mercator_design.sim.kernels.noise import LIDAR_DRAWS, NO_NOISE, noise
from mercator_design.sim.kernels.scene import Lidar, Scene
from mercator_design.sim.kernels.sight import distance_to_box, distance_to_disc

GROUP = 16
"""Number of beams that are cleared and read together."""

_END = 1e-9
"""Fraction of a wall's length beyond its end where a beam still meets it, so that none passes through a corner."""


@jittable
def scan(
    scene: Scene,
    poses: Floats,
    i: int,
    key: np.uint64,
    cycle: int,
    found: Floats,
    hits: Numbers,
    covered: Flags,
) -> None:
    """One turn of robot i's lidar.

    Args:
        scene: The arena and the robots.
        poses: (robots, 5) x, y [m], heading [rad], its cosine and sine.
        i: Which robot.
        key: Key of its stream of noise.
        cycle: Number of the control cycle.
        found: (beams,) receives distances [m]; 0 where nothing is in range.
        hits: (beams,) scratch.
        covered: (groups of beams,) scratch; false before and after.
    """
    for k in range(len(found)):
        found[k] = 0.0
    scan_near(scene, poses, i, key, cycle, math.inf, found, hits, covered)


@jittable
def scan_near(
    scene: Scene,
    poses: Floats,
    i: int,
    key: np.uint64,
    cycle: int,
    reach: float,
    found: Floats,
    hits: Numbers,
    covered: Flags,
) -> int:
    """One turn of robot i's lidar that is exact up to `reach` [m].

    Other arguments are those of `scan`; `hits` receives the numbers of the beams that something is in range of, in
    order. Other beams read 0, or are not written to `found`. A beam may read 0 that meets something beyond the reach.

    Returns:
        The number of hits.
    """
    lidar = scene.lidar
    x, y, c, s = poses[i, 0], poses[i, 1], poses[i, 3], poses[i, 4]
    beams = len(found)
    radius = scene.corner if lidar.sees_bodies else lidar.head
    centre_reach = reach + lidar.ring + radius
    is_empty = True
    outlines = lidar.outlines
    for w in range(len(outlines)):
        start_x, start_y = outlines[w, 0] - x, outlines[w, 1] - y
        if abs(start_x * outlines[w, 4] + start_y * outlines[w, 5]) > reach + lidar.ring:
            continue
        is_empty = False
        _meet_wall(lidar, start_x, start_y, start_x + outlines[w, 2], start_y + outlines[w, 3], c, s, found, covered)
    for j in range(len(poses)):
        to_x, to_y = poses[j, 0] - x, poses[j, 1] - y
        if j == i or radius == 0.0 or to_x * to_x + to_y * to_y > centre_reach * centre_reach:
            continue
        is_empty = False
        if lidar.sees_bodies and not scene.round:
            _meet_box(scene, to_x, to_y, poses[j, 3], poses[j, 4], c, s, found, covered)
        else:
            _meet_disc(lidar, to_x, to_y, radius, c, s, found, covered)
    n = 0
    if is_empty:
        return n
    noisy = lidar.noise[0] != NO_NOISE
    for group in range(len(covered)):
        if not covered[group]:
            continue
        covered[group] = False
        for k in range(GROUP * group, min(beams, GROUP * (group + 1))):
            distance = found[k] - lidar.ring
            if not lidar.nearest <= distance <= lidar.furthest:
                found[k] = 0.0
                continue
            if noisy:
                disturbed = distance + noise(lidar.noise, key, LIDAR_DRAWS, cycle * beams + k)
                distance = max(0.0, min(lidar.furthest, disturbed))
            found[k] = distance
            hits[n] = k
            n += 1
    return n


@jittable
def _cover(found: Floats, covered: Flags, first: int, count: int) -> int:
    """Clear what is not covered yet of `count` beams from the first on, which may be negative; return its number."""
    beams = len(found)
    first %= beams
    k, left = first, count
    while left > 0:
        group = k // GROUP
        end = min(beams, GROUP * (group + 1))
        if not covered[group]:
            covered[group] = True
            for each in range(GROUP * group, end):
                found[each] = math.inf
        left -= end - k
        k = end if end < beams else 0
    return first


@jittable
def _first_beam(lidar: Lidar, angle: float) -> int:
    """The beam before an angle [rad] from the robot's front; may be negative."""
    return math.floor((angle - lidar.first_angle) / lidar.angle_step)


@jittable
def _meet_wall(
    lidar: Lidar,
    start_x: float,
    start_y: float,
    end_x: float,
    end_y: float,
    c: float,
    s: float,
    found: Floats,
    covered: Flags,
) -> None:
    """Shorten beams that meet a wall between two points, relative to the robot's centre."""
    ax, ay = c * start_x + s * start_y, c * start_y - s * start_x  # in the robot's frame
    bx, by = c * end_x + s * end_y, c * end_y - s * end_x
    wall_x, wall_y = bx - ax, by - ay
    area = ax * wall_y - ay * wall_x
    if area == 0.0:
        return  # parallel to the line of sight
    if area < 0.0:  # so that beams go counter-clockwise from the start to the end
        ax, ay, bx, by = bx, by, ax, ay
        wall_x, wall_y, area = -wall_x, -wall_y, -area
    width = math.atan2(area, ax * bx + ay * by)  # more exact than a difference of angles for a wall seen end-on
    first = _first_beam(lidar, math.atan2(ay, ax))
    count = int(width / lidar.angle_step) + 2
    k = _cover(found, covered, first, count + 1) - 1
    for n in range(count + 1):
        k = k + 1 if k < len(found) - 1 else 0
        ray_x, ray_y = lidar.beams_x[k], lidar.beams_y[k]
        across = ray_x * wall_y - ray_y * wall_x
        if across <= 0.0:
            continue
        if n <= 1 or n >= count - 1:  # the beams at the ends may pass by
            along = (ax * ray_y - ay * ray_x) / across
            if along < -_END or along > 1.0 + _END:
                continue
        found[k] = min(found[k], area / across)


@jittable
def _meet_box(
    scene: Scene,
    to_x: float,
    to_y: float,
    box_c: float,
    box_s: float,
    c: float,
    s: float,
    found: Floats,
    covered: Flags,
) -> None:
    """Shorten beams that meet the body of another robot at (to_x, to_y) from the robot's centre."""
    along_x, along_y = scene.half_length * box_c, scene.half_length * box_s
    aside_x, aside_y = -scene.half_width * box_s, scene.half_width * box_c
    for side in range(4):
        # The four corners in turn: (+, -), (+, +), (-, +), (-, -).
        u = 1.0 if side < 2 else -1.0
        v = 1.0 if 1 <= side <= 2 else -1.0
        next_u = 1.0 if side % 3 == 0 else -1.0
        next_v = 1.0 if side < 2 else -1.0
        start_x, start_y = to_x + u * along_x + v * aside_x, to_y + u * along_y + v * aside_y
        end_x, end_y = to_x + next_u * along_x + next_v * aside_x, to_y + next_u * along_y + next_v * aside_y
        if start_x * end_y < start_y * end_x:  # this side faces the robot
            _meet_wall(scene.lidar, start_x, start_y, end_x, end_y, c, s, found, covered)


@jittable
def _meet_disc(
    lidar: Lidar, to_x: float, to_y: float, radius: float, c: float, s: float, found: Floats, covered: Flags
) -> None:
    """Shorten beams that meet a disc at (to_x, to_y) from the robot's centre."""
    x, y = c * to_x + s * to_y, c * to_y - s * to_x  # in the robot's frame
    away = math.sqrt(x * x + y * y)
    if away <= radius:
        return
    half = math.asin(radius / away)
    first = _first_beam(lidar, math.atan2(y, x) - half)
    count = int(2.0 * half / lidar.angle_step) + 2
    k = _cover(found, covered, first, count + 1) - 1
    for _ in range(count + 1):
        k = k + 1 if k < len(found) - 1 else 0
        ray_x, ray_y = lidar.beams_x[k], lidar.beams_y[k]
        past = x * ray_y - y * ray_x
        half_chord = radius * radius - past * past
        ahead = x * ray_x + y * ray_y
        if half_chord >= 0.0 and ahead > 0.0:
            found[k] = min(found[k], ahead - math.sqrt(half_chord))


@jittable
def cast_beam(scene: Scene, poses: Floats, i: int, ray_x: float, ray_y: float) -> float:
    """Distance [m] from robot i's centre to what one beam meets; infinity if it meets nothing.

    Args:
        scene: The arena and the robots.
        poses: (robots, 3 or more) x, y [m], heading [rad], at the time of the beam.
        i: Which robot.
        ray_x: Unit vector of the beam in the world's frame.
        ray_y: The same.
    """
    lidar, x, y = scene.lidar, poses[i, 0], poses[i, 1]
    outlines, nearest = lidar.outlines, math.inf
    for w in range(len(outlines)):
        to_x, to_y = outlines[w, 0] - x, outlines[w, 1] - y
        nearest = min(nearest, meets_side(to_x, to_y, outlines[w, 2], outlines[w, 3], ray_x, ray_y))
    radius = scene.corner if lidar.sees_bodies else lidar.head
    for j in range(len(poses)):
        from_x, from_y = x - poses[j, 0], y - poses[j, 1]
        if j == i or radius == 0.0 or abs(from_x * ray_y - from_y * ray_x) > radius:
            continue
        if lidar.sees_bodies and not scene.round:
            c, s = math.cos(poses[j, 2]), math.sin(poses[j, 2])
            found = distance_to_box(
                c * from_x + s * from_y,
                c * from_y - s * from_x,
                c * ray_x + s * ray_y,
                c * ray_y - s * ray_x,
                scene.half_length,
                scene.half_width,
            )
        else:
            found = distance_to_disc(from_x, from_y, ray_x, ray_y, radius)
        nearest = min(nearest, found)
    return nearest
