"""What stops the wheels when the program is not in control of them.

Every command to the wheels passes the `Brake`. Whatever stops a robot, stops it there, for good: what follows in the
run are zeros, and only a new run drives again. A `Watchdog` pulls it from a thread of its own if the control
loop does not get to driving, or if the swarm is to stop; signals pull it at once. What a program that is dead cannot
do, the RVR does: it stops when it has heard no command for `COMMANDS_END` (see mercator.py).
"""

import contextlib
import math
import os
import select
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Self

from mercator_design.errors import RobotError, RobotStopped, Signalled
from mercator_design.robot.devices.settings import SwarmSettings
from mercator_design.robot.run.network import STOP, STOPPED, Heartbeats, hear, listener

STALL = 0.18
"""[s] between commands to the wheels after which the control loop is taken for stalled."""
_LOOK = 0.02
"""[s] between the watchdog's looks."""
_AGAIN = 0.2
"""[s] after which a stop that is told again is obeyed again."""
_LOCKED = 0.05
"""[s] that a stop waits for a command that is being sent."""

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP)
"""Ways to end a program; Ctrl-Z too, as a robot whose program is suspended is out of control."""


def go_first(priority: int) -> None:
    """Let this thread, and those that it starts, run before all that is not as urgent, where that is permitted."""
    with contextlib.suppress(OSError, AttributeError):  # not permitted; no such system
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(priority))


class Brake:
    """The only way to the wheels; threads and signal handlers may use it.

    why: What stopped them; empty as long as nothing has.
    """

    def __init__(
        self, write: Callable[[bytes], None], drive: Callable[[float, float], bytes], zero: bytes, limit: float
    ) -> None:
        """Begin without a stop.

        Args:
            write: Sends bytes to the robot.
            drive: The command that sets the speeds of the left and right tread [m/s].
            zero: The commands that stop the robot.
            limit: Of speeds [m/s].
        """
        self._write, self._drive, self._zero, self._limit = write, drive, zero, limit
        self._lock = threading.RLock()
        self._latest: tuple[float, float] | None = None  # speeds that were told, and may be told again
        self._due = math.inf  # when the next command must have come
        self.why = ""

    def arm(self) -> None:
        """From now on commands must follow each other."""
        self._due = time.monotonic() + STALL

    def look(self) -> None:
        """Stop the wheels if the control loop has stalled."""
        late = time.monotonic() - self._due
        if late > 0.0:
            self.stop(f"the control loop stalled: no command for {STALL + late:.2f} s")

    def drive(self, left: float, right: float) -> None:
        """Set the speeds of the treads [m/s].

        Raises:
            Stopped: if something has stopped them, a speed is out of range or not a number, or the port is lost.
        """
        self.check(left, right)
        with self._lock:
            self.look()  # who was suspended may get here before the watchdog does
            if self.why:
                raise RobotStopped(self.why)
            self._send(left, right)
            self._latest = left, right
            if not self.why and self._due < math.inf:
                self.arm()

    def repeat(self) -> bool:
        """Send the latest command once more if it was damaged on its way, and nothing has stopped the wheels.

        This is no sign that the control loop goes on: it does not put off when the next command must come.

        Returns:
            Whether it was sent.
        """
        with self._lock:
            self.look()
            if self.why or self._latest is None:
                return False
            (left, right), self._latest = self._latest, None
            self._send(left, right)
        return True

    def _send(self, left: float, right: float) -> None:
        self._write(self._drive(left, right))
        self.look()
        if self.why:  # a stop that did not wait for this command
            self.stop(self.why)

    def check(self, left: float, right: float) -> None:
        """Stop the wheels if a speed [m/s] is out of range or not a number."""
        if not (abs(left) <= self._limit and abs(right) <= self._limit):
            self.stop(
                f"wheels: expected speeds from {-self._limit:g} to {self._limit:g} m/s, found {left:g}, {right:g}"
            )

    def stop(self, why: str) -> None:
        """Stop the wheels for good. Zero is sent twice, as one frame may be damaged on its way."""
        locked = self._lock.acquire(timeout=_LOCKED)
        try:
            self.why = self.why or why
            for _ in range(2):
                with contextlib.suppress(RobotError):  # of a lost port the robot knows by itself
                    self._write(self._zero)
        finally:
            if locked:
                self._lock.release()


