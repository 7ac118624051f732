"""Kernels that compute the measurements of devices from the poses of all robots in many cycles.

Poses have the shape (cycles, robots, 5): x, y [m], heading [rad], its cosine and its sine. Each function fills
the array that is its last argument, with one row for each requested cycle.
"""

import math

from mercator_design.arrays import Floats, Keys, Numbers
from mercator_design.jit import jittable
from mercator_design.missions.dynamics import change_floor
from mercator_design.modules.clustering import neighbours_in_hits
from mercator_design.modules.reference import ReferenceModel, sense_number
from mercator_design.sim.kernels.lidar import cast_beam, scan
from mercator_design.sim.kernels.noise import (
    NO_NOISE,
    ODOMETRY_DRAWS,
    ODOMETRY_TIME_DRAWS,
    TURN_DRAWS,
    TURN_LOSS_DRAWS,
    TURN_PHASE_DRAWS,
    draw,
    noise,
)
from mercator_design.sim.kernels.scene import Scene
from mercator_design.sim.kernels.sensing import drift, ground_under, sense_light, sense_obstacles, sense_robots
from mercator_design.sim.kernels.sight import cast, is_lit
from mercator_design.sim.kernels.swarm import Swarm

_IMU, _LOCATOR = map(sense_number, ("heading", "odometry"))


def add_noise(row: Floats, keys: Keys, number: int, cycles: Numbers, values: Floats) -> None:
    """Add the noise of one device to values (cycles, robots, n)."""
    per_cycle = values.shape[2]
    for n in range(len(cycles)):
        for i in range(values.shape[1]):
            for k in range(per_cycle):
                values[n, i, k] += noise(row, keys[i], number, cycles[n] * per_cycle + k)


def fill_directions(poses: Floats) -> None:
    """Cosine and sine of the headings."""
    for n in range(len(poses)):
        for i in range(poses.shape[1]):
            poses[n, i, 3] = math.cos(poses[n, i, 2])  # numpy's differs in the last bit
            poses[n, i, 4] = math.sin(poses[n, i, 2])


@jittable
def _put(swarm: Swarm, poses: Floats, n: int) -> None:
    """Move the swarm to row n of the poses."""
    for i in range(poses.shape[1]):
        for k in range(poses.shape[2]):
            swarm.poses[i, k] = poses[n, i, k]


def fill_ground(scene: Scene, swarm: Swarm, poses: Floats, cycles: Numbers, found: Floats) -> None:
    """Raw colours (cycles, robots, sensors, 3) under the ground sensors, from 0 to 255."""
    n = 0
    for cycle in range(len(poses)):
        change_floor(scene.floor, poses[cycle], (cycle + 1) * scene.control_period)
        if cycle != cycles[n]:
            continue
        _put(swarm, poses, cycle)
        for i in range(poses.shape[1]):
            for k in range(found.shape[2]):
                red, green, blue = ground_under(scene, swarm, cycle, i, k)
                found[n, i, k, 0] = red
                found[n, i, k, 1] = green
                found[n, i, k, 2] = blue
        n += 1


def fill_places(
    scene: Scene, model: ReferenceModel, swarm: Swarm, poses: Floats, cycles: Numbers, found: Floats
) -> None:
    """Distance [m] and bearing [rad] of each robot's neighbours (cycles, robots, robots, 2)."""
    for n in range(len(cycles)):
        _put(swarm, poses, n)
        for i in range(poses.shape[1]):
            sense_robots(scene, model, swarm, cycles[n], i)
            for j in range(poses.shape[1]):
                ahead, aside = swarm.heard[i, j, 0, 1], swarm.heard[i, j, 0, 2]
                if swarm.heard[i, j, 0, 0] != 0.0:
                    found[n, i, j, 0] = math.sqrt(ahead * ahead + aside * aside)
                    found[n, i, j, 1] = math.atan2(aside, ahead)


