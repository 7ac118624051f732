"""A joint start: robots begin to run within one control cycle of each other, or all of them stop.

One computer, the leader, has a connection of lines (clocks.py) to each robot, a follower. Both ends are here, without
input or output: they take lines and return lines, and the time is an argument [s].

    follower                          leader
    ready     all devices send what is needed, the wheels are at rest
                                      start     at a time of the robot's own clock, LEAD from now
    accepted  or failed, if that time is over already
                                      go        all robots have accepted; without this a robot does not begin
    going
    started   its first control cycle has begun
                                      confirm   all robots have started, within one cycle
    confirmed from now on the robot needs no leader; while there is one, it obeys a stop
    failed    the run has ended, for any reason
                                      stop      another robot has failed: the wheels stop, the run ends

From `ready` to `confirmed` the leader sends probes, which also measure the clocks. Each end gives up when it has
received nothing for SILENCE, or when the connection has ended. So a robot without a leader is armed no longer than
that. `go` is sent more than SILENCE before the start: a connection that fails meanwhile stops all robots. A robot that
fails in the last SILENCE before the start cannot prevent the others from starting: they stop as soon as the leader
notices, after SILENCE at the latest.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from mercator_design.robot.protocols.clocks import (
    PROBE,
    Clock,
    ClockDifference,
    answer,
    day_of,
    from_line,
    number_of,
    probe,
    to_line,
)

SILENCE = 1.0
"""[s] without a line from the other end after which a robot is not started, or is stopped."""
LEAD = 3.0
"""[s] from sending the time of the start until that time."""
_ANSWER_LIMIT = 0.8  # [s] for each of accepted, going and confirmed; three of them are shorter than LEAD
_MIN_ANSWERS = 10  # that measure a clock
_CLOCK_LIMIT = 5.0  # [s] for measuring the clocks
_MAX_LEAD = 60.0  # [s] to a start


@dataclass(frozen=True, kw_only=True)
class Reference:
    """The leader's clock, as the leader has measured it for a follower."""

    host: str  # the leader's name
    offset: float  # [s] to add to the follower's monotonic clock to get the leader's time of day
    uncertainty: float  # [s] upper limit of the error of the offset


class Follower:
    """A robot's end of the connection.

    at: Time of the start [s]; None before the leader has sent it.
    reference: The leader's clock; None before the leader has sent it.
    why: Why the robot must not begin, or must stop; empty if it may run.
    """

    def __init__(self) -> None:
        self.at: float | None = None
        self.reference: Reference | None = None
        self.why = ""
        self._heard = math.inf  # time of the leader's latest line, from `ready` on
        self._may_go = self._is_confirmed = False

    def be_ready(self, now: float, **values: object) -> str:
        """The line that says that the robot is ready, with values; from now on the leader is needed."""
        self._heard = now
        return to_line("ready", **values)

    def receive(self, line: bytes, now: float) -> str | None:
        """Take a line that came at a time [s]; return the line that answers it, if any."""
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
        if at - now > _MAX_LEAD:
            return self.fail(f"expected a start within {_MAX_LEAD:g} s, found one in {at - now:.0f} s")
        self.at, self.reference = at, reference
        return to_line("accepted")

    def check_silence(self, now: float) -> None:
        """End the run if the leader has been silent for too long."""
        if now - self._heard > SILENCE and not self._is_confirmed:
            self._end(f"nothing received for {SILENCE:g} s from the computer that starts the robots")

    def hang_up(self) -> None:
        """Take in that the connection has ended."""
        if not self._is_confirmed:
            self._end("the connection to the computer that starts the robots has ended")

    def begin(self, now: float, cycle: float) -> str:
        """The line that reports the first control cycle, of `cycle` seconds; if it must not begin, `why` is set."""
        self.check_silence(now)
        if self.at is None or not self._may_go:
            self._end("the start was not confirmed by all robots in time")
        elif not 0.0 <= now - self.at <= cycle:
            self._end(f"the start is late by {now - self.at:.2f} s: is this computer too busy?")
        return to_line("failed", why=self.why) if self.why else to_line("started", at=now)

    def fail(self, why: str) -> str:
        """End the run for a reason; the line that reports it."""
        self._end(why)
        return to_line("failed", why=self.why)

    def _end(self, why: str) -> None:
        self.why = self.why or why or "called off"


@dataclass
class _Robot:
    """What the leader knows about a follower."""

    clock: Clock = field(default_factory=Clock)
    difference: ClockDifference = ClockDifference(0.0, 0.0, math.inf)
    said: dict[str, dict[str, Any]] = field(default_factory=dict)
    heard: float = math.inf
    probed: float = -math.inf
    began: float = math.nan


