"""Reads logs of robots, in whatever format they are."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mercator_design.arrays import Floats
from mercator_design.errors import MercatorError
from mercator_design.mapping.logs import RobotLog
from mercator_design.mapping.readers.bags import is_bag, read_bag
from mercator_design.mapping.readers.carmen import is_carmen, read_carmen
from mercator_design.mapping.readers.checking import checked
from mercator_design.mapping.readers.robot_logs import read_robot_log
from mercator_design.mapping.readers.traces import SUFFIX, read_trace_logs

_BEGINNING = 1 << 16
"""Bytes of a file by which its format is known."""
_SINCE_1970 = 1e8
"""[s] Times of logs that are counted from 1970 are more than this."""


def read_logs(paths: Sequence[Path], lidar_pose: Floats | None = None) -> list[RobotLog]:
    """The logs of all robots in some files, in the order of the files.

    Times of several files are counted from the same moment, so that clocks differ as they did.

    Args:
        paths: Of the files.
        lidar_pose: (3,) of the lidar on the robot; None: as the log or the robot model has it.

    Raises:
        MercatorError: A file cannot be read, is no log, or is given twice.
    """
    for k, path in enumerate(paths):
        if path.exists() and any(other.exists() and path.samefile(other) for other in paths[:k]):
            raise MercatorError(f"{path}: given twice; expected each log once")
    logs = _named_apart([checked(log, str(path)) for path in paths for log in _read(path, lidar_pose)])
    begin = min((float(log.turns[0].times[0]) for log in logs), default=0.0)
    return [_since(log, begin) for log in logs] if begin > _SINCE_1970 else logs


def _named_apart(logs: Sequence[RobotLog]) -> list[RobotLog]:
    """The logs with names that differ: the second one of the same name has a number, and so on."""
    named: dict[str, RobotLog] = {}
    for log in logs:
        name, number = log.name, 1
        while name in named:
            number += 1
            name = f"{log.name} ({number})"
        named[name] = replace(log, name=name)
    return list(named.values())


def _since(log: RobotLog, begin: float) -> RobotLog:
    """A log whose times are counted from a moment [s]."""
    turns = [turn._replace(times=turn.times - begin) for turn in log.turns]
    truth_times = None if log.truth_times is None else log.truth_times - begin
    return replace(log, turns=turns, odometry_times=log.odometry_times - begin, truth_times=truth_times)


def _read(path: Path, lidar_pose: Floats | None) -> list[RobotLog]:
    if is_bag(path):
        return read_bag(path, lidar_pose)
    if path.suffix.lower() == SUFFIX:
        return read_trace_logs(path, lidar_pose)
    try:
        with path.open("rb") as file:
            beginning = file.read(_BEGINNING)
    except OSError as wrong:
        raise MercatorError(f"{path}: cannot be read: {wrong.strerror}") from None
    if is_carmen(beginning):
        return [read_carmen(path, lidar_pose)]
    if beginning.startswith(b"{"):
        return [read_robot_log(path, lidar_pose)]
    raise MercatorError(
        f"{path}: expected a log with turns of a lidar: of mercator-robot, a trace of `mdesign record --turns` (.npz), "
        "a bag of ROS, or of CARMEN; found another file"
    )
