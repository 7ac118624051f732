"""Judges the turns of a lidar: turns without a reading, sectors without one, and parts of the robot in its view."""

import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from statistics import median_low
from typing import NamedTuple

from mercator_design.robot.devices.sweep import BINS, STEP, Sector, covered

MIN_READINGS = 2
"""Readings in a turn in which something is seen."""
SURE_READINGS = 5
"""Readings in a turn that do not all vanish in the next one by chance, as those of something far away may."""
NEAREST = 0.22
"""[m] Robots that touch see each other's lidars at 0.25 m; what is nearer is on the robot itself."""
NOTED = 2.0
"""[s] without a reading after which users are told."""
REMEDY = (
    "is there nothing at its height within 12 m, is it covered, or has its laser failed (5 V and 1 A, or replace it)?"
)
FLICKER_REMEDY = "has it 5 V and 1 A, and a cable for both? If so, its laser fails: replace it"

_CALM = 10.0  # [s] without an empty turn, after which the next one is reported again
_TURNS = 28  # of a view that is judged in a run: 4 s
_STRAIGHT = math.radians(3.0)  # by which a robot may turn during a turn of the lidar that a view takes
_DEGREES = 360
_PASSING = 0.35
"""[rad] by which a robot that passes close by moves in a turn of the lidar."""
_EACH = BINS // _DEGREES
_MIN_BLANK = 20  # [degrees] of a sector that counts as blank
_MIN_SEEN = 120  # [degrees] in which something must be seen ...
_FILLED = 0.8  # ... and the part of the directions outside of blank sectors
_OFTEN = 0.8  # of the turns, in which a part of the robot is seen
_MARGIN = 1  # [degrees] on both sides of a part of the robot, which is seen there now and then


class LidarTurn(NamedTuple):
    """A turn that has ended."""

    time: float  # of its end [s]
    duration: float  # [s] since the end of the turn before; 0 of the first one
    readings: int

    @property
    def is_empty(self) -> bool:
        return self.readings < MIN_READINGS


def flickers(before: int, after: int) -> bool:
    """Whether turns without a reading were a fault, by the readings of the turns before and after them."""
    return min(before, after) >= SURE_READINGS


def _are_many(before: LidarTurn, after: LidarTurn, turned: float) -> bool:
    """Whether a working lidar cannot have missed them, on a robot that has turned by an angle [rad] in the meantime.

    A turn of the lidar ends where it begins. What moves over this direction while the robot turns, or passes, is in
    none of the samples of a turn. So each bin of that angle may have been a reading.
    """
    missed = (turned + _PASSING) / STEP
    return flickers(before.readings, after.readings) and min(before.readings, after.readings) > missed


class Sight:
    """Judges the turns of a lidar in a run.

    readings: Number of readings in the last turn.
    """

    def __init__(self, limit: float | None, blind: Sequence[Sector], nearest: float) -> None:
        """Make one before the first turn.

        Args:
            limit: Time [s] without a reading, of twice this time, after which the lidar has failed; None: never.
            blind: Sectors of which readings are ignored.
            nearest: Distance [m] below which readings are ignored.
        """
        self._limit, self._blind, self._nearest = limit, blind, nearest
        self._is_noted = self._has_own_parts = self._has_blank_sectors = False  # whether users were told so
        self._flickered = -math.inf  # time of the latest empty turn between others
        self._notes: list[str] = []
        self.forget()

    def forget(self) -> None:
        """Forget all turns. What was reported before is not reported again."""
        self.readings = 0
        self._turns: deque[LidarTurn] = deque()
        self._last: LidarTurn | None = None  # in which something was seen, or the first one
        self._heading = math.nan
        self._turned = 0.0  # since the latest turn in which something was seen [rad]
        self._view = View(self._blind, self._nearest)

    def take(self, readings: int, ranges: Sequence[float], heading: float, now: float) -> None:
        """Take in a turn that ended at a time [s].

        Args:
            readings: Number of its readings.
            ranges: Ranges by angle, in a frame in which the robot has the heading.
            heading: Heading of the robot [rad].
            now: The time.
        """
        self.readings = readings
        was_empty = bool(self._turns) and self._turns[-1].is_empty
        turned, self._heading = abs(math.remainder(heading - self._heading, math.tau)), heading
        self._turned += 0.0 if math.isnan(turned) else turned
        turn = LidarTurn(now, now - self._turns[-1].time if self._turns else 0.0, self.readings)
        self._turns.append(turn)
        span = NOTED if self._limit is None else 2.0 * self._limit
        while self._turns[0].time <= now - span:
            self._turns.popleft()
        before = self._last
        if before is None or not turn.is_empty:
            self._last = turn
        if turn.is_empty:
            return
        since, self._turned = self._turned, 0.0
        if self._is_noted:
            self._is_noted = False
            self._notes.append(f"it sees something again ({turn.readings} readings in a turn)")
        elif before is not None and was_empty and _are_many(before, turn, since):
            self._note_flicker(before, turn)
        if turned < _STRAIGHT:  # else the turn is of several headings
            self._view.take(ranges, heading)
        if self._view.turns >= _TURNS:
            self._judge()

    def check(self, now: float) -> list[str]:
        """The notes for users since the last call; at a time [s] at which nothing may have been seen for a while."""
        is_empty = bool(self._turns) and self._turns[-1].is_empty
        if self._last is not None and is_empty and not self._is_noted and now - self._last.time >= NOTED:
            self._is_noted = True
            self._notes.append(f"it has seen nothing for {NOTED:g} s; {REMEDY}")
        notes, self._notes = self._notes, []
        return notes

    def failure(self) -> str:
        """Why the lidar has failed; empty if it has not."""
        if self._limit is None:
            return ""
        blind = sum(turn.duration for turn in self._turns if turn.is_empty)
        if blind <= self._limit:
            return ""
        return f"it saw nothing in {blind:.1f} of the last {2.0 * self._limit:g} s; the limit is {self._limit:g} s"

    def _note_flicker(self, before: LidarTurn, after: LidarTurn) -> None:
        is_new = after.time - self._flickered > _CALM
        self._flickered = after.time
        if is_new:
            empty = sum(before.time < turn.time < after.time for turn in self._turns)
            turns = "a turn" if empty == 1 else f"{empty} turns"
            self._notes.append(
                f"it saw nothing in {turns} between turns with {before.readings} and {after.readings} readings, so "
                f"neighbours were missed; {FLICKER_REMEDY}"
            )

    def _judge(self) -> None:
        view, self._view = self._view, View(self._blind, self._nearest)
        if not self._has_own_parts and (found := view.own_parts()):
            self._has_own_parts = True
            self._notes.append(f"{found.words}; {found.remedy}")
        if not self._has_blank_sectors and (found := view.blank_sectors()):
            self._has_blank_sectors = True
            self._notes.append(f"{found.words}; {found.remedy}")


