"""Logs of mercator-robot: of runs, and recordings.

A packet of the lidar comes some time after its last beam has left: it travels along a serial line, and waits until the
program reads it. So the beams of a turn are on a line through the packets that waited least. What all packets wait is
left to the estimate of the lag between lidar and odometry.
"""

import math
from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.errors import RobotError
from mercator_design.mapping.logs import RobotLog, Turn
from mercator_design.robot.logs.events import LogEnded, LogEvent, RecordingStarted, RunStarted, SampleTaken, TurnTaken
from mercator_design.robot.logs.log import NO_END, read
from mercator_design.robot.logs.turns import packets_of
from mercator_design.robot.protocols.ydlidar import MAX_RANGE, TURN, correction

_PACKET = 40 / 5000  # [s] that an X4 takes for a usual packet
_USUAL_TURN = 719 / 5000  # [s] of an X4
_TURNS = (0.05, 0.5)  # [s] that turns may take
_MIN_SHARE = 0.99  # of a turn's usual time that it takes: the lidar's speed varies
_MAX_GAP = 1.0  # [s] between places, across which there is no odometry
_NEIGHBOURS = 10  # turns before and behind one whose durations tell its own


class _Passage(NamedTuple):
    """The packets of a turn, as they came."""

    travelled: Floats  # (beams,) angle of each beam after the first [turns], rising
    came: Floats  # (packets,) when each packet came [s]
    last: Floats  # (packets,) travelled by its last beam
    angles: Floats  # (beams,)
    ranges: Floats  # (beams,)

    def begins(self, turn: float) -> float:
        """When its first beam left [s], if a turn takes so many seconds."""
        return float(np.min(self.came - self.last * turn))


@dataclass
class _Heard:
    """The contents of a log, collected event by event."""

    front: float  # [rad] of the lidar
    passages: list[_Passage] = field(default_factory=list)
    yaws: list[tuple[float, float]] = field(default_factory=list)
    places: list[tuple[float, float, float]] = field(default_factory=list)

    def take(self, event: LogEvent) -> None:
        if isinstance(event, TurnTaken):
            self.yaws += event.yaws
            self.places += event.places
            passage = _of_samples(event, self.front) if event.ranges else _of_readings(event)
            if passage is not None:
                self.passages.append(passage)
        elif isinstance(event, SampleTaken) and event.sensor == "attitude":
            if (yaw := event.values[2]) is not None:
                self.yaws.append((event.time, float(yaw)))
        elif isinstance(event, SampleTaken) and event.sensor == "position":
            x, y = event.values
            if x is not None and y is not None:
                self.places.append((event.time, float(x), float(y)))


def read_robot_log(path: Path, lidar_pose: Floats | None = None) -> RobotLog:
    """The log of a robot's run or recording; its times are those of its computer [s, since 1970].

    If the robot was started together with others, times are by the clock of the computer that started them.

    Args:
        path: Of the log.
        lidar_pose: (3,) of the lidar on the robot, in place of its angle in the log; None: at its centre.

    Raises:
        RobotError: if it cannot be read, is not such a log or is damaged before its end; or it has no turns of the
            lidar, or no odometry.
    """
    with closing(read(path, None)) as events:
        start = next(events)
        assert isinstance(start, RunStarted | RecordingStarted)  # noqa: S101 - `read` has checked it
        heard, has_end = _Heard(start.lidar_angle), False
        for event in events:
            heard.take(event)
            has_end = has_end or isinstance(event, LogEnded)
    if not heard.passages:
        expected = "expected turns of the lidar, found none"
        why = "an earlier version wrote the log of a run without them, or the robot ran without its lidar"
        raise RobotError(f"{path}: {expected}: {why}")
    if len(heard.yaws) < 2 or not heard.places:
        found = f"{len(heard.yaws)} yaws and {len(heard.places)} places"
        raise RobotError(f"{path}: expected odometry, attitude and position of the RVR, found {found}")
    began = datetime.fromisoformat(start.time).timestamp()
    if isinstance(start, RunStarted) and start.clock is not None:
        began -= start.clock.ahead
    times, odometry = _odometry(heard.yaws, heard.places)
    if len(times) < 2:
        raise RobotError(f"{path}: expected yaws and places of the same time, found none within {_MAX_GAP} s")
    mounted = np.array([0.0, 0.0, start.lidar_angle]) if lidar_pose is None else np.asarray(lidar_pose, float)
    turns = _turns(heard.passages, began, start.lidar_angle)
    return RobotLog(start.robot, turns, began + times, odometry, mounted, notes=() if has_end else (f"{NO_END}.",))


