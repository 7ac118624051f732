"""The messages of a Mercator's ROS topics, as plain values: fields by name.

Types, units, frames and axes are those of the robot's original nodes (rvr_ros, ydlidar_ros_driver with its X4.launch,
teraranger_array): in imu and odom, x is to the right and y forwards, as in the RVR; in the scan, x is forwards and
angles are counter-clockwise. Covariances are zero: unknown.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

from mercator_design.config.colours import RGB
from mercator_design.robot.devices.samples import Sample
from mercator_design.robot.devices.sweep import BINS, STEP

Fields: TypeAlias = dict[str, Any]


class Topic(NamedTuple):
    """A published topic."""

    type: str  # of its messages
    latched: bool  # whether a new subscriber gets the last message at once
    queue: int = 10  # messages that wait for a slow subscriber


PUBLISHED: Mapping[str, Topic] = {
    "rvr/ground_color": Topic("std_msgs/ColorRGBA", latched=True),
    "rvr/fixed_color": Topic("std_msgs/ColorRGBA", latched=True),
    "rvr/ambient_light": Topic("sensor_msgs/Illuminance", latched=True),
    "rvr/imu": Topic("sensor_msgs/Imu", latched=True),
    "rvr/odom": Topic("nav_msgs/Odometry", latched=True),
    "scan": Topic("sensor_msgs/LaserScan", latched=False, queue=1),
    "ranges": Topic("teraranger_array/RangeArray", latched=False, queue=1),
}
WHEELS, LEDS = "rvr/wheels_speed", "rvr/rgb_leds"
OBEYED: Mapping[str, str] = {WHEELS: "std_msgs/Float32MultiArray", LEDS: "rvr_ros/Leds"}
"""The type of each subscribed topic."""

MADE_HERE = {
    "teraranger_array/RangeArray": ("sensor_msgs/Range[] ranges\nHeader header\n", "sensor_msgs/Range"),
    "rvr_ros/Leds": ("std_msgs/ColorRGBA[5] led_colors", "std_msgs/ColorRGBA"),
}
"""Types that are not in distributions of ROS: their definition, and the type of its parts."""

READINGS = 720
"""Readings of a scan, the last at the angle of the first, as in the lidar's node with a fixed resolution."""
_INCREMENT = math.tau / (READINGS - 1)
_NEAREST, _FARTHEST = 0.1, 12.0  # [m]; no other range is a measurement
_INFRARED = 1

_PLACES = tuple(round(((k * STEP + math.pi) % math.tau) / _INCREMENT) for k in range(BINS))
"""The index in the scan of each bin of the ring."""


def header(seconds: float, frame: str = "") -> Fields:
    """The header of a measurement at a time [s]."""
    nanoseconds = max(0, round(1e9 * seconds))
    return {"stamp": {"secs": nanoseconds // 10**9, "nsecs": nanoseconds % 10**9}, "frame_id": frame}


def colour(levels: RGB) -> Fields:
    """A ColorRGBA with levels from 0 to 255."""
    red, green, blue = levels
    return {"r": red, "g": green, "b": blue, "a": 255.0}


def illuminance(seconds: float, light: Sample) -> Fields:
    """An Illuminance [lux]."""
    return {"header": header(seconds), "illuminance": light.values[0]}


IMU = frozenset({"attitude", "turning", "acceleration"})
"""The samples in an Imu."""
ODOMETRY = frozenset({"position", "orientation", "velocity", "turning"})
"""The samples in an Odometry."""


def imu(seconds: float, samples: Mapping[str, Sample]) -> Fields:
    """An Imu: orientation, angular velocity [rad/s], acceleration [m/s2]."""
    roll, pitch, yaw = samples["attitude"].values
    return {
        "header": header(seconds),
        "orientation": _quaternion(roll, -pitch, yaw),
        "angular_velocity": _vector(samples["turning"]),
        "linear_acceleration": _vector(samples["acceleration"]),
    }


def odometry(seconds: float, samples: Mapping[str, Sample]) -> Fields:
    """An Odometry: position [m], orientation, velocity [m/s], angular velocity [rad/s]."""
    w, x, y, z = samples["orientation"].values
    return {
        "header": header(seconds),
        "pose": {"pose": {"position": _vector(samples["position"]), "orientation": _rvr_axes(x, y, z) | {"w": w}}},
        "twist": {"twist": {"linear": _vector(samples["velocity"]), "angular": _vector(samples["turning"])}},
    }


def scan(seconds: float, ranges: Sequence[float], duration: float) -> Fields:
    """A LaserScan of a turn that began at a time and took a duration [s]; ranges [m] are those of a `Sweep`."""
    readings = [0.0] * READINGS
    for place, distance in zip(_PLACES, ranges, strict=True):
        if _NEAREST <= distance <= _FARTHEST and not 0.0 < readings[place] < distance:
            readings[place] = distance
    return {
        "header": header(seconds, "laser_frame"),
        "angle_min": -math.pi,
        "angle_max": math.pi,
        "angle_increment": _INCREMENT,
        "time_increment": duration / (READINGS - 1),
        "scan_time": duration,
        "range_min": _NEAREST,
        "range_max": _FARTHEST,
        "ranges": readings,
        "intensities": [0.0] * READINGS,
    }


def range_array(seconds: float, distances: Sequence[float], namespace: str = "") -> Fields:
    """A RangeArray, in the order of the hub's sensors: inf where nothing is in sight, -inf where something is too near.

    The names of the frames have the namespace, which has no slashes.
    """
    prefix = f"{namespace}_" if namespace else ""
    return {
        "header": header(seconds, f"base_{namespace or 'hub'}"),
        "ranges": [
            {
                "header": header(seconds, f"{prefix}base_range_{k}"),
                "radiation_type": _INFRARED,
                "field_of_view": 0.2967,
                "min_range": 0.05,
                "max_range": 2.0,
                "range": distance,
            }
            for k, distance in enumerate(distances)
        ],
    }


def _vector(sample: Sample) -> Fields:
    return _rvr_axes(*sample.values)


def _rvr_axes(forwards: float, left: float, up: float = 0.0) -> Fields:
    return {"x": -left, "y": forwards, "z": up}


def _quaternion(roll: float, pitch: float, yaw: float) -> Fields:
    """The quaternion of turns about fixed axes: x, then y, then z."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(0.5 * angle), math.sin(0.5 * angle)) for angle in (roll, pitch, yaw))
    return {
        "x": sr * cp * cy - cr * sp * sy,
        "y": cr * sp * cy + sr * cp * sy,
        "z": cr * cp * sy - sr * sp * cy,
        "w": cr * cp * cy + sr * sp * sy,
    }
