"""When a run begins: at once, or together with other robots, at a time agreed over standard input and output."""

import contextlib
import threading
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from mercator_design.errors import RobotStopped
from mercator_design.robot.logs.events import ClockOffset
from mercator_design.robot.protocols.clocks import day_of
from mercator_design.robot.protocols.joint_start import Follower
from mercator_design.robot.run.channel import Channel
from mercator_design.robot.run.control import Control

if TYPE_CHECKING:
    from mercator_design.robot.run.safety import Brake

_CHECK_EVERY = 0.05  # [s] between checks of the devices
_ARM_AHEAD = 0.05  # [s] before the first control cycle


class ImmediateStart:
    """A run that begins when its robot has started up."""

    def listening(self) -> contextlib.AbstractContextManager[object]:
        """The context in which lines of the leader are read."""
        return contextlib.nullcontext()

    @contextlib.contextmanager
    def taking_part(self, control: Control, log: Path) -> Iterator[None]:  # noqa: ARG002 - as in `AwaitedStart`
        """The context of the run, from the robot's start-up to the end."""
        yield

    def clock(self) -> ClockOffset | None:
        """The measured offset of this computer's clock, for the log; None if it was not measured."""
        return None

    def wait(self, control: Control) -> None:
        """Wait until it is time to be armed."""

    def due(self) -> float:
        """The time of the first control cycle [s]."""
        return time.monotonic()

    def begin(self, now: float, cycle: float) -> None:
        """Take in that the first control cycle, of `cycle` seconds, begins at a time [s]."""


class AwaitedStart(ImmediateStart):
    """A run that begins together with others (robot/protocols/joint_start.py).

    A thread reads the leader's lines, and pulls the brake if the leader sends a stop or falls silent.
    """

    def __init__(self) -> None:
        self._follower, self._lock = Follower(), threading.Lock()
        self._brake: Brake | None = None
        self._channel = Channel(self._receive, self._fail)

    def listening(self) -> contextlib.AbstractContextManager[object]:
        return self._channel

    @contextlib.contextmanager
    def taking_part(self, control: Control, log: Path) -> Iterator[None]:
        """The context of the run: report `ready` to the leader, wait for the start time, and report the end.

        Raises:
            RobotStopped: if the start was called off, the leader is silent, or as `Control.wait`.
        """
        try:
            control.await_heartbeat()
            with self._lock:
                self._brake = control.robot.brake
                self._send(self._follower.be_ready(time.monotonic(), log=str(log)))
            while self._follower.at is None:
                self._attend(control, time.monotonic() + _CHECK_EVERY)
            yield
        except BaseException as error:
            why = str(error) or type(error).__name__
            control.robot.brake.stop(why)  # before anything waits for the thread or for the leader
            with self._lock:
                self._send(self._follower.fail(why))
            raise

    def clock(self) -> ClockOffset | None:
        """How far this computer's time of day is ahead of the leader's [s] now, and the uncertainty."""
        reference = self._follower.reference
        if reference is None:
            return None
        ahead = day_of(0.0) - reference.offset
        return ClockOffset(reference.host, ahead=round(ahead, 6), uncertainty=round(reference.uncertainty, 6))

    def wait(self, control: Control) -> None:
        """As `ImmediateStart.wait`; raises as `taking_part`."""
        end = self.due() - _ARM_AHEAD
        while (now := time.monotonic()) < end:
            self._attend(control, min(now + _CHECK_EVERY, end))

    def due(self) -> float:
        """The time of the first control cycle [s], within `taking_part`."""
        if self._follower.at is None:
            raise RobotStopped("no time of the start received")
        return self._follower.at

    def begin(self, now: float, cycle: float) -> None:
        """As `ImmediateStart.begin`; raises `RobotStopped` if the run must not begin."""
        with self._lock:
            self._send(self._follower.begin(now, cycle))
            why = self._follower.why
        if why:
            raise RobotStopped(why)

    def _attend(self, control: Control, until: float) -> None:
        """Read the devices until a time [s], and check that the robot can begin."""
        control.wait(until)
        control.refresh()
        control.robot.check_ages()
        control.robot.query()
        if self._follower.why:
            raise RobotStopped(self._follower.why)

    def _receive(self, lines: Iterable[bytes] | None, now: float) -> None:
        with self._lock:
            for line in lines or ():
                if (said := self._follower.receive(line, now)) is not None:
                    self._send(said)
            if lines is None:
                self._follower.hang_up()
            self._follower.check_silence(now)
            if self._follower.why:
                self._stop(self._follower.why)

    def _fail(self) -> None:
        with self._lock:
            self._follower.fail("the thread that reads the leader's lines failed")
            self._stop(self._follower.why)

    def _stop(self, why: str) -> None:
        if self._brake is not None and not self._brake.why:
            self._brake.stop(why)

    def _send(self, line: str) -> None:
        if not self._channel.write(line):
            self._follower.hang_up()