def _of_samples(turn: TurnTaken, front: float) -> _Passage | None:
    """A turn of a run."""
    packets = packets_of(turn)
    counts = [len(packet.samples) for packet, _ in packets]
    firsts, lasts = _unwound([(packet.first, packet.last) for packet, _ in packets])
    clockwise = np.concatenate([np.linspace(*each) for each in zip(firsts, lasts, counts, strict=True)])
    ranges = np.concatenate([packet.samples for packet, _ in packets]) / 4000.0
    corrections = _CORRECTIONS[np.rint(1000.0 * ranges).astype(np.int64)]
    came = np.array([time for _, time in packets])
    return _passage(clockwise / TURN, came, lasts / TURN, front + corrections - math.tau * clockwise / TURN, ranges)


def _of_readings(turn: TurnTaken) -> _Passage | None:
    """A turn of a recording; those of earlier versions have no packets, and the time of the next turn's first one."""
    if not turn.readings:
        return None
    angles, ranges = np.array(turn.readings).T
    corrections = np.where(
        ranges > 0.0, _CORRECTIONS[np.rint(1000.0 * np.clip(ranges, 0.0, MAX_RANGE)).astype(int)], 0.0
    )
    back = np.cumsum(np.concatenate([[0.0], np.mod(np.diff(corrections - angles) + math.pi, math.tau) - math.pi]))
    travelled = np.maximum.accumulate(np.maximum(back, 0.0)) / math.tau
    counts = np.array([count for *_, count in turn.packets])
    if counts.sum() == len(angles):
        came = turn.time - np.array([before for before, *_ in turn.packets]) / 1e4
        return _passage(travelled, came, travelled[np.cumsum(counts) - 1], angles, ranges)
    return _passage(travelled, np.array([turn.time - _PACKET]), np.array([1.0]), angles, ranges)


def _passage(travelled: Floats, came: Floats, last: Floats, angles: Floats, ranges: Floats) -> _Passage:
    seen = np.where(ranges <= MAX_RANGE, ranges, 0.0)
    rising = np.maximum.accumulate(travelled - travelled[0])  # packets may overlap by a few degrees
    return _Passage(rising, came, last - travelled[0], angles, seen)


def _unwound(ends: Sequence[tuple[int, int]]) -> tuple[Floats, Floats]:
    """First and last angles of packets [degrees / 64], which go on beyond a turn where packets do."""
    firsts, lasts, before = [], [], ends[0][0]
    for first, last in ends:
        begin = before + (first - before + TURN // 4) % TURN - TURN // 4
        firsts.append(begin)
        before = begin + (last - first) % TURN
        lasts.append(before)
    return np.array(firsts, dtype=float), np.array(lasts, dtype=float)


def _turns(passages: Sequence[_Passage], began: float, front: float) -> list[Turn]:
    """The turns, with the times of their beams [s, since 1970], of a log that began at a time; angles from a front.

    A turn all of whose packets waited, as the program was stalled, would begin too late; it ended before the next one.
    """
    durations = _durations([passage.begins(_USUAL_TURN) for passage in passages])
    begins = [passage.begins(turn) for passage, turn in zip(passages, durations, strict=True)]
    for k in range(len(begins) - 2, -1, -1):
        begins[k] = min(begins[k], begins[k + 1] - _MIN_SHARE * durations[k])
    return [
        Turn(began + begin + turn * passage.travelled, passage.angles - front, passage.ranges)
        for begin, passage, turn in zip(begins, passages, durations, strict=True)
    ]


def _durations(begins: Sequence[float]) -> list[float]:
    """How long each turn takes [s]: the median of those around it, without gaps."""
    steps = np.diff(begins)
    found = []
    for k in range(len(begins)):
        near = steps[max(0, k - _NEIGHBOURS) : k + _NEIGHBOURS]
        near = near[(near >= _TURNS[0]) & (near <= _TURNS[1])]
        found.append(float(np.median(near)) if len(near) else _USUAL_TURN)
    return found


def _odometry(
    yaws: Iterable[tuple[float, float]], places: Iterable[tuple[float, float, float]]
) -> tuple[Floats, Floats]:
    """Times (n,) [s] and poses (n, 3) at the yaws, with places between those that came; none where these have a gap."""
    times, headings = np.array(sorted(yaws)).T
    at, x, y = np.array(sorted(places)).T
    times, which = np.unique(times, return_index=True)
    after = np.searchsorted(at, times)
    before_gap = times - at[np.maximum(np.searchsorted(at, times, side="right") - 1, 0)]
    after_gap = at[np.minimum(after, len(at) - 1)] - times
    known = np.abs(before_gap) + np.abs(after_gap) <= _MAX_GAP
    poses = np.column_stack([np.interp(times, at, x), np.interp(times, at, y), np.unwrap(headings[which])])
    return times[known], poses[known]


_CORRECTIONS = np.array([correction(mm / 1000.0) for mm in range(2**16 // 4 + 1)])
"""Corrections of angles [rad], by range [mm]."""
