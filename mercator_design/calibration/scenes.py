"""Recordings as scenes: parts in which the robot stood still."""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Flags, Floats
from mercator_design.errors import RobotError
from mercator_design.robot.logs.events import RecordingStarted, SampleTaken, TurnTaken, WheelsDriven
from mercator_design.robot.logs.log import read
from mercator_design.robot.protocols.ydlidar import correction

MIN_DURATION = 5.0
"""[s] Minimum duration of a scene."""

_BLOCK = 1.0  # [s] Means of blocks of this duration are compared.
_MOVES: Mapping[str, float] = {"attitude": 0.02, "position": 0.01, "ground": 20.0}
"""A larger change of a sensor's mean from one second to the next shows that the robot was moved: [rad], [m], of 255."""
_SIGNIFICANT = 6.0  # standard errors that the change must also exceed


class Series(NamedTuple):
    """The measurements of a sensor.

    times: (n,) [s] since the start of the recording.
    values: (n, channels), NaN where nothing was measured.
    angles: (n, channels) [rad] of the lidar's measurements, whose channels are beams; None for other sensors.
    """

    times: Floats
    values: Floats
    angles: Floats | None = None

    def between(self, begin: float, end: float) -> "Series":
        """The part between two times."""
        inside = (begin <= self.times) & (self.times <= end)
        return Series(self.times[inside], self.values[inside], None if self.angles is None else self.angles[inside])


@dataclass(frozen=True, slots=True, kw_only=True)
class StillScene:
    """A robot that stands still.

    name: The name of the recording, with the times if it has several scenes.
    sensors: Measurements by the names of sensors in recordings, and `lidar`.
    """

    name: str
    sensors: Mapping[str, Series]


class RobotRecording(NamedTuple):
    """The contents of a recording.

    start: The first event.
    duration: The duration [s].
    rest: The longest time at rest [s].
    moves: Begin and end of each time in which the robot was moved [s]; the recording is cut there.
    """

    path: Path
    start: RecordingStarted
    duration: float
    rest: float
    moves: list[tuple[float, float]]
    scenes: list[StillScene]


def read_recording(path: Path) -> RobotRecording:
    """The scenes of a recording, each at least MIN_DURATION long.

    Raises:
        RobotError: if it cannot be read, or is not a recording.
    """
    rows: dict[str, list[tuple[float, Floats]]] = defaultdict(list)
    with closing(read(path, "recording")) as events:
        start = next(events)
        assert isinstance(start, RecordingStarted)  # noqa: S101 - as `read` has seen
        for event in events:
            match event:
                case SampleTaken():
                    rows[event.sensor].append((event.time, np.array(event.values, dtype=float)))
                case TurnTaken():
                    rows["lidar"].append((event.time, np.array(event.readings, dtype=float).reshape(-1, 2)))
                case WheelsDriven():
                    rows["wheels"].append((event.time, np.array([event.left, event.right])))
    series = {name: _series(name, each, start) for name, each in rows.items()}
    if not series:
        raise RobotError(f"{path}: expected a recording of sensors, found no sample")
    duration = max(float(each.times[-1]) for each in series.values())
    moves = list(_moves(series))
    still = [*zip([0.0, *(end for _, end in moves)], [*(begin for begin, _ in moves), duration], strict=True)]
    scenes = []
    for begins, ends in still:
        if ends - begins >= MIN_DURATION:
            parts = {name: each.between(begins, ends) for name, each in series.items()}
            name = f"{path.name}, {begins:.0f} to {ends:.0f} s" if moves else path.name
            scenes.append(StillScene(name=name, sensors=parts))
    rest = max(0.0, *(end - begin for begin, end in still))
    return RobotRecording(path, start, duration, rest, moves, scenes)


def _series(name: str, rows: list[tuple[float, Floats]], start: RecordingStarted) -> Series:
    times = np.array([time for time, _ in rows], dtype=float)
    if name == "lidar":
        return _beams(times, [readings for _, readings in rows], start)
    values = np.stack([values for _, values in rows])
    if name == "proximity":
        values[values == 0.0] = np.nan  # 0: nearer than the sensor can measure
    return Series(times, values)


def _beams(times: Floats, turns: list[Floats], start: RecordingStarted) -> Series:
    """The turns as beams. A beam is an angle before its correction, which depends on the range."""
    beams = max(1, int(np.median([len(turn) for turn in turns])))
    values, angles = np.full((2, len(turns), beams), np.nan)
    for row, turn in enumerate(turns):
        seen = turn[turn[:, 1] > 0.0]
        raw = seen[:, 0] - start.lidar_angle - np.array([correction(reach) for reach in seen[:, 1]])
        beam = np.rint(raw * beams / math.tau).astype(int)
        values[row, beam % beams] = seen[:, 1]
        angles[row, beam % beams] = raw - beam * math.tau / beams
    return Series(times, values, angles)


def _moves(series: Mapping[str, Series]) -> Iterator[tuple[float, float]]:
    """Begin and end of each time in which the robot was moved [s]."""
    blocks = [_changes(name, series[name]) for name in _MOVES if name in series]
    moved = np.zeros(max(map(len, blocks), default=0), dtype=bool)
    for block in blocks:
        moved[: len(block)] |= block
    if "wheels" in series:
        driven = (series["wheels"].times[series["wheels"].values.any(axis=1)] / _BLOCK).astype(int)
        moved[np.intersect1d([driven - 1, driven], np.arange(len(moved)))] = True
    for first, last in _runs(moved):  # change k is from block k to the next
        yield first * _BLOCK, (last + 2) * _BLOCK


def _runs(flags: Flags) -> Iterator[tuple[int, int]]:
    """First and last index of each run of set flags; runs with one unset flag between them count as one."""
    places = np.flatnonzero(flags)
    for run in np.split(places, np.flatnonzero(np.diff(places) > 2) + 1):
        if len(run):
            yield int(run[0]), int(run[-1])


def _changes(name: str, series: Series) -> Flags:
    """Whether the mean of a sensor changes from each block of time to the next."""
    block = (series.times / _BLOCK).astype(int)
    n = np.maximum(np.bincount(block), 1)
    changed = np.zeros(len(n) - 1, dtype=bool)
    for channel in series.values.T:
        values = np.unwrap(channel) if name == "attitude" else channel
        means = np.bincount(block, values) / n
        sd = np.sqrt(np.median(np.bincount(block, (values - means[block]) ** 2) / n))
        there = (n[1:] > 1) & (n[:-1] > 1)
        error = sd * np.sqrt(1.0 / n[1:] + 1.0 / n[:-1])
        changed |= there & (np.abs(np.diff(means)) > _MOVES[name] + _SIGNIFICANT * error)
    return changed