class Leader:
    """The end of the computer that starts the robots.

    why: Why the start was called off; empty if it was not.
    culprit: The robot that was the reason; empty if none was.
    is_over: Whether all robots run, or the start was called off.
    """

    def __init__(self, names: Iterable[str], now: float, *, patience: float, cycle: float, host: str) -> None:
        """Make a leader that waits for robots to be ready.

        Args:
            names: The robots' names.
            now: The time [s].
            patience: Time until they must be ready [s].
            cycle: Time within which all must begin [s].
            host: This computer's host name.
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
        """Take out the lines that are to be sent, each with the name of its robot."""
        out, self._out = self._out, []
        return out

    def receive(self, name: str, line: bytes, now: float) -> None:
        """Take a line of a robot, received at a time [s]."""
        said = from_line(line)
        if said is None:
            return
        robot = self._robots[name]
        robot.heard = now
        try:
            match said["say"]:
                case "clock":
                    robot.clock.take(said, now)
                case "failed":
                    self.call_off(str(said.get("why")), name)
                case "started":
                    robot.began = number_of(said, "at") + robot.difference.offset
                    robot.said["started"] = said
                case "ready" | "accepted" | "going" | "confirmed" as what:
                    robot.said[what] = said
        except ValueError as error:
            self.call_off(f"{said['say']}: {error}", name)

    def advance(self, now: float) -> None:
        """Do what is due at a time [s]; `receive` has taken all lines received until then."""
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
        """Start no robot, and stop those that have started."""
        if self.is_over:
            return
        self.is_over, self.why, self.culprit = True, why, culprit
        words = f"the start was called off: {self.reason}"
        self._out = [(name, to_line("stop", why=words)) for name in self._robots]

    @property
    def reason(self) -> str:
        """The robot that was the reason, if one was, and why the start was called off."""
        return f"{self.culprit}: {self.why}" if self.culprit else self.why

    def ready(self, name: str) -> dict[str, Any]:
        """The values of a robot's `ready`; empty if it has not been ready."""
        return self._robots[name].said.get("ready", {})

    def difference(self, name: str) -> ClockDifference:
        """The difference of a robot's clock when the start was sent."""
        return self._robots[name].difference

    def began(self, name: str) -> float:
        """How long after the first robot this robot began [s]."""
        return self._robots[name].began - min(robot.began for robot in self._robots.values())

    def spread(self) -> tuple[float, float]:
        """The time between the first and the last robot's beginning, and its uncertainty [s]."""
        apart = [
            (abs(one.began - other.began), one.difference.uncertainty + other.difference.uncertainty)
            for one, other in itertools.combinations(self._robots.values(), 2)
        ]
        return max(apart, key=sum, default=(0.0, 0.0))

    def _all_steps(self) -> Iterator[tuple[Callable[[_Robot], bool], float, str]]:
        """The steps of a start, in order: whether a robot is done, the time limit, and the reason if it is not done."""
        yield self._has_said("ready"), self._now + self._patience, f"it was not ready after {self._patience:g} s"
        # The errors of two robots' clocks may add up.
        known = 0.5 * self._cycle
        yield (
            lambda robot: len(robot.clock) >= _MIN_ANSWERS and robot.clock.difference.uncertainty <= known,
            self._now + _CLOCK_LIMIT,
            f"its clock is known to {{uncertainty:.0f}} ms; the limit is {1000.0 * known:.0f} ms: slow connection",
        )
        self._at = self._now + LEAD
        for name, robot in self._robots.items():
            robot.difference = found = robot.clock.difference
            at, offset = self._at - found.offset, found.offset + day_of(self._now) - self._now
            line = to_line("start", at=at, host=self._host, offset=offset, uncertainty=found.uncertainty)
            self._out.append((name, line))
        yield self._has_said("accepted"), self._now + _ANSWER_LIMIT, "it did not accept the start in time"
        self._send_all("go")
        yield self._has_said("going"), self._now + _ANSWER_LIMIT, "it did not confirm the start in time"
        yield self._has_said("started"), self._at + self._cycle + SILENCE, "it did not report its start"
        spread, uncertainty = self.spread()
        if spread + uncertainty > self._cycle:
            self.call_off(
                f"the robots began {1000.0 * spread:.0f} ms apart, give or take {1000.0 * uncertainty:.0f} ms; "
                f"the limit is {1000.0 * self._cycle:.0f} ms: are their computers too busy?"
            )
        else:
            self._send_all("confirm")
        what = "it did not confirm that it runs; it may run on"
        yield self._has_said("confirmed"), self._now + _ANSWER_LIMIT, what
        self.is_over = True

    def _send_all(self, say: str) -> None:
        self._out += [(name, to_line(say)) for name in self._robots]

    @staticmethod
    def _has_said(what: str) -> Callable[[_Robot], bool]:
        return lambda robot: what in robot.said
