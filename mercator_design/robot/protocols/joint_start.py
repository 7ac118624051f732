"""A joint start: robots begin to run within one control cycle of each other, or none goes on.

One computer, the leader, has a connection of lines (clocks.py) to each robot, a follower. Both ends are here, without
input or output: lines in, lines out, and the time is an argument [s].

    follower                          leader
    ready     all devices tell what is needed, the wheels are at rest
                                      start     at a time of the robot's own clock, LEAD from now
    accepted  or failed, if that is over already
                                      go        when all have accepted; a robot begins only if it has heard this
    going
    started   when its first control cycle has begun
                                      confirm   when all have started, and together
    confirmed from now on the robot needs no leader; as long as there is one, it obeys a stop
    failed    whatever ended the run
                                      stop      whatever happened to another robot: the wheels stop, the run ends

From `ready` to `confirmed` the leader sends probes, which measure the clocks too, and each end gives up when it has
heard nothing for SILENCE, or when the connection has ended. So a robot without a leader is armed no longer than that.
`go` is said more than SILENCE before the start: no connection that fails meanwhile leaves some robots with it and
others without. A robot that fails in the last SILENCE before the start cannot keep the others from starting: they are
stopped as soon as that is seen, after SILENCE at the latest.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from mercator_design.robot.protocols.clocks import (
    PROBE,
    Clock,
    Difference,
    answer,
    day_of,
    from_line,
    number_of,
    probe,
    to_line,
)

SILENCE = 1.0
"""[s] without a word from the other end after which a robot is not started, or is stopped."""
LEAD = 3.0
"""[s] from when the time of the start is said until it is there."""
_ANSWER = 0.8  # [s] that robots may take to say that they have accepted, go and have confirmed; thrice less than LEAD
_PROBES = 10  # answers for a clock to be known ...
_PATIENCE = 5.0  # ... and [s] to wait until it is known well enough
_FURTHEST = 60.0  # [s] to a start


@dataclass(frozen=True, kw_only=True)
class Reference:
    """The leader's clock, as a follower is told of it.

    host: Whose clock it is.
    offset: What is to be added to a time of the follower's monotonic clock to have the leader's time of the day [s].
    uncertainty: Of that [s].
    """

    host: str
    offset: float
    uncertainty: float


class Follower:
    """A robot's end.

    at: When to begin [s]; None if that is not said yet.
    reference: The leader's clock; None as `at`.
    why: Why the robot must not begin, or must stop; empty if it need not.
    """

    def __init__(self) -> None:
        self.at: float | None = None
        self.reference: Reference | None = None
        self.why = ""
        self._heard = math.inf  # when the leader was; from `ready` on
        self._may_go = self._is_confirmed = False

    def be_ready(self, now: float, **values: object) -> str:
        """From now on the leader is needed; what to say, with values."""
        self._heard = now
        return to_line("ready", **values)

    def hear(self, line: bytes, now: float) -> str | None:
        """Take a line at a time; what to answer."""
        said = from_line(line)
        if said is None:
            return None
        if self._heard < math.inf:
            self._heard = now
        match said["say"]:
            case "probe":
                return answer(said, now, day_of(now))
            case "start" if not self.why:
                return self._consider(said, now)
            case "go" if self.at is not None and not self.why:
                self._may_go = True
                return to_line("going")
            case "confirm" if not self.why:
                self._is_confirmed = True
                return to_line("confirmed")
            case "stop":
                self._end(str(said.get("why", "")))
        return None

    def _consider(self, said: dict[str, Any], now: float) -> str:
        try:
            at = number_of(said, "at")
            reference = Reference(
                host=str(said.get("host")),
                offset=number_of(said, "offset"),
                uncertainty=number_of(said, "uncertainty"),
            )
        except ValueError as error:
            return self.fail(f"the start: {error}")
        if at <= now:
            return self.fail(f"the time of the start came too late: it was {now - at:.2f} s ago")
        if at - now > _FURTHEST:
            return self.fail(f"expected a start within {_FURTHEST:g} s, found one in {at - now:.0f} s")
        self.at, self.reference = at, reference
        return to_line("accepted")

    def look(self, now: float) -> None:
        """See whether the leader is still heard."""
        if now - self._heard > SILENCE and not self._is_confirmed:
            self._end(f"nothing was heard for {SILENCE:g} s of who starts the robots")

    def hang_up(self) -> None:
        """The connection has ended."""
        if not self._is_confirmed:
            self._end("the connection to who starts the robots has ended")

    def begin(self, now: float, cycle: float) -> str:
        """The first control cycle, of so many seconds, begins now: what to say. If it must not, `why` says so."""
        self.look(now)
        if not self.why and (self.at is None or not self._may_go):
            self._end("the start was not confirmed by all robots in time")
        if not self.why and self.at is not None and not 0.0 <= now - self.at <= cycle:
            self._end(f"too late by {now - self.at:.2f} s for the start: is this computer too busy?")
        return to_line("failed", why=self.why) if self.why else to_line("started", at=now)

    def fail(self, why: str) -> str:
        """Something has ended the run: what to say."""
        self._end(why)
        return to_line("failed", why=self.why)

    def _end(self, why: str) -> None:
        self.why = self.why or why or "called off"


@dataclass
class _Robot:
    """What the leader knows of a follower."""

    clock: Clock = field(default_factory=Clock)
    difference: Difference = Difference(0.0, 0.0, math.inf)
    said: dict[str, dict[str, Any]] = field(default_factory=dict)
    heard: float = math.inf
    probed: float = -math.inf
    began: float = math.nan


class Leader:
    """The end of who starts robots.

    why: Why the start was called off; empty if it was not.
    culprit: The robot that was the reason; empty if none was.
    is_over: Whether all robots run, or it was called off.
    """

    def __init__(self, names: Iterable[str], now: float, *, patience: float, cycle: float, host: str) -> None:
        """Begin to wait for robots to be ready.

        Args:
            names: Of the robots.
            now: The time [s].
            patience: Time until they must be ready [s].
            cycle: Time within which all must begin [s].
            host: What this computer is called.
        """
        self._robots = {name: _Robot() for name in names}
        self._now, self._cycle, self._host = now, cycle, host
        self._out: list[tuple[str, str]] = []
        self._at = math.inf
        self.why = self.culprit = ""
        self.is_over = False
        self._steps = self._all_steps()
        self._patience = patience
        self._step: tuple[Callable[[_Robot], bool], float, str] = next(self._steps)

    def lines(self) -> list[tuple[str, str]]:
        """What is to be sent: names and lines."""
        out, self._out = self._out, []
        return out

    def hear(self, name: str, line: bytes, now: float) -> None:
        """Take a line of a robot."""
        said = from_line(line)
        if said is None:
            return
        robot = self._robots[name]
        robot.heard = now
        try:
            match said["say"]:
                case "clock":
                    robot.clock.hear(said, now)
                case "failed":
                    self.call_off(str(said.get("why")), name)
                case "started":
                    robot.began = number_of(said, "at") + robot.difference.offset
                    robot.said["started"] = said
                case what:
                    robot.said[what] = said
        except ValueError as error:
            self.call_off(f"{said['say']}: {error}", name)

    def hang_up(self, name: str, why: str) -> None:
        """The connection to a robot has ended."""
        self.call_off(why, name)

    def advance(self, now: float) -> None:
        """Do what is due; what has been received by now was heard before."""
        self._now = now
        for name, robot in self._robots.items():
            if self.is_over or "ready" not in robot.said:
                continue
            if now - robot.heard > SILENCE:
                self.call_off(f"it has not answered for {SILENCE:g} s", name)
            elif now - robot.probed >= PROBE:
                robot.probed = now
                self._out.append((name, probe(now)))
        while not self.is_over:
            done, until, words = self._step
            lacking = [name for name, robot in self._robots.items() if not done(robot)]
            if not lacking:
                self._step = next(self._steps, self._step)
            elif now > until:
                robot = self._robots[lacking[0]]
                self.call_off(words.format(uncertainty=1000.0 * robot.clock.difference.uncertainty), lacking[0])
            else:
                return

    def call_off(self, why: str, culprit: str = "") -> None:
        """Nobody starts, and who has started is stopped."""
        if self.is_over:
            return
        self.is_over, self.why, self.culprit = True, why, culprit
        words = f"the start was called off: {self.reason}"
        self._out = [(name, to_line("stop", why=words)) for name in self._robots]

    @property
    def reason(self) -> str:
        """Which robot is why the start was called off, and why."""
        return f"{self.culprit}: {self.why}" if self.culprit else self.why

    def ready(self, name: str) -> dict[str, Any]:
        """What a robot said when it was ready; empty if it has not been."""
        return self._robots[name].said.get("ready", {})

    def difference(self, name: str) -> Difference:
        """Of a robot's clock, as it was when the start was said."""
        return self._robots[name].difference

    def began(self, name: str) -> float:
        """How long after the first robot another began [s]."""
        return self._robots[name].began - min(robot.began for robot in self._robots.values())

    def spread(self) -> tuple[float, float]:
        """How long after the first robot the last began [s], and by how much that may be wrong."""
        pairs = [*itertools.combinations(self._robots.values(), 2)]
        apart = [
            (abs(one.began - other.began), one.difference.uncertainty + other.difference.uncertainty)
            for one, other in pairs
        ]
        return max(apart, key=sum, default=(0.0, 0.0))

    def _all_steps(self) -> Iterator[tuple[Callable[[_Robot], bool], float, str]]:
        """What all robots must do one after the other: whether one has, until when, and what is wrong if it has not."""
        yield self._has_said("ready"), self._now + self._patience, f"it was not ready after {self._patience:g} s"
        # Of two robots each may be wrong by its uncertainty, in opposite directions.
        known = 0.5 * self._cycle
        yield (
            lambda robot: len(robot.clock) >= _PROBES and robot.clock.difference.uncertainty <= known,
            self._now + _PATIENCE,
            f"its clock is known to {{uncertainty:.0f}} ms, must be to {1000.0 * known:.0f} ms: the connection is slow",
        )
        self._at = self._now + LEAD
        for name, robot in self._robots.items():
            robot.difference = found = robot.clock.difference
            self._out.append((name, self._offer(found)))
        yield self._has_said("accepted"), self._now + _ANSWER, "it did not accept the start in time"
        self._tell_all("go")
        yield self._has_said("going"), self._now + _ANSWER, "it did not confirm the start in time"
        yield self._has_said("started"), self._at + self._cycle + SILENCE, "it did not report its start"
        spread, uncertainty = self.spread()
        if spread + uncertainty > self._cycle:
            self.call_off(
                f"the robots began {1000.0 * spread:.0f} ms apart, give or take {1000.0 * uncertainty:.0f} ms; "
                f"expected {1000.0 * self._cycle:.0f} ms at most: are their computers too busy?"
            )
        else:
            self._tell_all("confirm")
        yield self._has_said("confirmed"), self._now + _ANSWER, "it did not confirm that it runs; it may run on"
        self.is_over = True

    def _offer(self, found: Difference) -> str:
        offset = found.offset + day_of(self._now) - self._now
        return to_line(
            "start", at=self._at - found.offset, host=self._host, offset=offset, uncertainty=found.uncertainty
        )

    def _tell_all(self, say: str) -> None:
        self._out += [(name, to_line(say)) for name in self._robots]

    @staticmethod
    def _has_said(what: str) -> Callable[[_Robot], bool]:
        return lambda robot: what in robot.said
