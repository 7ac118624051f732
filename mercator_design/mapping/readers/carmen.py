"""Logs in the format of CARMEN: lines of readings of a laser, with its pose and that of the odometry."""

import contextlib
import gzip
import math
import zlib
from pathlib import Path

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.errors import MercatorError
from mercator_design.mapping import poses
from mercator_design.mapping.logs import RobotLog, Turn

MARKS = (b"FLASER ", b"ROBOTLASER1 ")
"""How the lines begin that have readings."""

_MAX_READING = 79.0  # [m] more is no return
_FACING = math.pi  # [rad] field of view of FLASER


def is_carmen(data: bytes) -> bool:
    """Whether a file with this beginning is such a log, as text or gzip'd."""
    if data[:2] == b"\x1f\x8b":
        with contextlib.suppress(zlib.error):
            data = zlib.decompressobj(31).decompress(data, 1 << 20)
    return any(data.startswith(mark) or b"\n" + mark in data for mark in MARKS) or data.startswith(b"# CARMEN")


def read_carmen(path: Path, lidar_pose: Floats | None = None) -> RobotLog:
    """The log of one robot.

    Its odometry is that of the lines with readings. All readings of a line have one time; if the times of lines do not
    rise, as in logs that rounded them, a line stands for a second.

    Args:
        path: Of the file, which may be gzip'd.
        lidar_pose: (3,) of the lidar on the robot; None: as the log has it.

    Raises:
        MercatorError: The file cannot be read, or a line is not of this format.
    """
    try:
        data = gzip.decompress(path.read_bytes()) if path.read_bytes()[:2] == b"\x1f\x8b" else path.read_bytes()
    except (OSError, EOFError, zlib.error) as wrong:
        raise MercatorError(f"{path}: cannot be read: {wrong}") from None
    rows = []
    for number, line in enumerate(data.split(b"\n"), 1):
        if line.startswith(MARKS):
            try:
                rows.append(_row(line.split()))
            except (ValueError, IndexError):
                raise MercatorError(f"{path}:{number}: expected readings, poses and times of CARMEN") from None
    if not rows:
        raise MercatorError(f"{path}: expected lines with FLASER or ROBOTLASER1, found none")
    times = np.array([row[4] for row in rows])
    if (np.diff(times) <= 0.0).any():
        times = np.arange(len(rows), dtype=float)
    odometry = np.array([row[3] for row in rows])
    odometry[:, 2] = np.unwrap(odometry[:, 2])
    turns = [
        Turn(np.full(len(ranges), time), angles, ranges)
        for time, (angles, ranges, *_) in zip(times.tolist(), rows, strict=True)
    ]
    mounted = poses.between(rows[0][3], rows[0][2]) if lidar_pose is None else lidar_pose
    return RobotLog(path.name.partition(".")[0], turns, times, odometry, np.asarray(mounted, float))


def _row(words: list[bytes]) -> tuple[Floats, Floats, Floats, Floats, float]:
    """Angles, ranges, the pose of the laser and of the odometry, and the time of a line."""
    if words[0] == b"FLASER":
        n, first = int(words[1]), 2
        step, begin = _FACING / (n - n % 2), -0.5 * _FACING
        after = first + n
        laser, odometry = _numbers(words[after : after + 3]), _numbers(words[after + 3 : after + 6])
        time = float(words[after + 6])
    else:
        begin, step, n, first = float(words[2]), float(words[4]), int(words[8]), 9
        after = first + n + 1 + int(words[first + n])
        laser, odometry = _numbers(words[after : after + 3]), _numbers(words[after + 3 : after + 6])
        time = float(words[after + 11])
    ranges = _numbers(words[first : first + n])
    if len(ranges) != n or n < 2 or len(laser) != 3 or len(odometry) != 3 or not math.isfinite(time):
        raise ValueError
    angles = np.asarray(begin + step * np.arange(n), np.float64)
    return angles, np.asarray(np.where(ranges < _MAX_READING, ranges, 0.0), np.float64), laser, odometry, time


def _numbers(words: list[bytes]) -> Floats:
    found = np.array([float(word) for word in words])
    if not np.isfinite(found).all():
        raise ValueError
    return found
