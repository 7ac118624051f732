"""What a robot perceives in a control cycle, with the senses that are read. Kernels."""

import math

import numpy as np

from mercator_design.arrays import Floats, Numbers
from mercator_design.jit import jittable
from mercator_design.missions.floor_kernels import colour_at
from mercator_design.modules.clustering import neighbours_in_hits
from mercator_design.modules.perception import (
    gray_level,
    ground_by_vote,
    light_direction,
    nearest_label,
    perceive,
    proximity_weight,
)
from mercator_design.modules.reference import Readings, ReferenceModel, first_reading, sense_number, senses_bits
from mercator_design.sim.kernels.lidar import scan_near
from mercator_design.sim.kernels.noise import (
    DRIFT_CONSTANTS_DRAWS,
    DRIFT_DRAWS,
    GROUND_DRAWS,
    IMU_DRAWS,
    LIGHT_ANGLE_DRAWS,
    LIGHT_DRAWS,
    LOCATOR_DRAWS,
    NEIGHBOURS_ANGLE_DRAWS,
    NEIGHBOURS_DRAWS,
    NEIGHBOURS_LOSS_DRAWS,
    NO_NOISE,
    PROXIMITY_DRAWS,
    PROXIMITY_WEIGHT_DRAWS,
    draw,
    noise,
    standard,
)
from mercator_design.sim.kernels.scene import Scene
from mercator_design.sim.kernels.sight import cast, is_hidden, is_lit
from mercator_design.sim.kernels.swarm import Swarm

_PROXIMITY, _NEIGHBOURS, _GROUND, _LIGHT = (
    senses_bits({sense}) for sense in ("proximity", "neighbours", "ground", "light")
)
_HEADING, _ODOMETRY = (senses_bits({sense}) for sense in ("heading", "odometry"))
_RANGES, _LIGHTS, _GROUNDS = (senses_bits({sense}) for sense in ("ranges", "lights", "grounds"))
_HEADING_AT, _ODOMETRY_AT = map(first_reading, ("heading", "odometry"))
_RANGES_AT, _LIGHTS_AT, _GROUNDS_AT = map(first_reading, ("ranges", "lights", "grounds"))
_IMU, _LOCATOR = map(sense_number, ("heading", "odometry"))
_NEUTRAL = tuple(Readings())
_TURN = 2.0 * math.pi
_MAX_DEVIATIONS = 8.0  # by which noise shortens a reading; larger ones occur once in 10^15 readings


@jittable
def sense(scene: Scene, model: ReferenceModel, swarm: Swarm, cycle: int, i: int, senses: int) -> Readings:
    """The readings of robot i with some of its senses (bits of modules.SENSES); the other readings are neutral."""
    has = senses & scene.senses
    row = swarm.readings
    for k in range(len(row)):
        row[k] = _NEUTRAL[k]
    if has & (_PROXIMITY | _RANGES):
        sense_obstacles(scene, model, swarm, cycle, i)
    if has & _RANGES:
        _fill_in_order(row, _RANGES_AT, swarm.proximity, scene.proximity.order)
    if not has & _PROXIMITY:
        for k in range(len(swarm.proximity)):
            swarm.proximity[k] = 0.0
    n = 0
    count = 0.0
    if has & _NEIGHBOURS:
        if scene.neighbours.by_lidar:
            n = sense_heads(scene, model, swarm, cycle, i)
            count = float(n)
        else:
            n, count = sense_robots(scene, model, swarm, cycle, i)
    if has & (_GROUND | _GROUNDS):
        _sense_ground(scene, model, swarm, cycle, i)
    if has & _GROUNDS:
        _fill_in_order(row, _GROUNDS_AT, swarm.levels, scene.ground.order)
    if not has & _GROUND:
        for k in range(3):
            swarm.ground[k] = 255.0
    light = (0.0, 0.0)
    if has & (_LIGHT | _LIGHTS):
        light = sense_light(scene, model, swarm, cycle, i)
    if has & _LIGHTS:
        _fill_in_order(row, _LIGHTS_AT, swarm.light, scene.light.order)
    if not has & _LIGHT:
        light = (0.0, 0.0)
    if has & _HEADING:
        row[_HEADING_AT] = sense_heading(scene, swarm, cycle, i)
    if has & _ODOMETRY:
        row[_ODOMETRY_AT], row[_ODOMETRY_AT + 1] = sense_place(scene, swarm, cycle, i)
    return perceive(
        model,
        swarm.proximity,
        scene.proximity.counts_x,
        scene.proximity.counts_y,
        swarm.distances,
        swarm.bearings_x,
        swarm.bearings_y,
        n,
        count,
        swarm.ground,
        light,
        row,
    )


