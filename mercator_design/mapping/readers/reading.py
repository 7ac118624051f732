"""Reads logs of robots, in whatever format they are."""

from collections.abc import Sequence
from pathlib import Path

from mercator_design.arrays import Floats
from mercator_design.errors import MercatorError
from mercator_design.mapping.logs import RobotLog
from mercator_design.mapping.readers.carmen import is_carmen, read_carmen

_BEGINNING = 1 << 16
"""Bytes of a file by which its format is known."""


def read_logs(paths: Sequence[Path], lidar_pose: Floats | None = None) -> list[RobotLog]:
    """The logs of all robots in some files, in the order of the files.

    Args:
        paths: Of the files.
        lidar_pose: (3,) of the lidar on the robot; None: as the log or the robot model has it.

    Raises:
        MercatorError: A file cannot be read, or is no log.
    """
    return [log for path in paths for log in _read(path, lidar_pose)]


def _read(path: Path, lidar_pose: Floats | None) -> list[RobotLog]:
    try:
        with path.open("rb") as file:
            beginning = file.read(_BEGINNING)
    except OSError as wrong:
        raise MercatorError(f"{path}: cannot be read: {wrong.strerror}") from None
    if is_carmen(beginning):
        return [read_carmen(path, lidar_pose)]
    raise MercatorError(f"{path}: expected a log with turns of a lidar: of CARMEN, found another file")
