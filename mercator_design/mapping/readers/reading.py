"""Reads logs of robots, in whatever format they are."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from mercator_design.arrays import Floats
from mercator_design.errors import MercatorError
from mercator_design.mapping.logs import RobotLog
from mercator_design.mapping.readers.bags import Topics, is_bag, read_bag
from mercator_design.mapping.readers.carmen import is_carmen, read_carmen
from mercator_design.mapping.readers.checking import checked
from mercator_design.mapping.readers.robot_logs import read_robot_log
from mercator_design.mapping.readers.traces import SUFFIX, read_trace_logs

_BEGINNING = 1 << 16
"""Bytes of a file by which its format is known."""
_SINCE_1970 = 1e8
"""[s] Times of logs that are counted from 1970 are more than this."""
_FAR_APART = 0.25
"""[days] Between the beginnings of logs that are hardly of one run."""


class LidarOptions(NamedTuple):
    """A user's description of the lidars of other robots; None: as the log has it, or as that of a Mercator."""

    pose: Floats | None = None  # (3,) on the robot
    topics: Topics | None = None  # of bags
    max_range: float | None = None  # [m]
    head_radius: float | None = None  # [m]


def read_logs(paths: Sequence[Path], lidar: LidarOptions | None = None) -> list[RobotLog]:
    """The logs of all robots in some files, in the order of the files.

    Times of several files are counted from the same moment, so that clocks differ as they did.

    Args:
        paths: Of the files.
        lidar: What is known of the lidars.

    Raises:
        MercatorError: A file cannot be read, is no log, or is given twice.
    """
    for k, path in enumerate(paths):
        if path.exists() and any(other.exists() and path.samefile(other) for other in paths[:k]):
            raise MercatorError(f"{path}: given twice; expected each log once")
    lidar = lidar or LidarOptions()
    logs = [checked(log, str(path)) for path in paths for log in _read(path, lidar)]
    logs = _named_apart([_with(log, lidar) for log in logs])
    dated = [log for log in logs if _begin(log) > _SINCE_1970]
    begin = min(map(_begin, dated), default=0.0)
    return _told_apart([_since(log, begin) if _begin(log) > _SINCE_1970 else log for log in logs], dated)


def _begin(log: RobotLog) -> float:
    return float(log.turns[0].times[0]) if log.turns else 0.0


def _with(log: RobotLog, lidar: LidarOptions) -> RobotLog:
    """A log with what the user says of the lidar."""
    reach = log.max_range if lidar.max_range is None else lidar.max_range
    head = log.head_radius if lidar.head_radius is None else lidar.head_radius
    return replace(log, max_range=reach, head_radius=head)


def _told_apart(logs: Sequence[RobotLog], dated: Sequence[RobotLog]) -> list[RobotLog]:
    """The logs, with a note on those whose times have hardly to do with those of others."""
    if not logs:
        return []
    days = [(_begin(log) - _begin(logs[0])) / 86400.0 for log in logs]
    names = {log.name for log in dated}
    notes = [
        f"its times are not counted from 1970, as those of {dated[0].name} are: both are taken to begin at once."
        if dated and log.name not in names
        else f"it begins {abs(later):.6g} days {'after' if later > 0.0 else 'before'} {logs[0].name}; are these logs "
        "of one run, and their clocks right?"
        if abs(later) > _FAR_APART
        else ""
        for log, later in zip(logs, days, strict=True)
    ]
    return [replace(log, notes=(*log.notes, *filter(None, [note]))) for log, note in zip(logs, notes, strict=True)]


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


def _read(path: Path, lidar: LidarOptions) -> list[RobotLog]:
    if is_bag(path):
        return read_bag(path, lidar.pose, lidar.topics)
    if path.suffix.lower() == SUFFIX:
        return read_trace_logs(path, lidar.pose)
    if path.exists() and not path.is_file():  # opening a pipe would wait
        raise MercatorError(f"{path}: expected a log, found a folder, device or pipe")
    try:
        with path.open("rb") as file:
            beginning = file.read(_BEGINNING)
    except OSError as wrong:
        raise MercatorError(f"{path}: cannot be read: {wrong.strerror}") from None
    if is_carmen(beginning):
        return [read_carmen(path, lidar.pose)]
    if beginning.startswith(b"{"):
        return [read_robot_log(path, lidar.pose)]
    raise MercatorError(
        f"{path}: expected a log with turns of a lidar: of mercator-robot, a trace of `mdesign record --turns` (.npz), "
        "a bag of ROS, or of CARMEN; found another file"
    )