@jittable
def _fill_in_order(row: Floats, first: int, found: Floats, order: Numbers) -> None:
    """Fill in readings from a place on: those of sensors in their order."""
    for k in range(len(order)):
        row[first + k] = found[order[k]]


@jittable
def sense_heading(scene: Scene, swarm: Swarm, cycle: int, i: int) -> float:
    """The heading of robot i by its IMU, which measures pitch, roll and yaw, counted from that at the start."""
    yaw = math.atan2(swarm.poses[i, 4], swarm.poses[i, 3])
    if scene.motion.drifts:
        yaw = math.atan2(math.sin(yaw + swarm.odometry[i, 2]), math.cos(yaw + swarm.odometry[i, 2]))
    turned = _measured(scene, swarm, i, _IMU, yaw, IMU_DRAWS, 3 * cycle + 2) - swarm.starts[i, 2]
    return math.atan2(math.sin(turned), math.cos(turned))


@jittable
def sense_place(scene: Scene, swarm: Swarm, cycle: int, i: int) -> tuple[float, float]:
    """The place of robot i by its locator, along the axes that the robot had at the start."""
    x, y = swarm.poses[i, 0] - swarm.starts[i, 0], swarm.poses[i, 1] - swarm.starts[i, 1]
    if scene.motion.drifts:
        x, y = swarm.odometry[i, 0], swarm.odometry[i, 1]
    x = _measured(scene, swarm, i, _LOCATOR, x, LOCATOR_DRAWS, 2 * cycle)
    y = _measured(scene, swarm, i, _LOCATOR, y, LOCATOR_DRAWS, 2 * cycle + 1)
    c, s = swarm.starts[i, 3], swarm.starts[i, 4]
    return c * x + s * y, c * y - s * x


@jittable
def _measured(scene: Scene, swarm: Swarm, i: int, sense: int, value: float, draws: int, number: int) -> float:
    """The reading of a sensor of robot i's own motion, given the true value, the sense and a number of its draws."""
    value += noise(scene.motion.noise[sense], swarm.noise_keys[i], draws, number)
    low: float = scene.motion.bounds[sense, 0]
    high: float = scene.motion.bounds[sense, 1]
    return max(low, min(high, value))


@jittable
def sense_obstacles(scene: Scene, model: ReferenceModel, swarm: Swarm, cycle: int, i: int) -> None:
    """Fill in the weights of the readings of robot i's proximity sensors; finite distances have noise."""
    seen = swarm.proximity
    sensors, key = len(seen), swarm.noise_keys[i]
    row, weight_row = scene.proximity.noise, scene.proximity.weight_noise
    nearest, reach = scene.proximity.nearest, scene.proximity.furthest
    if row[0] == NO_NOISE:
        reach = min(reach, model.proximity_range)  # with noise, farther objects may matter
    cast(scene, swarm.poses, i, reach, seen)
    for k in range(sensors):
        if seen[k] > reach:
            seen[k] = math.inf
        elif seen[k] < nearest:
            seen[k] = -math.inf
        elif row[0] != NO_NOISE:
            seen[k] = max(0.0, seen[k] + noise(row, key, PROXIMITY_DRAWS, cycle * sensors + k))
        seen[k] = proximity_weight(model, seen[k])
        if weight_row[0] != NO_NOISE:
            disturbed = seen[k] + noise(weight_row, key, PROXIMITY_WEIGHT_DRAWS, cycle * sensors + k)
            seen[k] = max(0.0, min(1.0, disturbed))


