"""Bags of ROS 1 and 2: scans of 2-D lidars and odometry, of one robot or of several in namespaces."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.errors import MercatorError, excerpt
from mercator_design.mapping.logs import MAX_RANGE, RobotLog, Turn

SUFFIXES = (".bag", ".db3", ".mcap")
"""Endings of files with bags; a bag of ROS 2 is a folder with metadata.yaml and such files."""

_SCAN, _ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
_MAX_BEAMS = 100_000
_MAX_RANGE = 200.0  # [m] of a scan; lidars without a limit say infinity


def is_bag(path: Path) -> bool:
    """Whether a path is that of a bag, by its name or its metadata."""
    return path.suffix in SUFFIXES or (path / "metadata.yaml").is_file()


class Topics(NamedTuple):
    """The ends of the names of topics, behind the namespaces of robots."""

    scan: str = "scan"
    odometry: str = "odom"


def read_bag(path: Path, lidar_pose: Floats | None = None, ends: Topics | None = None) -> list[RobotLog]:
    """The logs of the robots in a bag: of each topic NAME/scan with its NAME/odom.

    A beam has the time of the header plus its number times `time_increment`; if this is 0, all have the same time, and
    nothing shows how a robot moved during a scan.

    Args:
        path: A `.bag` of ROS 1, or the folder of a bag of ROS 2, or a file in it.
        lidar_pose: (3,) of the lidar on the robot; None: at its centre.
        ends: Of the names of topics; None: those above.

    Raises:
        MercatorError: It cannot be read, the package rosbags is missing, or there are no such topics.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise MercatorError("expected the package rosbags, found none: in the clone, pip install '.[map]'") from None
    folder = path.parent if path.suffix in {".db3", ".mcap"} and (path.parent / "metadata.yaml").is_file() else path
    mounted = np.zeros(3) if lidar_pose is None else np.asarray(lidar_pose, float)
    scans: dict[str, list[Turn]] = {}
    reaches: dict[str, float] = {}
    ways: dict[str, list[tuple[float, ...]]] = {}
    try:
        with AnyReader([folder], default_typestore=get_typestore(Stores.LATEST)) as reader:
            topics = {each.topic: each.msgtype for each in reader.connections}
            names = _names(path, topics, ends or Topics())
            wanted = [
                each
                for each in reader.connections
                if each.topic in {topic for pair in names.values() for topic in pair}
            ]
            for connection, _, data in reader.messages(connections=wanted):
                message: Any = reader.deserialize(data, connection.msgtype)
                if connection.msgtype == _ODOMETRY:
                    ways.setdefault(connection.topic, []).append(_place(message))
                elif (turn := _turn(message)) is not None:
                    scans.setdefault(connection.topic, []).append(turn)
                    reach = float(message.range_max)
                    reaches[connection.topic] = max(reaches.get(connection.topic, 0.0), reach)
    except MercatorError:
        raise
    except Exception as error:  # noqa: BLE001 - damaged bags raise errors of many kinds
        what = f"{type(error).__name__}: {excerpt(str(error))}"
        raise MercatorError(f"{path}: expected a bag of ROS 1 or 2, found {what}") from None
    return [
        _log(path, name, scans.get(scan, []), ways.get(odometry, []), mounted, reaches.get(scan, 0.0))
        for name, (scan, odometry) in names.items()
    ]


def _names(path: Path, topics: dict[str, str], ends: Topics) -> dict[str, tuple[str, str]]:
    """The topics of scans and of odometry by robot.

    Raises:
        MercatorError: There are none.
    """
    scan_end, odometry_end = (f"/{end.strip('/')}" for end in ends)
    found = {}
    for topic, kind in sorted(topics.items()):
        namespace = topic.removesuffix(scan_end)
        odometry = namespace + odometry_end
        if kind == _SCAN and topic.endswith(scan_end) and topics.get(odometry) == _ODOMETRY:
            name = namespace.strip("/") or path.stem
            found[f"{name} ({scan_end})" if name in found else name] = topic, odometry
    if not found:
        listed = excerpt(", ".join(f"{topic} ({kind})" for topic, kind in sorted(topics.items())) or "no topic")
        raise MercatorError(
            f"{path}: expected topics {scan_end} ({_SCAN}) and {odometry_end} ({_ODOMETRY}), also in namespaces, found "
            f"{listed}; --scan and --odom name others"
        )
    return found


def _turn(message: Any) -> Turn | None:  # noqa: ANN401 - of a type that the bag defines
    """A scan, whose beams may go either way round; None if it has no beams."""
    ranges = np.asarray(message.ranges, dtype=np.float64)
    if not 2 <= len(ranges) <= _MAX_BEAMS:
        return None
    number = np.arange(len(ranges))
    within = np.isfinite(ranges) & (ranges >= max(0.0, message.range_min)) & (ranges <= message.range_max)
    angles = message.angle_min + number * message.angle_increment
    times = _time(message) + number * message.time_increment
    if message.time_increment < 0.0:
        angles, times, ranges, within = angles[::-1], times[::-1], ranges[::-1], within[::-1]
    return Turn(times, angles, np.where(within, ranges, 0.0))


def _place(message: Any) -> tuple[float, ...]:  # noqa: ANN401
    """Time [s], x, y [m] and heading [rad]."""
    position, turned = message.pose.pose.position, message.pose.pose.orientation
    w, x, y, z = turned.w, turned.x, turned.y, turned.z
    heading = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return _time(message), position.x, position.y, heading


def _time(message: Any) -> float:  # noqa: ANN401
    return float(message.header.stamp.sec) + 1e-9 * float(message.header.stamp.nanosec)


def _log(
    path: Path, name: str, turns: list[Turn], places: list[tuple[float, ...]], mounted: Floats, reach: float
) -> RobotLog:
    turns = sorted(_finite(turns), key=lambda turn: turn.times[0])
    rows = np.array(places, dtype=float).reshape(-1, 4)
    rows = rows[np.isfinite(rows).all(axis=1)]
    times, first = np.unique(rows[:, 0], return_index=True)
    if not turns or len(times) < 2:
        raise MercatorError(
            f"{path}: {name}: expected scans and at least two samples of odometry, found {len(turns)} and {len(times)}"
        )
    odometry = rows[first, 1:]
    odometry[:, 2] = np.unwrap(odometry[:, 2])
    reach = min(reach, _MAX_RANGE) if reach > 0.0 else MAX_RANGE
    return RobotLog(name, turns, times, odometry, mounted, max_range=reach)


def _finite(turns: list[Turn]) -> Iterator[Turn]:
    for turn in turns:
        if np.isfinite(turn.times).all() and np.isfinite(turn.angles).all():
            yield turn
