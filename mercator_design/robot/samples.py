"""What the RVR's sensors tell, converted: x forwards, y to the left, z up; metres, radians, seconds."""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

from mercator_design.robot.rvr_streaming import StreamData

_G = 9.80665  # [m/s2]


class Sample(NamedTuple):
    """What a sensor told, and when it came [s]."""

    time: float
    values: tuple[float, ...]


def _turned(values: Mapping[str, float], scale: float = 1.0) -> tuple[float, ...]:
    """A vector of the RVR, whose x is to the right and y forwards; z if it has one."""
    return (scale * values["y"], -scale * values["x"], *(scale * values[axis] for axis in "z" if axis in values))


_CONVERT: Mapping[str, tuple[str, Callable[[Mapping[str, float]], tuple[float, ...]]]] = {
    "accelerometer": ("acceleration", lambda v: _turned(v, _G)),
    "gyroscope": ("turning", lambda v: _turned(v, math.pi / 180.0)),
    "imu": ("attitude", lambda v: (math.radians(v["roll"]), -math.radians(v["pitch"]), math.radians(v["yaw"]))),
    "quaternion": ("orientation", lambda v: (v["w"], *_turned(v))),
    "locator": ("position", _turned),
    "velocity": ("velocity", _turned),
    "color_detection": ("ground", lambda v: (v["r"], v["g"], v["b"])),
    "ambient_light": ("ambient_light", lambda v: (v["light"],)),
}

STREAMED = tuple(_CONVERT)
"""The services that are streamed."""


def samples(streamed: StreamData, now: float) -> Iterator[tuple[str, Sample]]:
    """What a slot measured, by name.

    acceleration [m/s2], turning [rad/s], attitude (roll, pitch, yaw) [rad], orientation (w, x, y, z), position [m] and
    velocity [m/s] along the axes at the start, ground (red, green, blue of 0 to 255), ambient_light [lux].
    """
    for service, values in streamed.values.items():
        name, convert = _CONVERT[service]
        yield name, Sample(now, convert(values))
