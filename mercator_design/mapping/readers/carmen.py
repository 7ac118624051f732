"""Logs in the format of CARMEN: lines of readings of a laser, with its pose and that of the odometry."""

import contextlib
import gzip
import math
import zlib
from bisect import bisect_left
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.errors import MercatorError, excerpt
from mercator_design.mapping import poses
from mercator_design.mapping.logs import RobotLog, Turn

MARKS = (b"FLASER ", b"ROBOTLASER1 ")
"""How the lines begin that have readings."""

_MAX_READING = 79.0  # [m] more is no return
_MAX_READINGS = 100_000  # of a line
_MAX_SIZE = 2**30  # bytes, unpacked
_MIN_RISING = 0.8  # of the lines, whose times must rise
_FACING = math.pi  # [rad] field of view of FLASER


def is_carmen(data: bytes) -> bool:
    """Whether a file with this beginning is such a log, as text or gzip'd."""
    if data[:2] == b"\x1f\x8b":
        with contextlib.suppress(zlib.error):
            data = zlib.decompressobj(31).decompress(data, 1 << 20)
    return any(data.startswith(mark) or b"\n" + mark in data for mark in MARKS) or data.startswith(b"# CARMEN")


class _Words:
    """The words of a line, taken one after the other."""

    def __init__(self, line: bytes) -> None:
        self._words = line.split()
        self._next = 0

    def take(self, what: str) -> bytes:
        """The next word.

        Raises:
            ValueError: with what was expected, if there is none.
        """
        if self._next >= len(self._words):
            raise ValueError(f"expected {what} in word {self._next + 1}, found the end of the line")
        self._next += 1
        return self._words[self._next - 1]

    def numbers(self, count: int, what: str) -> Floats:
        """The next finite numbers; errors are those of `take`."""
        if self._next + count > len(self._words):
            raise ValueError(f"expected {count} numbers ({what}), found {len(self._words) - self._next} words")
        return np.array([self.number(what) for _ in range(count)])

    def number(self, what: str) -> float:
        """The next number, which is finite; errors are those of `take`."""
        word = self.take(what)
        try:
            found = float(word)
        except ValueError:
            found = math.nan
        if not math.isfinite(found):
            raise ValueError(f"expected a number ({what}) in word {self._next}, found {_shown(word)}")
        return found

    def count(self, least: int, what: str) -> int:
        """The next whole number, from the least one on; errors are those of `take`."""
        word = self.take(what)
        if not word.isdigit() or not least <= int(word[:10]) <= _MAX_READINGS:
            expected = f"expected {what}, a whole number from {least} to {_MAX_READINGS}"
            raise ValueError(f"{expected}, in word {self._next}, found {_shown(word)}")
        return int(word)


def _shown(word: bytes) -> str:
    return excerpt(repr(word.decode(errors="replace")))


def read_carmen(path: Path, lidar_pose: Floats | None = None) -> RobotLog:
    """The log of one robot.

    Its odometry is that of the lines with readings. All readings of a line have one time. Lines whose times do not fit
    among the others, which rise, are left out; if these are many, as in logs that rounded the times, a line stands for
    a second. A last line that is cut is left out, too. Notes tell of each.

    Args:
        path: Of the file, which may be gzip'd.
        lidar_pose: (3,) of the lidar on the robot; None: as the log has it.

    Raises:
        MercatorError: The file cannot be read, or a line is not of this format.
    """
    rows, notes = [], []
    lines = _contents(path).split(b"\n")
    for number, line in enumerate(lines, 1):
        if line.startswith(MARKS):
            try:
                rows.append(_row(_Words(line)))
            except ValueError as error:
                if number < len(lines) or not rows:
                    raise MercatorError(f"{path}:{number}: {error}") from None
                notes.append("its last line is cut, and left out.")
    if not rows:
        raise MercatorError(f"{path}: expected lines with FLASER or ROBOTLASER1, found none")
    times = np.array([row.time for row in rows])
    rising = _rising(times)
    if len(rising) < _MIN_RISING * len(rows):
        times = np.arange(len(rows), dtype=float)
        notes.append("the times of its lines do not rise: a line stands for a second.")
    elif len(rising) < len(rows):
        notes.append(f"{len(rows) - len(rising)} lines whose times do not rise are left out.")
        rows, times = [rows[k] for k in rising], times[rising]
    odometry = np.array([row.odometry for row in rows])
    odometry[:, 2] = np.unwrap(odometry[:, 2])
    turns = [
        Turn(np.full(len(row.ranges), time), row.angles, row.ranges)
        for time, row in zip(times.tolist(), rows, strict=True)
    ]
    mounted = poses.between(rows[0].odometry, rows[0].laser) if lidar_pose is None else lidar_pose
    name = path.name.partition(".")[0]
    return RobotLog(name, turns, times, odometry, np.asarray(mounted, float), notes=tuple(notes))


def _rising(times: Floats) -> list[int]:
    """The most rows whose times rise (patience sorting: the longest increasing part)."""
    ends: list[float] = []  # the least last time of a rising part of each length
    rows: list[int] = []  # of these times
    before = [-1] * len(times)
    for row, time in enumerate(times.tolist()):
        place = bisect_left(ends, time)
        before[row] = rows[place - 1] if place else -1
        ends[place : place + 1], rows[place : place + 1] = [time], [row]
    found = []
    row = rows[-1]
    while row >= 0:
        found.append(row)
        row = before[row]
    return found[::-1]


def _contents(path: Path) -> bytes:
    """The file, unpacked.

    Raises:
        MercatorError: It cannot be read, or is too large.
    """
    try:
        with path.open("rb") as file:
            is_packed = file.read(2) == b"\x1f\x8b"
        with gzip.open(path) if is_packed else path.open("rb") as file:
            data = file.read(_MAX_SIZE + 1)
    except (OSError, EOFError, zlib.error) as wrong:
        raise MercatorError(f"{path}: cannot be read: {wrong}") from None
    if len(data) > _MAX_SIZE:
        raise MercatorError(f"{path}: expected at most {_MAX_SIZE // 2**20} MiB of CARMEN, found more")
    return data


class _Row(NamedTuple):
    """A line with readings."""

    angles: Floats  # (n,) [rad]
    ranges: Floats  # (n,) [m]
    laser: Floats  # (3,)
    odometry: Floats  # (3,)
    time: float  # [s]


def _row(words: _Words) -> _Row:
    """The contents of a line.

    Raises:
        ValueError: with what was expected.
    """
    if words.take("a kind") == b"FLASER":
        n = words.count(2, "the number of readings")
        step, begin = _FACING / (n - n % 2), -0.5 * _FACING
        ranges = words.numbers(n, "readings")
        laser, odometry = words.numbers(3, "pose of the laser"), words.numbers(3, "pose of the robot")
        time = words.number("time")
    else:
        words.take("type of the laser")
        begin, _, step = words.numbers(3, "start, field of view and step of angles").tolist()
        words.numbers(2, "maximum range and accuracy")
        words.take("mode of remissions")
        n = words.count(2, "the number of readings")
        ranges = words.numbers(n, "readings")
        words.numbers(words.count(0, "the number of remissions"), "remissions")
        laser, odometry = words.numbers(3, "pose of the laser"), words.numbers(3, "pose of the robot")
        words.numbers(5, "speeds and distances")
        time = words.number("time")
    angles = np.asarray(begin + step * np.arange(n), np.float64)
    return _Row(angles, np.where((ranges > 0.0) & (ranges < _MAX_READING), ranges, 0.0), laser, odometry, time)
