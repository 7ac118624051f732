"""The clock of another computer, measured over a connection of lines, by the formula of NTP (RFC 5905, section 8).

One end sends probes, the other answers each at once with its clocks. The true time of an answer lies between the
sending of its probe and the receipt of the answer, so the middle of these is wrong by at most half the time in between.
Of many answers the one that took the shortest time counts. Times are of `time.monotonic`, which nobody sets, except
where it is said that they are of the day.

A line is a JSON object, and its key `say` tells what it is. Other lines are ignored: a login shell may print something.
"""

import json
import math
import time
from collections import deque
from collections.abc import Mapping
from typing import Any, NamedTuple

PROBE = 0.1
"""[s] between probes."""
_KEPT = 100  # answers; clocks drift, so old ones are forgotten
_LARGEST = 1e12  # [s]


class Difference(NamedTuple):
    """Between the clock of this computer and that of another.

    offset: What is to be added to a time of the other's monotonic clock [s].
    ahead: How far the other's clock of the day is ahead of this one's [s].
    uncertainty: Of both [s]: neither is wrong by more than that.
    """

    offset: float
    ahead: float
    uncertainty: float


def to_line(say: str, **values: object) -> str:
    """A line that says something."""
    return json.dumps({"say": say, **values}, allow_nan=False) + "\n"


def from_line(line: bytes) -> dict[str, Any] | None:
    """What a line says, with `say`; None if it is no such line."""
    try:
        said = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return said if isinstance(said, dict) and isinstance(said.get("say"), str) else None


def number_of(said: Mapping[str, Any], key: str) -> float:
    """A number that was said.

    Raises:
        ValueError: if it is missing or no number.
    """
    value: Any = said.get(key)
    if type(value) not in {int, float} or not abs(value) <= _LARGEST:
        raise ValueError(f"expected a number for {key}, found {value!r:.60}")
    return float(value)


def probe(now: float) -> str:
    """A line that asks for the other's clocks, at a time [s]."""
    return to_line("probe", sent=now)


def answer(said: Mapping[str, Any], monotonic: float, day: float) -> str:
    """The answer to a probe that was heard at a time of the monotonic clock and of the day [s]."""
    return to_line("clock", sent=said.get("sent"), monotonic=monotonic, day=day)


def day_of(monotonic: float) -> float:
    """The time of the day [s since 1970] at a time of this computer's monotonic clock."""
    return monotonic + time.time() - time.monotonic()


class Clock:
    """The clock of another computer, as its answers tell."""

    def __init__(self) -> None:
        self._found: deque[Difference] = deque(maxlen=_KEPT)

    def __len__(self) -> int:
        """How many answers count."""
        return len(self._found)

    def hear(self, said: Mapping[str, Any], now: float) -> None:
        """Take an answer that came at a time [s].

        Raises:
            ValueError: if it is none.
        """
        sent, monotonic, day = (number_of(said, key) for key in ("sent", "monotonic", "day"))
        if not sent <= now:
            raise ValueError(f"expected an answer to what was sent before {now}, found {sent}")
        middle = 0.5 * (sent + now)
        self._found.append(Difference(middle - monotonic, day - day_of(middle), 0.5 * (now - sent)))

    @property
    def difference(self) -> Difference:
        """The best that is known; nothing is known to infinity."""
        return min(self._found, key=lambda found: found.uncertainty, default=Difference(0.0, 0.0, math.inf))