def fill_clusters(scene: Scene, model: ReferenceModel, swarm: Swarm, scans: Floats, found: Floats) -> None:
    """Distance [m] and bearing [rad] of the clusters that a lidar takes as neighbours (cycles, robots, clusters, 2)."""
    first, step, beams = scene.lidar.first_angle, scene.lidar.angle_step, scans.shape[2]
    for k in range(beams):
        swarm.hits[k] = k
    for n in range(len(scans)):
        for i in range(scans.shape[1]):
            for k in range(beams):
                swarm.scan[k] = scans[n, i, k]
            clusters = neighbours_in_hits(
                model, swarm.scan, swarm.hits, beams, first, step, swarm.distances, swarm.bearings_x, swarm.bearings_y
            )
            for k in range(clusters):
                found[n, i, k, 0] = swarm.distances[k]
                found[n, i, k, 1] = math.atan2(swarm.bearings_y[k], swarm.bearings_x[k])


def fill_ring(
    scene: Scene, model: ReferenceModel, swarm: Swarm, poses: Floats, cycles: Numbers, of_light: bool, found: Floats
) -> None:
    """The reading of each light sensor, or the weight of each proximity sensor's (cycles, robots, sensors)."""
    for n in range(len(cycles)):
        _put(swarm, poses, n)
        for i in range(poses.shape[1]):
            if of_light:
                sense_light(scene, model, swarm, cycles[n], i)
            else:
                sense_obstacles(scene, model, swarm, cycles[n], i)
            for k in range(found.shape[2]):
                found[n, i, k] = swarm.light[k] if of_light else swarm.proximity[k]


def fill_lux(
    scene: Scene, poses: Floats, ahead: float, aside: float, law: tuple[float, float, float, float], found: Floats
) -> None:
    """Light [lux] at a sensor that looks up (cycles, robots, 1); `law` is its height, base, decay and reach."""
    height, base, decay, reach = law
    lights = scene.light.lights
    for n in range(len(poses)):
        for i in range(poses.shape[1]):
            c, s = poses[n, i, 3], poses[n, i, 4]
            x = poses[n, i, 0] + c * ahead - s * aside
            y = poses[n, i, 1] + s * ahead + c * aside
            for k in range(len(lights)):
                to_x, to_y, rise = lights[k, 0] - x, lights[k, 1] - y, lights[k, 2] - height
                away = math.sqrt(to_x * to_x + to_y * to_y + rise * rise) / lights[k, 3]
                if (
                    away <= reach
                    and scene.light.lit[k, i]
                    and is_lit(scene, poses[n], i, k, (x, y, height), math.inf, True)
                ):
                    found[n, i, 0] += base + math.exp(-decay * away)


def fill_proximity(scene: Scene, poses: Floats, furthest: float, found: Floats) -> None:
    """Distances [m] of the proximity sensors (cycles, robots, sensors)."""
    for n in range(len(poses)):
        for i in range(poses.shape[1]):
            cast(scene, poses[n], i, furthest, found[n, i])


def fill_lidar(scene: Scene, swarm: Swarm, poses: Floats, cycles: Numbers, found: Floats) -> None:
    """Distances [m] of the lidar's beams (cycles, robots, beams)."""
    for n in range(len(poses)):
        for i in range(poses.shape[1]):
            scan(scene, poses[n], i, swarm.noise_keys[i], cycles[n], found[n, i], swarm.hits, swarm.covered)