@jittable
def sense_heads(scene: Scene, model: ReferenceModel, swarm: Swarm, cycle: int, i: int) -> int:
    """Fill in the neighbours that robot i perceives as clusters of lidar readings; return their number."""
    lidar = scene.lidar
    # Readings beyond neighbour_range are in no cluster, but noise may shorten a reading slightly beyond.
    reach = model.neighbour_range + abs(lidar.noise[1]) + _MAX_DEVIATIONS * lidar.noise[2]
    key, found, hits = swarm.noise_keys[i], swarm.scan, swarm.hits
    n_hits = scan_near(scene, swarm.poses, i, key, cycle, reach, found, hits, swarm.covered)
    angle, step = lidar.first_angle, lidar.angle_step
    return neighbours_in_hits(
        model, found, hits, n_hits, angle, step, swarm.distances, swarm.bearings_x, swarm.bearings_y
    )


@jittable
def sense_robots(scene: Scene, model: ReferenceModel, swarm: Swarm, cycle: int, i: int) -> tuple[int, float]:
    """Fill in the neighbours that robot i perceives with its camera; return the number of rows, and of neighbours."""
    poses, camera = swarm.poses, scene.neighbours
    x, y, c, s = poses[i, 0], poses[i, 1], poses[i, 3], poses[i, 4]
    robots = len(poses)
    noisy = camera.noise[0] != NO_NOISE
    slots = swarm.heard.shape[2]
    remembers = len(swarm.heard) > 0
    in_range = model.neighbour_range * model.neighbour_range
    seen = camera.range * camera.range
    near = seen if noisy else min(seen, in_range)
    n = 0
    count = 0.0
    for j in range(robots):
        if j == i:
            continue
        to_x = poses[j, 0] - x
        to_y = poses[j, 1] - y
        squared = to_x * to_x + to_y * to_y
        perceived = 0.0 < squared < near
        if not perceived and not remembers:
            continue  # the usual case in a large swarm
        number = cycle * robots + j
        perceived = (
            perceived
            and (camera.loss == 0.0 or draw(swarm.noise_keys[i], NEIGHBOURS_LOSS_DRAWS, number) >= camera.loss)
            and not (
                camera.occlusion
                and is_hidden(scene, poses, i, j, (x, y, camera.height), (poses[j, 0], poses[j, 1], camera.height))
            )
        )
        ahead = c * to_x + s * to_y
        aside = c * to_y - s * to_x
        if perceived and noisy:
            size = math.sqrt(squared) * noise(camera.noise, swarm.noise_keys[i], NEIGHBOURS_DRAWS, number)
            angle = _TURN * draw(swarm.noise_keys[i], NEIGHBOURS_ANGLE_DRAWS, number)
            ahead += size * math.cos(angle)
            aside += size * math.sin(angle)
            squared = ahead * ahead + aside * aside
            perceived = 0.0 < squared < in_range
        if remembers:
            slot = cycle % slots
            swarm.heard[i, j, slot, 0] = 1.0 if perceived else 0.0
            swarm.heard[i, j, slot, 1] = ahead
            swarm.heard[i, j, slot, 2] = aside
            n, counts = _recall(model, swarm, i, j, cycle, n)
            count += counts
        elif perceived:
            _note_neighbour(swarm, n, ahead, aside)
            n += 1
            count += 1.0
    return n, count


