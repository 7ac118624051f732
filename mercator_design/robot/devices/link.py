"""The link to the three devices: commands, questions, and the events that arrive meanwhile."""

import math
import select
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import islice
from typing import Any, NamedTuple, TypeAlias, TypeVar

from mercator_design.errors import RobotError
from mercator_design.robot.devices.health import Answers
from mercator_design.robot.devices.ports import DeviceName, Line
from mercator_design.robot.devices.remedies import HEARD_BEFORE, JOINED, NEVER_HEARD, damage_remedy
from mercator_design.robot.protocols import multiflex, rvr, ydlidar
from mercator_design.robot.protocols.framing import Counts
from mercator_design.robot.protocols.rvr import Flags, Notification, Response, Unknown
from mercator_design.robot.protocols.rvr_messages import DAMAGED, Error, Processor, Value
from mercator_design.robot.protocols.rvr_streaming import StreamData

_ANSWER = 0.3  # [s] that a device may take to answer, ...
_TRIES = 5  # ... and how often it is asked
_BEHIND = 1.0  # [s] that it takes to hear what fits into the system's buffers, at most, ...
_PAUSE = 0.004  # ... and from one message to the next, where devices leave as much, which a lidar that scans need not
_MUCH = 1000  # bytes without a meaning from a device that makes sense; a few are normal after a start

Event: TypeAlias = Response | Notification | StreamData | Unknown | ydlidar.Event | multiflex.Event
E = TypeVar("E", bound=Event)


class Heard(NamedTuple):
    """An event of a device.

    time: When it was read [s, of time.monotonic()].
    """

    event: Event
    time: float


