"""Measurements of the RVR and the hub in SI units: x forwards, y to the left, z up; metres, radians, seconds."""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

from mercator_design.robot.devices.link import Event
from mercator_design.robot.protocols.multiflex import Distances
from mercator_design.robot.protocols.rvr_streaming import StreamData

STANDARD_GRAVITY = 9.80665
"""[m/s2] One g of the accelerometer of the RVR."""


FIELDS: Mapping[str, tuple[str, ...]] = {
    "acceleration": ("x", "y", "z"),  # [m/s2]
    "turning": ("x", "y", "z"),  # [rad/s]
    "attitude": ("roll", "pitch", "yaw"),  # [rad]
    "orientation": ("w", "x", "y", "z"),
    "position": ("x", "y"),  # [m] along the axes at the start
    "velocity": ("x", "y"),  # [m/s] along the axes at the start
    "ground": ("red", "green", "blue"),  # 0 to 255
    "ambient_light": ("lux",),
    "proximity": tuple(f"distance_{k}" for k in range(8)),  # [m], in the hub's order
}
"""The sensors by name, and the values of their samples.

A distance is inf where nothing is in sight, -inf where something is too near.
"""


class Sample(NamedTuple):
    """The values of a sensor, and the time [s] when they came."""

    time: float
    values: tuple[float, ...]


def _turned(values: Mapping[str, float], scale: float = 1.0) -> tuple[float, ...]:
    """Turn a vector of the RVR, whose x is to the right and y forwards, with z if it has one. No zero is negative."""
    return (scale * values["y"], 0.0 - scale * values["x"], *(scale * values[axis] for axis in "z" if axis in values))


_CONVERT: Mapping[str, tuple[str, Callable[[Mapping[str, float]], tuple[float, ...]]]] = {
    "accelerometer": ("acceleration", lambda v: _turned(v, STANDARD_GRAVITY)),
    "gyroscope": ("turning", lambda v: _turned(v, math.pi / 180.0)),
    "imu": ("attitude", lambda v: (math.radians(v["roll"]), 0.0 - math.radians(v["pitch"]), math.radians(v["yaw"]))),
    "quaternion": ("orientation", lambda v: (v["w"], *_turned(v))),
    "locator": ("position", _turned),
    "velocity": ("velocity", _turned),
    "color_detection": ("ground", lambda v: (v["r"], v["g"], v["b"])),
    "ambient_light": ("ambient_light", lambda v: (v["light"],)),
}

STREAMED = tuple(_CONVERT)
"""The services of the RVR that are sensors."""
SERVICE_OF: Mapping[str, str] = {name: service for service, (name, _) in _CONVERT.items()}
"""The service of each sensor of the RVR, by a name of `FIELDS`."""
_MAX_TURNING_AGE = 0.5  # [s] between an attitude and a rate of turning that still tells how it goes on


def converted(event: Event) -> Iterator[tuple[str, tuple[float, ...]]]:
    """The values of each sample in an event, behind a name of FIELDS; most events have none."""
    match event:
        case StreamData(is_valid=True):
            for service, values in event.values.items():
                name, convert = _CONVERT[service]
                yield name, convert(values)
        case Distances():
            metres = event.metres()
            if not any(map(math.isnan, metres)):  # without one sensor the robot is blind on that side
                yield "proximity", tuple(metres)


def invalid(event: Event) -> tuple[str, ...]:
    """The sensors whose samples in an event are invalid, as the RVR says, by names of `FIELDS`."""
    match event:
        case StreamData(is_valid=False):
            return tuple(_CONVERT[service][0] for service in event.values)
    return ()


def heading(latest: Mapping[str, Sample], time: float) -> float:
    """The robot's heading [rad] at a time [s] close to that of its latest attitude; 0 before the first sample.

    An RVR may stream no gyroscope; then it is that of the latest attitude.
    """
    if "attitude" not in latest:
        return 0.0
    came, (_, _, yaw) = latest["attitude"]
    if "turning" not in latest or came - latest["turning"].time > _MAX_TURNING_AGE:
        return yaw
    _, (_, _, turning) = latest["turning"]
    return yaw + turning * (time - came)
