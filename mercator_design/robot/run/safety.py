"""The brake, and what pulls it when the control loop does not: a watchdog and signals.

Every command to the wheels passes the `Brake`. A stop is for good: only zeros follow in the run, and only a new run
drives again. A `Watchdog` pulls the brake from a thread of its own if the control loop stalls, or if the swarm has to
stop; signals pull it at once. If the program is dead, the RVR stops by itself when it has received no command for
`rvr.timeout` (settings.py).
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
from mercator_design.robot.run.network import STOP, STOPPED, Heartbeats, listener, receive

STALL = 0.18
"""[s] without a command to the wheels after which the control loop counts as stalled."""
_CHECK_EVERY = 0.02  # [s] between checks of the watchdog
_OBEY_EVERY = 0.2  # [s] after which another stop from the swarm is obeyed
_LOCK_LIMIT = 0.05  # [s] that a stop waits for a command that is being sent

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP)
"""Signals that end a program; Ctrl-Z too, as a suspended program does not control its robot."""

_SUSPENDING = (signal.SIGTTIN, signal.SIGTTOU)  # of a program in the background that uses its terminal


def raise_priority(priority: int) -> None:
    """Give this thread, and those that it starts, a real-time priority, if permitted."""
    with contextlib.suppress(OSError, AttributeError):  # not permitted; no such system
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(priority))


class Brake:
    """The only way to the wheels; threads and signal handlers may use it.

    why: What has stopped the wheels; empty if nothing has.
    """

    def __init__(
        self, write: Callable[[bytes], None], drive: Callable[[float, float], bytes], zero: bytes, limit: float
    ) -> None:
        """Make a brake that is not pulled.

        Args:
            write: Sends bytes to the robot.
            drive: Returns the command that sets the speeds of the left and right tread [m/s].
            zero: The commands that stop the robot.
            limit: Maximum speed [m/s].
        """
        self._write, self._drive, self._zero, self._limit = write, drive, zero, limit
        self._lock = threading.RLock()
        self._latest: tuple[float, float] | None = None  # speeds of the latest command, while it may be repeated
        self._due = math.inf  # time limit of the next command
        self.why = ""

    def arm(self) -> None:
        """Require a command every `STALL` from now on."""
        self._due = time.monotonic() + STALL

    def check_stall(self) -> None:
        """Stop the wheels if the control loop has stalled."""
        late = time.monotonic() - self._due
        if late > 0.0:
            self.stop(f"the control loop stalled: no command for {STALL + late:.2f} s")

    def drive(self, left: float, right: float) -> None:
        """Set the speeds of the treads [m/s].

        Raises:
            RobotStopped: if something has stopped them, a speed is out of range or not a number, or the port is lost.
        """
        self.check(left, right)
        with self._lock:
            self.check_stall()  # after a suspension this may run before the watchdog
            if self.why:
                raise RobotStopped(self.why)
            self._send(left, right)
            self._latest = left, right
            if not self.why and self._due < math.inf:
                self.arm()

    def repeat(self) -> bool:
        """Send the latest command, which was damaged on its way, once more, unless something has stopped the wheels.

        This does not show that the control loop runs: the time limit of the next command stays.

        Returns:
            Whether it was sent.
        """
        with self._lock:
            self.check_stall()
            if self.why or self._latest is None:
                return False
            (left, right), self._latest = self._latest, None
            self._send(left, right)
        return True

    def _send(self, left: float, right: float) -> None:
        self._write(self._drive(left, right))
        self.check_stall()
        if self.why:  # a stop that did not wait for this command
            self.stop(self.why)

    def check(self, left: float, right: float) -> None:
        """Stop the wheels if a speed [m/s] is out of range or not a number."""
        if not (abs(left) <= self._limit and abs(right) <= self._limit):
            self.stop(
                f"wheels: expected speeds from {-self._limit:g} to {self._limit:g} m/s, found {left:g}, {right:g}"
            )

    def stop(self, why: str) -> None:
        """Stop the wheels for good. Zeros are sent twice, as one frame may be damaged on its way."""
        locked = self._lock.acquire(timeout=_LOCK_LIMIT)
        try:
            self.why = self.why or why
            for _ in range(2):
                with contextlib.suppress(RobotError):  # the port is lost; then the RVR stops by itself
                    self._write(self._zero)
        finally:
            if locked:
                self._lock.release()


class Watchdog(threading.Thread):
    """Stops the wheels when the control loop stalls, a stop comes from the swarm, or heartbeats end.

    A context manager; it obeys stops from the beginning, and checks stalls and heartbeats from `arm` on.

    heartbeats: Heartbeats that came.
    refused_from: Address of the sender of the latest refused heartbeat.
    """

    def __init__(self, brake: Brake, swarm: SwarmSettings, name: str) -> None:
        """Make one.

        Args:
            brake: The brake.
            swarm: Its port, its key, and the time without heartbeats that stops the robot.
            name: The robot's name, for answers.

        Raises:
            RobotError: if another program uses the port.
        """
        super().__init__(daemon=True)
        self._brake, self._heartbeat, self._answer = brake, swarm.heartbeat, STOPPED + name.encode()
        self._listening = None if swarm.port is None else listener(swarm.port)
        self._armed, self._over = threading.Event(), threading.Event()
        self._obeyed = -math.inf  # time of the latest stop from the swarm
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
        """Require regular commands to the wheels from now on, and heartbeats if the settings want them."""
        self._brake.arm()
        self._armed.set()

    def run(self) -> None:
        raise_priority(2)
        try:
            while not self._over.is_set():
                if self._listening is None:
                    self._over.wait(_CHECK_EVERY)
                elif select.select([self._listening], [], [], _CHECK_EVERY)[0]:
                    self._receive(self._listening)
                if self._armed.is_set() and not self._brake.why:
                    self._check(time.monotonic())
        finally:
            if not self._over.is_set():
                self._brake.stop("the watchdog failed")

    def _check(self, now: float) -> None:
        self._brake.check_stall()
        heard = self.heartbeats.heard
        if self._heartbeat is not None and (heard is None or now - heard > self._heartbeat):
            self._brake.stop(f"swarm: no heartbeat for {self._heartbeat:g} s")

    def _receive(self, listening: socket.socket) -> None:
        for message, sender in receive(listening):
            now = time.monotonic()
            if message == STOP:
                if now - self._obeyed > _OBEY_EVERY:  # stops that come more often would delay the shutdown
                    self._obeyed = now
                    self._brake.stop(f"swarm: stop received from {sender[0]}")
                answer: bytes | None = self._answer
            else:
                refused = self.heartbeats.refused
                answer = self.heartbeats.take(message, now)
                if self.heartbeats.refused != refused:
                    self.refused_from = sender[0]
            if answer is not None:
                with contextlib.suppress(OSError):
                    listening.sendto(answer, sender)


class Signals:
    """In the context `caught`, the first signal pulls the brake that `guard` knows, then raises `Signalled`.

    No terminal suspends the program there.
    """

    def __init__(self) -> None:
        self._brake: Brake | None = None
        self._has_ended = False
        self._signalled: Signalled | None = None

    @contextlib.contextmanager
    def caught(self) -> Iterator[None]:
        usual = {number: signal.signal(number, self._act) for number in SIGNALS}
        usual |= {number: signal.signal(number, signal.SIG_IGN) for number in _SUSPENDING}
        try:
            yield
        finally:
            for number, handler in usual.items():
                signal.signal(number, handler)

    def guard(self, brake: Brake) -> None:
        """Pull this brake at the first signal.

        Raises:
            Signalled: A signal came before, and Python dropped its exception, as in a callback of a weak reference.
        """
        self._brake = brake
        if self._signalled is not None:
            raise self._signalled

    @contextlib.contextmanager
    def until_stopped(self) -> Iterator[None]:
        """A context that ends by pulling the brake; signals have no effect afterwards."""
        try:
            yield
        finally:
            if self._brake is not None:
                self._brake.stop("the run has ended")
            self._has_ended = True

    def _act(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002 - as signal handlers are called
        if self._has_ended or self._signalled is not None:
            return
        name = signal.Signals(number).name
        self._signalled = Signalled(f"Stopped by {name}.", 128 + number)
        if self._brake is not None:
            self._brake.stop(name)
        raise self._signalled