class Watchdog(threading.Thread):
    """Stops the wheels when the control loop stalls, the swarm is told to stop, or heartbeats end.

    A context manager; it looks at stops from the beginning, at stalls and silence from `arm` on.

    heartbeats: Those that came.
    refused_from: Address from which the latest came that was refused.
    """

    def __init__(self, brake: Brake, swarm: SwarmSettings, name: str) -> None:
        """Make one.

        Args:
            brake: What it pulls.
            swarm: Where it hears what is told to the swarm, and what silence stops the robot.
            name: Of the robot, for answers.

        Raises:
            RobotError: if another program hears there.
        """
        super().__init__(daemon=True)
        self._brake, self._heartbeat, self._answer = brake, swarm.heartbeat, STOPPED + name.encode()
        self._listening = None if swarm.port is None else listener(swarm.port)
        self._armed, self._over = threading.Event(), threading.Event()
        self._obeyed = -math.inf  # when it was told to
        self.heartbeats = Heartbeats(swarm.key, swarm.heartbeat or 0.0)
        self.refused_from = ""

    @property
    def awaits_heartbeat(self) -> bool:
        """Whether the settings want heartbeats and none has come yet."""
        return self._heartbeat is not None and self.heartbeats.heard is None

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self.join()
        if self._listening is not None:
            self._listening.close()

    def arm(self) -> None:
        """From now on commands to the wheels must follow each other, and heartbeats."""
        self._brake.arm()
        self._armed.set()

    def run(self) -> None:
        """Watch, until the end of the context."""
        go_first(2)
        try:
            while not self._over.is_set():
                if self._listening is None:
                    self._over.wait(_LOOK)
                elif select.select([self._listening], [], [], _LOOK)[0]:
                    self._hear(self._listening)
                if self._armed.is_set() and not self._brake.why:
                    self._look(time.monotonic())
        finally:
            if not self._over.is_set():
                self._brake.stop("the watchdog failed")

    def _look(self, now: float) -> None:
        self._brake.look()
        heard = self.heartbeats.heard
        if self._heartbeat is not None and (heard is None or now - heard > self._heartbeat):
            self._brake.stop(f"swarm: no heartbeat for {self._heartbeat:g} s")

    def _obey_stop(self, why: str) -> None:
        """Stop the wheels, again if a stop comes again, but not so often that it delays the shutdown."""
        now = time.monotonic()
        if now - self._obeyed > _AGAIN:
            self._obeyed = now
            self._brake.stop(why)

    def _hear(self, listening: socket.socket) -> None:
        for message, sender in hear(listening):
            if message == STOP:
                self._obey_stop(f"swarm: told to stop by {sender[0]}")
                answer: bytes | None = self._answer
            else:
                refused = self.heartbeats.refused
                answer = self.heartbeats.take(message, time.monotonic())
                if self.heartbeats.refused != refused:
                    self.refused_from = sender[0]
            if answer is not None:
                with contextlib.suppress(OSError):
                    listening.sendto(answer, sender)


class Signals:
    """While in this context, a signal pulls the brake, then ends the program: by `Signalled`, once.

    brake: What it pulls, as soon as there is one.
    """

    def __init__(self) -> None:
        self.brake: Brake | None = None
        self._came = False

    @contextlib.contextmanager
    def caught(self) -> Iterator[None]:
        """The context."""
        usual = {number: signal.signal(number, self._act) for number in SIGNALS}
        try:
            yield
        finally:
            for number, handler in usual.items():
                signal.signal(number, handler)

    @contextlib.contextmanager
    def until_stopped(self) -> Iterator[None]:
        """A context that ends with a pull of the brake, behind which a signal interrupts nothing any more."""
        try:
            yield
        finally:
            if self.brake is not None:
                self.brake.stop("the run has ended")
            self._came = True

    def _act(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002 - as signal handlers are called
        if self._came:
            return
        self._came = True
        name = signal.Signals(number).name
        if self.brake is not None:
            self.brake.stop(name)
        raise Signalled(f"Stopped by {name}.", 128 + number)