@jittable
def _recall(model: ReferenceModel, swarm: Swarm, i: int, j: int, cycle: int, n: int) -> tuple[int, float]:
    """Add rows from n on for the recent perceptions of robot j by robot i; return the rows, and 1 if j counts."""
    slots = swarm.heard.shape[2]
    counts = 0.0
    pulls = True
    for age in range(slots):
        slot = (cycle - age) % slots
        if swarm.heard[i, j, slot, 0] == 0.0:
            continue
        if age <= model.neighbour_count_memory:
            counts = 1.0
        if age <= model.neighbour_memory and pulls:
            _note_neighbour(swarm, n, swarm.heard[i, j, slot, 1], swarm.heard[i, j, slot, 2])
            n += 1
            pulls = model.neighbour_repeats != 0.0
    return n, counts


@jittable
def _note_neighbour(swarm: Swarm, n: int, ahead: float, aside: float) -> None:
    distance = math.sqrt(ahead * ahead + aside * aside)
    swarm.distances[n] = distance
    swarm.bearings_x[n] = ahead / distance
    swarm.bearings_y[n] = aside / distance


@jittable
def _sense_ground(scene: Scene, model: ReferenceModel, swarm: Swarm, cycle: int, i: int) -> None:
    """Fill in the colour of the ground under robot i: the mean of its sensors, its label, or the result of a vote."""
    sensors, ground, labels = len(scene.ground.places), swarm.ground, scene.ground.labels
    if sensors == 0:
        for channel in range(3):
            ground[channel] = 255.0
        return
    for channel in range(3):
        ground[channel] = 0.0
    blacks, whites = 0.0, 0.0
    for k in range(sensors):
        red, green, blue = ground_under(scene, swarm, cycle, i, k)
        level = gray_level(red, green, blue)
        swarm.levels[k] = level
        blacks += 1.0 if level < model.ground_vote_black else 0.0
        whites += 1.0 if level > model.ground_vote_white else 0.0
        ground[0] += red / sensors
        ground[1] += green / sensors
        ground[2] += blue / sensors
    if len(labels) > 0:
        label = nearest_label(labels, ground[0], ground[1], ground[2])
        for channel in range(3):
            ground[channel] = labels[3 * label + channel]
    ages = swarm.votes.shape[1]
    if ages > 0:
        swarm.votes[i, cycle % ages, 0] = blacks
        swarm.votes[i, cycle % ages, 1] = whites
        for age in range(1, ages):
            blacks += swarm.votes[i, (cycle + age) % ages, 0]
            whites += swarm.votes[i, (cycle + age) % ages, 1]
        level = ground_by_vote(model, blacks, whites)
        for channel in range(3):
            ground[channel] = level


@jittable
def ground_under(scene: Scene, swarm: Swarm, cycle: int, i: int, k: int) -> tuple[float, float, float]:
    """Red, green, blue of ground sensor k of robot i; all are the brightness if the sensor is gray."""
    row, key = scene.ground.noise, swarm.noise_keys[i]
    x, y, c, s = swarm.poses[i, 0], swarm.poses[i, 1], swarm.poses[i, 3], swarm.poses[i, 4]
    ahead, aside = scene.ground.places[k, 0], scene.ground.places[k, 1]
    red, green, blue = colour_at(scene.floor, x + c * ahead - s * aside, y + s * ahead + c * aside)
    number = 3 * (cycle * len(scene.ground.places) + k)
    if scene.ground.gray:
        level = max(0.0, min(255.0, gray_level(red, green, blue) + noise(row, key, GROUND_DRAWS, number)))
        return level, level, level
    if row[0] == NO_NOISE:
        return red, green, blue
    return (
        _channel(red + noise(row, key, GROUND_DRAWS, number)),
        _channel(green + noise(row, key, GROUND_DRAWS, number + 1)),
        _channel(blue + noise(row, key, GROUND_DRAWS, number + 2)),
    )