def fill_turns(scene: Scene, poses: Floats, keys: Keys, scratch: Floats, starts: Floats, found: Floats) -> None:
    """Distances [m] in turns of the lidars (turns, robots, beams); 0 where nothing is in range.

    Each beam leaves at its own time, from where its robot then is, between the poses after two cycles.

    Args:
        scene: The arena and the robots.
        poses: (cycles + 1, robots, 3) from the start on.
        keys: (robots,) of streams of noise.
        scratch: (robots, 3).
        starts: (turns, robots) receives the times of the first beams [s].
        found: Receives the distances; beams in order of time, clockwise from the front.
    """
    lidar, beams, period = scene.lidar, found.shape[2], scene.control_period
    for i in range(found.shape[1]):
        phase = draw(keys[i], TURN_PHASE_DRAWS, 0)
        for n in range(len(found)):
            starts[n, i] = (n + phase) * lidar.turn
            for k in range(beams):
                place_at(poses, (starts[n, i] + k * lidar.turn / beams) / period, scratch)
                angle = scratch[i, 2] - 2.0 * math.pi * k / beams
                distance = cast_beam(scene, scratch, i, math.cos(angle), math.sin(angle)) - lidar.ring
                number = n * beams + k
                if lidar.loss > 0.0 and draw(keys[i], TURN_LOSS_DRAWS, number) < lidar.loss:
                    distance = math.inf
                if not lidar.nearest <= distance <= lidar.furthest:
                    distance = 0.0
                elif lidar.noise[0] != NO_NOISE:
                    disturbed = distance + noise(lidar.noise, keys[i], TURN_DRAWS, number)
                    distance = max(0.0, min(lidar.furthest, disturbed))
                found[n, i, k] = distance


@jittable
def place_at(poses: Floats, cycle: float, placed: Floats) -> None:
    """Poses (robots, 3) between those after cycles (cycles + 1, robots, 3), at a time that is counted in cycles."""
    row = max(0, min(len(poses) - 2, math.floor(cycle)))
    part = max(0.0, min(1.0, cycle - row))
    for i in range(len(placed)):
        for k in range(3):
            placed[i, k] = poses[row, i, k] + part * (poses[row + 1, i, k] - poses[row, i, k])


def fill_drift(scene: Scene, poses: Floats, keys: Keys, found: Floats) -> None:
    """Measured place against the start, along the world's axes, and error of the yaw (cycles + 1, robots, 3)."""
    for cycle in range(len(poses) - 1):
        for i in range(poses.shape[1]):
            for k in range(3):
                found[cycle + 1, i, k] = found[cycle, i, k]
            drift(scene, poses[cycle], poses[cycle + 1], keys[i], cycle, i, found[cycle + 1])


def fill_samples(
    scene: Scene,
    measured: Floats,
    keys: Keys,
    period: float,
    late: float,
    scratch: Floats,
    times: Floats,
    found: Floats,
) -> None:
    """Samples of measured poses, along the axes that each robot had at the start (samples, robots, 3).

    Args:
        scene: The robots.
        measured: (cycles + 1, robots, 3) poses along the world's axes.
        keys: (robots,) of streams of noise.
        period: [s] from one sample to the next.
        late: [s] by which a stamp is off at most.
        scratch: (robots, 3).
        times: (samples, robots) receives the stamps.
        found: Receives the poses, with noise.
    """
    for n in range(len(found)):
        place_at(measured, n * period / scene.control_period, scratch)
        for i in range(found.shape[1]):
            times[n, i] = n * period + late * (2.0 * draw(keys[i], ODOMETRY_TIME_DRAWS, n) - 1.0)
            c, s = math.cos(measured[0, i, 2]), math.sin(measured[0, i, 2])
            x = scratch[i, 0] - measured[0, i, 0]
            y = scratch[i, 1] - measured[0, i, 1]
            x += noise(scene.motion.noise[_LOCATOR], keys[i], ODOMETRY_DRAWS, 3 * n)
            y += noise(scene.motion.noise[_LOCATOR], keys[i], ODOMETRY_DRAWS, 3 * n + 1)
            found[n, i, 0] = c * x + s * y
            found[n, i, 1] = c * y - s * x
            found[n, i, 2] = scratch[i, 2] - measured[0, i, 2]
            found[n, i, 2] += noise(scene.motion.noise[_IMU], keys[i], ODOMETRY_DRAWS, 3 * n + 2)
