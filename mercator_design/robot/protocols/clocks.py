"""Measure the clock of another computer over a connection of lines, by the formula of NTP (RFC 5905, section 8).

One end sends probes; the other answers each at once with its clocks. The clocks were read at some time between the
sending of the probe and the receipt of the answer, so the middle of the two is wrong by at most half their difference.
The answer with the shortest delay is used. Times are those of `time.monotonic`, which no user can set, unless they
are called times of day.

A line is a JSON object, and its key `say` names its kind. Other lines are ignored: a login shell may print something.
"""

import json
import math
import time
from collections import deque
from collections.abc import Mapping
from typing import Any, NamedTuple

PROBE = 0.1
"""[s] between probes."""
_MAX_ANSWERS = 100  # that are kept; clocks drift, so old ones are forgotten
_MAX_NUMBER = 1e12
_READS = 10  # of both clocks of this computer at most
_APART = 1e-4  # [s] within which both are read, unless the program is interrupted in all reads


class ClockDifference(NamedTuple):
    """The difference between the clocks of this computer and those of another."""

    offset: float  # [s] to add to the other's monotonic clock to get this one's
    ahead: float  # [s] by which the other's time of day is ahead of this one's
    uncertainty: float  # [s] upper limit of the error of both

    def __str__(self) -> str:
        side = "ahead" if self.ahead > 0.0 else "behind"
        return f"{abs(self.ahead):.3f} s {side}, give or take {1000.0 * self.uncertainty:.1f} ms"


def to_line(say: str, **values: object) -> str:
    """The line of a message, by its kind and its values."""
    return json.dumps({"say": say, **values}, allow_nan=False) + "\n"


def from_line(line: bytes) -> dict[str, Any] | None:
    """The values of a message, with `say`; None if the line is no message."""
    try:
        said = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return said if isinstance(said, dict) and isinstance(said.get("say"), str) else None


def number_of(said: Mapping[str, Any], key: str) -> float:
    """The number under a key of a message.

    Raises:
        ValueError: if it is missing or not a number.
    """
    value: Any = said.get(key)
    if type(value) not in {int, float} or not abs(value) <= _MAX_NUMBER:
        raise ValueError(f"expected a number for {key}, found {value!r:.60}")
    return float(value)


def probe(now: float) -> str:
    """The line that asks for the other's clocks; `now` is the time at which it is sent [s]."""
    return to_line("probe", sent=now)


def answer(said: Mapping[str, Any], monotonic: float, day: float) -> str | None:
    """The answer to a probe that was received at a time of the monotonic clock and of the day [s].

    None if the probe has no valid time.
    """
    try:
        return to_line("clock", sent=number_of(said, "sent"), monotonic=monotonic, day=day)
    except ValueError:
        return None


def day_of(monotonic: float) -> float:
    """The time of day [s since 1970] at a time of this computer's monotonic clock.

    Another program may get the processor between the reads of the two clocks: so they are read again if that took long.
    """
    shortest, offset = math.inf, 0.0
    for _ in range(_READS):
        before, day, after = time.monotonic(), time.time(), time.monotonic()
        if after - before < shortest:
            shortest, offset = after - before, day - 0.5 * (before + after)
        if shortest <= _APART:
            break
    return monotonic + offset


class Clock:
    """The clock of another computer, measured by its answers."""

    def __init__(self) -> None:
        self._found: deque[ClockDifference] = deque(maxlen=_MAX_ANSWERS)

    def __len__(self) -> int:
        """The number of answers that are kept."""
        return len(self._found)

    def take(self, said: Mapping[str, Any], now: float) -> None:
        """Take an answer that was received at a time [s].

        Raises:
            ValueError: if it is not a valid answer.
        """
        sent, monotonic, day = (number_of(said, key) for key in ("sent", "monotonic", "day"))
        if not sent <= now:
            raise ValueError(f"expected an answer to a probe sent before {now}, found {sent}")
        middle = 0.5 * (sent + now)
        self._found.append(ClockDifference(middle - monotonic, day - day_of(middle), 0.5 * (now - sent)))

    @property
    def difference(self) -> ClockDifference:
        """The difference with the smallest uncertainty; without an answer it is infinite."""
        return min(self._found, key=lambda found: found.uncertainty, default=ClockDifference(0.0, 0.0, math.inf))