@jittable
def sense_light(scene: Scene, model: ReferenceModel, swarm: Swarm, cycle: int, i: int) -> tuple[float, float]:
    """Unit vector towards the lights that robot i perceives, forwards and to the left; zero if there is none."""
    poses, light, readings = swarm.poses, scene.light, swarm.light
    x, y, c, s = poses[i, 0], poses[i, 1], poses[i, 3], poses[i, 4]
    sensors, lights = len(readings), len(light.lights)
    key = swarm.noise_keys[i]
    for k in range(sensors):
        readings[k] = 0.0
    sum_x = 0.0
    sum_y = 0.0
    for n in range(lights):
        if not light.seen[n, i] or not is_lit(scene, poses, i, n, (x, y, light.height), light.range, light.occlusion):
            continue
        to_x, to_y = light.lights[n, 0] - x, light.lights[n, 1] - y
        ahead = c * to_x + s * to_y
        aside = c * to_y - s * to_x
        if light.by_camera:
            if light.noise[0] != NO_NOISE:
                away = math.sqrt(ahead * ahead + aside * aside)
                size = away * noise(light.noise, key, LIGHT_DRAWS, cycle * lights + n)
                angle = _TURN * draw(key, LIGHT_ANGLE_DRAWS, cycle * lights + n)
                ahead += size * math.cos(angle)
                aside += size * math.sin(angle)
            sum_x += ahead
            sum_y += aside
        else:
            rise = light.lights[n, 2] - light.height
            away = math.sqrt(to_x * to_x + to_y * to_y + rise * rise) / light.lights[n, 3]
            if away <= light.reach:
                towards = math.atan2(aside, ahead)
                for k in range(sensors):
                    off = abs((towards - light.angles[k] + math.pi) % _TURN - math.pi)
                    readings[k] += math.exp(-light.decay * away) * max(0.0, 1.0 - 2.0 * off / math.pi)
    if light.by_camera:
        length = math.sqrt(sum_x * sum_x + sum_y * sum_y)
        return (sum_x / length, sum_y / length) if length > 0.0 else (0.0, 0.0)
    for k in range(sensors):
        if light.noise[0] != NO_NOISE:
            readings[k] += noise(light.noise, key, LIGHT_DRAWS, cycle * sensors + k)
        readings[k] = max(0.0, min(1.0, readings[k]))
    return light_direction(model, readings, light.directions_x, light.directions_y)


@jittable
def _channel(value: float) -> float:
    """The reading of a colour sensor: a whole number from 0 to 255."""
    return max(0.0, min(255.0, float(math.floor(value + 0.5))))


@jittable
def drift(scene: Scene, before: Floats, after: Floats, key: np.uint64, cycle: int, i: int, odometry: Floats) -> None:
    """Add what robot i measures of its motion in a cycle: the way, and how much farther the yaw is off.

    Args:
        scene: With `motion.drift`.
        before: (robots, 3 or more) poses at the beginning of the cycle.
        after: The same at its end.
        key: Key of the robot's stream of noise.
        cycle: Number of the control cycle.
        i: Which robot.
        odometry: (robots, 3) changed: measured x, y [m] against the start along the world's axes, error of the yaw
            [rad].
    """
    laws = scene.motion.drift
    x, y, turned = after[i, 0] - before[i, 0], after[i, 1] - before[i, 1], after[i, 2] - before[i, 2]
    scale = laws.least_scale + (laws.most_scale - laws.least_scale) * draw(key, DRIFT_CONSTANTS_DRAWS, 0)
    scale = 1.0 + (scale if draw(key, DRIFT_CONSTANTS_DRAWS, 1) < 0.5 else -scale)
    variance = laws.by_way * laws.by_way * math.sqrt(x * x + y * y) + laws.by_turn * laws.by_turn * abs(turned)
    error = laws.bias * standard(key, DRIFT_CONSTANTS_DRAWS, 2) * scene.control_period
    error += math.sqrt(variance) * standard(key, DRIFT_DRAWS, cycle)
    yaw = odometry[i, 2] + 0.5 * error
    odometry[i, 0] += scale * (math.cos(yaw) * x - math.sin(yaw) * y)
    odometry[i, 1] += scale * (math.sin(yaw) * x + math.cos(yaw) * y)
    odometry[i, 2] += error