class Hidden(NamedTuple):
    """Sectors that a lidar cannot see."""

    words: str
    remedy: str


class View:
    """The directions from a robot in which its lidar sees something, over several turns.

    turns: Number of turns.
    """

    def __init__(self, blind: Sequence[Sector] = (), nearest: float = 0.0) -> None:
        """Make one without a turn; the arguments are those of `Sight`."""
        self.turns = 0
        self._own = [*blind]
        self._nearest = nearest
        self._seen = [0] * _DEGREES  # turns
        self._near = [0] * _DEGREES
        self._distances: list[list[float]] = [[] for _ in range(_DEGREES)]  # of what is near [m]
        ignored = covered(blind)
        self._is_blind = [any(ignored[_EACH * k : _EACH * (k + 1)]) for k in range(_DEGREES)]

    def take(self, ranges: Sequence[float], heading: float = 0.0) -> None:
        """Take in the ranges of a turn, in a frame in which the robot has a heading [rad]."""
        self.turns += 1
        shift = round(heading / STEP) % BINS
        turned = [*ranges[shift:], *ranges[:shift]]
        for k in range(_DEGREES):
            self._seen[k] += any(r and r >= self._nearest for r in turned[_EACH * k : _EACH * (k + 1)])
        near = {i // _EACH: r for i, r in enumerate(turned) if self._nearest <= r < NEAREST}
        for k, distance in near.items():
            self._near[k] += 1
            self._distances[k].append(distance)

    def own_parts(self) -> Hidden | None:
        """The parts of the robot that the lidar sees in most turns; None if it sees none."""
        sectors = [
            (first, last)
            for first, last in _runs(lambda k: self._near[k] > 0)
            if max(self._near[k % _DEGREES] for k in range(first, last)) >= _OFTEN * self.turns
        ]
        if not sectors:
            return None
        distances = [r for first, last in sectors for k in range(first, last) for r in self._distances[k % _DEGREES]]
        wide = [(first - _MARGIN, last + _MARGIN) for first, last in sectors]
        words = f"it sees something at {median_low(distances):.2f} m {_named(wide)}, and takes it for a neighbour"
        if sum(last - first for first, last in sectors) > _DEGREES // 2:
            return Hidden(words, "is it covered? No robot can be so near")
        proposal = self._proposal(wide)
        return Hidden(words, f"no robot can be so near: if it is a post of this robot, {proposal}; else take it away")

    def blank_sectors(self) -> Hidden | None:
        """The sectors in which nothing was seen in any turn, though nearly everywhere else; None if there is none."""
        sectors = [
            (first, last)
            for first, last in _runs(lambda k: not (self._seen[k] or self._is_blind[k]))
            if last - first >= _MIN_BLANK
        ]
        blank = sum(last - first for first, last in sectors) + sum(self._is_blind)
        seen = sum(map(bool, self._seen))
        if not sectors or seen < max(_MIN_SEEN, _FILLED * (_DEGREES - blank)):
            return None
        words = (
            f"it sees nothing {_named(sectors)}, but something in {100.0 * seen / (_DEGREES - blank):.0f} % of the rest"
        )
        return Hidden(words, f"is something before it? If it cannot be taken away, {self._proposal(sectors)}")

    def _proposal(self, sectors: list[tuple[int, int]]) -> str:
        found = [[_angle(first), _angle(last)] for first, last in sectors]
        given = [[float(f"{first:g}"), float(f"{last:g}")] for first, last in self._own]
        listed = ", ".join(f"[{first:g}, {last:g}]" for first, last in given + found)
        return f"put `lidar: {{blind: [{listed}]}}` into robot.yaml"


def _runs(holds: Callable[[int], bool]) -> Iterator[tuple[int, int]]:
    """The runs of degrees for which something holds, each from its first to behind its last, perhaps beyond 360."""
    marks = [holds(k) for k in range(_DEGREES)]
    if all(marks):
        yield 0, _DEGREES
        return
    start = marks.index(False)
    first = None
    for k in range(start, start + _DEGREES + 1):
        if marks[k % _DEGREES] and first is None:
            first = k
        elif not marks[k % _DEGREES] and first is not None:
            yield first, k
            first = None


def _named(sectors: list[tuple[int, int]]) -> str:
    if any(last - first >= _DEGREES for first, last in sectors):
        return "all around"
    return " and ".join(f"from {_angle(first)} to {_angle(last)} degrees" for first, last in sectors)


def _angle(degrees: int) -> int:
    return degrees % _DEGREES
