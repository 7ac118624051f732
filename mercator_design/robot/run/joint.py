"""When a run begins: at once, or together with other robots, at a time agreed on over standard input and output."""

import contextlib
import threading
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Self

from mercator_design.errors import RobotStopped
from mercator_design.robot.logs.events import ClockOffset
from mercator_design.robot.protocols.joint_start import Follower
from mercator_design.robot.run.channel import Channel
from mercator_design.robot.run.control import Control

if TYPE_CHECKING:
    from mercator_design.robot.run.safety import Brake

_LOOK = 0.05
"""[s] between looks at the devices."""
_AHEAD = 0.05
"""[s] before the first control cycle at which the robot is armed."""


class AtOnce:
    """A run that begins when its robot has started up. A context manager, as `Joint` is."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    @contextlib.contextmanager
    def taking_part(self, control: Control, log: Path) -> Iterator[None]:  # noqa: ARG002 - as of `Joint`
        """The run, from when the robot has started up until it ends."""
        yield

    def clock(self) -> ClockOffset | None:
        """What the log is to have of this computer's clock; None if nothing was measured."""
        return None

    def wait(self, control: Control) -> None:
        """Wait until it is time to be armed."""

    def due(self) -> float:
        """When the first control cycle is to begin [s]."""
        return time.monotonic()

    def begin(self, now: float, cycle: float) -> None:
        """The first control cycle, of so many seconds, begins."""


class Joint(AtOnce):
    """A run that begins together with others (robot/protocols/joint_start.py).

    The leader is heard by a thread of its own, which pulls the brake if it says so, or is heard no more.
    """

    def __init__(self) -> None:
        """Make one; entering its context begins to listen."""
        self._follower, self._lock = Follower(), threading.Lock()
        self._brake: Brake | None = None
        self._channel = Channel(self._hear, lambda: self._stop("the thread that reads the leader's lines failed"))

    def __enter__(self) -> Self:
        self._channel.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._channel.__exit__()

    @contextlib.contextmanager
    def taking_part(self, control: Control, log: Path) -> Iterator[None]:
        """The run: the leader is told that the robot is ready, what time the start is waited for, and of what ends it.

        Raises:
            Stopped: if the start was called off, the leader is not heard any more, or what `Control.wait` raises.
        """
        try:
            control.await_heartbeat()
            with self._lock:
                self._brake = control.robot.brake
                self._say(self._follower.be_ready(time.monotonic(), log=str(log)))
            while self._follower.at is None:
                self._attend(control, time.monotonic() + _LOOK)
            yield
        except BaseException as error:
            with self._lock:
                self._say(self._follower.fail(str(error) or type(error).__name__))
            raise

    def clock(self) -> ClockOffset | None:
        """How far this computer's clock of the day is ahead of the leader's [s], now, and how well that is known."""
        reference = self._follower.reference
        if reference is None:
            return None
        ahead = time.time() - (time.monotonic() + reference.offset)
        return ClockOffset(reference.host, ahead=round(ahead, 6), uncertainty=round(reference.uncertainty, 6))

    def wait(self, control: Control) -> None:
        """As `AtOnce.wait`; raises as `taking_part`."""
        end = self.due() - _AHEAD
        while (now := time.monotonic()) < end:
            self._attend(control, min(now + _LOOK, end))

    def due(self) -> float:
        """When the first control cycle is to begin [s], once `taking_part` has begun."""
        if self._follower.at is None:
            raise RobotStopped("no time of the start received")
        return self._follower.at

    def begin(self, now: float, cycle: float) -> None:
        """As `AtOnce.begin`.

        Raises:
            Stopped: if it must not.
        """
        with self._lock:
            self._say(self._follower.begin(now, cycle))
            why = self._follower.why
        if why:
            raise RobotStopped(why)

    def _attend(self, control: Control, until: float) -> None:
        """Hear the devices until a time [s], and see that the robot could begin."""
        control.wait(until)
        control.refresh()
        control.robot.check_ages()
        control.robot.query()
        if self._follower.why:
            raise RobotStopped(self._follower.why)

    def _hear(self, lines: Iterable[bytes] | None, now: float) -> None:
        with self._lock:
            for line in lines or ():
                if (said := self._follower.hear(line, now)) is not None:
                    self._say(said)
            if lines is None:
                self._follower.hang_up()
            self._follower.look(now)
            if self._follower.why:
                self._stop(self._follower.why)

    def _stop(self, why: str) -> None:
        if self._brake is not None and not self._brake.why:
            self._brake.stop(why)

    def _say(self, line: str) -> None:
        if not self._channel.say(line):
            self._follower.hang_up()