class Link:
    """The lines to the devices.

    answers: Of the RVR, to commands that are `counted`.
    is_ending: Whether a line may be lost without an error.
    """

    def __init__(self, lines: Iterable[Line]) -> None:
        """Make a link over lines to devices; nothing is sent yet."""
        self._lines = {line.device: line for line in lines}
        self._open = list(self._lines.values())
        self._host, self._lidar, self._hub = rvr.Host(), ydlidar.decoder(), multiflex.decoder()
        self._heard: deque[Heard] = deque()  # that `poll` has not yielded yet
        self.answers = Answers()
        self.is_ending = False
        self._understood: set[DeviceName] = set()
        self._sent = b""  # the latest
        self._is_joined = False  # the RVR's line with itself

    def send(self, device: DeviceName, data: bytes) -> None:
        """Send bytes to a device.

        Raises:
            Stopped: if the port is lost.
        """
        self._sent = data
        self._lines[device].write(data)

    def command(self, name: str, target: Processor | None = None, /, **values: Value) -> bytes:
        """The bytes of a command; the RVR answers it only if it refuses, or if the command is a question."""
        return self._host.send(name, target=target, reply=Flags.ANSWER | Flags.ONLY_ERRORS, **values)

    def counted(self, name: str, target: Processor | None = None, /, **values: Value) -> bytes:
        """The bytes of a command that the RVR always answers; `answers` counts the answer."""
        command = self._host.send(name, target=target, reply=Flags.ANSWER, **values)
        self.answers.send(self._host.seq, time.monotonic())
        return command

    def send_command(self, name: str, target: Processor | None = None, /, **values: Value) -> None:
        """Send the RVR a command; errors are those of `send`."""
        self.send("rvr", self.command(name, target, **values))

    def ask(self, name: str, target: Processor | None = None, /, **values: Value) -> Mapping[str, Any]:
        """Send the RVR a command and return the answer; a command that was damaged on its way is repeated.

        Raises:
            RobotError: if it does not, or refuses.
            Stopped: if a port is lost.
        """
        asked: set[int] = set()

        def command() -> bytes:
            sent = self._host.send(name, target=target, reply=Flags.ANSWER, **values)
            asked.add(self._host.seq)
            return sent

        for _ in range(_TRIES):
            response = self.exchange("rvr", command, Response, lambda response: response.seq in asked)
            if response.error not in DAMAGED:
                break
        if response.error:
            raise RobotError(f"rvr: {name} was refused: {words(response.error)}")
        return response.values

    def exchange(
        self,
        device: DeviceName,
        command: Callable[[], bytes],
        kind: type[E],
        answers: Callable[[E], bool] = lambda _: True,
    ) -> E:
        """Send a command until the device answers, and return the answer; errors are those of `ask`."""
        for _ in range(_TRIES):
            self.send(device, command())
            if (answer := self.wait_for(kind, answers, _ANSWER)) is not None:
                return answer
        raise RobotError(f"no answer; {self.remedy(device)}", device=device)

    def counts(self, device: DeviceName) -> Counts:
        """The counts of bytes that a device has sent so far."""
        return {"rvr": self._host.counts, "lidar": self._lidar.counts, "proximity": self._hub.counts}[device]

    def port(self, device: DeviceName) -> str:
        """The name of a device's port."""
        return self._lines[device].port

    def remedy(self, device: DeviceName) -> str:
        """What to check if a device sends nothing, or nothing that can be read, and its port."""
        return f"{self._remedy(device)} ({device} on {self.port(device)})"

    def damage_remedy(self, device: DeviceName) -> str:
        """What to check if too many bytes to or from a device are damaged, and its port."""
        return damage_remedy(device, self.port(device))

    def _remedy(self, device: DeviceName) -> str:
        if device == "rvr" and self._is_joined:
            return JOINED
        remedy = (HEARD_BEFORE if device in self._understood else NEVER_HEARD)[device]
        lost = self.counts(device).lost
        if lost <= (_MUCH if device in self._understood else 0):
            return remedy
        return f"{remedy} ({lost} bytes from it make no sense: another device, or another baud rate)"

    def poll(self, until: float = -math.inf) -> Iterator[Heard]:
        """Read the devices until a time [s, of time.monotonic()], once at least; yield each event when it is read.

        The events that were read while a question waited for its answer come first.

        Raises:
            Stopped: if a port is lost.
        """
        while True:
            left = until - time.monotonic()
            self._read(left)
            while self._heard:
                yield self._heard.popleft()
            if left <= 0.0:
                return

    def discard(self) -> None:
        """Read what has come so far, and forget it; errors are those of `poll`."""
        for _ in self.poll():
            pass

    def backlog(self) -> Iterator[Heard]:
        """Yield the events that wait in the ports; errors are those of `poll`."""
        end = time.monotonic() + _BEHIND
        while time.monotonic() < end and select.select(self._open, [], [], _PAUSE)[0]:
            yield from self.poll()

    def wait_for(self, kind: type[E], matches: Callable[[E], bool], seconds: float) -> E | None:
        """Read the devices until an event of a kind matches, for `seconds` at most; None if none does.

        `poll` yields all that was read. Errors are those of `poll`.
        """
        end = time.monotonic() + seconds
        while True:
            left = end - time.monotonic()
            for event, _ in self._read(left):
                if isinstance(event, kind) and matches(event):
                    return event
            if left <= 0.0:
                return None

    def _read(self, seconds: float) -> list[Heard]:
        """Read the ports once something comes, for `seconds` at most, and decode it."""
        ready, _, _ = select.select(self._open, [], [], max(0.0, seconds))
        before = len(self._heard)
        for line in ready:
            self._heard += self._decode(line)
        return [*islice(self._heard, before, None)]

    def _decode(self, line: Line) -> Iterator[Heard]:
        try:
            data = line.read()
        except RobotError:
            self._open.remove(line)
            if self.is_ending:
                return
            raise
        now = time.monotonic()
        events: Iterable[Event]
        match line.device:
            case "rvr":
                events = self._host.receive(data)
            case "lidar":
                events = self._lidar.receive(data)
            case _:
                events = self._hub.receive(data)
        for event in events:
            if not isinstance(event, Unknown):
                self._understood.add(line.device)
            elif event.frame.encode() == self._sent:
                self._is_joined = True
            if isinstance(event, Response):
                self.answers.take(event.seq, is_damaged=event.error in DAMAGED)
            yield Heard(event, now)


def words(error: int) -> str:
    """An error of the RVR's, as text."""
    return Error(error).name.lower().replace("_", " ") if error in list(Error) else f"error {error:#04x}"
