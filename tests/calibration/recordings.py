"""Recordings of a robot at rest whose noise is known, without a robot."""

import math

import numpy as np

from mercator_design.robot.devices.samples import STANDARD_GRAVITY
from mercator_design.robot.logs.events import FORMAT
from mercator_design.robot.logs.log import plain, to_lines
from mercator_design.robot.protocols.ydlidar import correction

BEAMS = 120


def gaussian(sd):
    return lambda random, n: random.normal(0.0, sd, n)


def uniform(half_width):
    return lambda random, n: random.uniform(-half_width, half_width, n)


NOISE = {
    "proximity": gaussian(0.03),
    "ground": gaussian(5.0),
    "lidar": uniform(0.005),
    "ambient_light": gaussian(3.0),
    "velocity": uniform(0.01),
    "acceleration": gaussian(0.02 * STANDARD_GRAVITY),
    "turning": gaussian(0.004),
    "attitude": uniform(0.002),
    "position": gaussian(0.001),
    "orientation": gaussian(0.003),
}
"""By sensor, in the units of recordings."""

CENTRES = {
    "proximity": [0.3, 0.5, 0.7, 0.9, 1.1, 1.3, 1.5, 1.7],
    "ground": [100.0, 120.0, 140.0],
    "lidar": [1.5] * BEAMS,
    "ambient_light": [400.0],
    "velocity": [0.0, 0.0],
    "acceleration": [0.0, 0.0, STANDARD_GRAVITY],
    "turning": [0.01, 0.0, -0.01],
    "attitude": [0.01, -0.02, 0.0],
    "position": [0.0, 0.0],
    "orientation": [0.9, 0.3, 0.3, 0.1],
}
STEPS = {"proximity": 1e-3, "ground": 1.0, "lidar": 0.25e-3}
RATES = {"proximity": 6.0, "lidar": 7.0}


def measured(seconds=30.0, seed=1, noise=NOISE, centres=CENTRES):
    """By sensor: times, and values as recordings have them."""
    random = np.random.default_rng(seed)
    found = {}
    for sensor, levels in centres.items():
        n = round(seconds * RATES.get(sensor, 20.0))
        values = np.array(levels) + noise[sensor](random, (n, len(levels)))
        if step := STEPS.get(sensor):
            values = step * np.rint(values / step)
        found[sensor] = np.arange(n) / RATES.get(sensor, 20.0), values
    return found


def turn(ranges, front=0.0):
    """Readings of a turn: clockwise from the lidar's front, and where the decoder's correction has them."""
    raw = front - np.arange(len(ranges)) * math.tau / len(ranges)
    angles = [
        round((angle + (correction(r) if r > 0.0 else 0.0)) % math.tau, 5) for angle, r in zip(raw, ranges, strict=True)
    ]
    return [[angle, round(float(r), 5)] for angle, r in zip(angles, ranges, strict=True)]


def write(path, found, **start):
    """The recording of what was measured."""
    begin = {
        "event": "start",
        "kind": "recording",
        "format": FORMAT,
        "version": "0.1.0",
        "robot": "tester",
        "time": "2026-01-01T12:00:00+00:00",
        "lidar_angle": 0.0,
        **start,
    }
    events = []
    for sensor, (times, values) in found.items():
        for time, row in zip(times.tolist(), values.tolist(), strict=True):
            event = {"time": round(time, 4)}
            if sensor == "lidar":
                event |= {"event": "turn", "readings": turn(row, begin["lidar_angle"])}
            elif sensor == "wheels":
                event |= {"event": "wheels", "left": row[0], "right": row[1]}
            else:
                event |= {"event": "sample", "sensor": sensor, "values": [*map(plain, row)]}
            events.append(event)
    events.sort(key=lambda event: event["time"])
    events = [begin, *events, {"event": "end", "why": "The duration is over"}]
    path.write_text("".join(to_lines(events)))
    return path
