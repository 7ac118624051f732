"""The link to the three devices: it sends commands and questions, and reads events."""

import math
import select
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import islice
from typing import Any, NamedTuple, TypeAlias, TypeVar

from mercator_design.errors import RobotError, RobotStopped
from mercator_design.robot.devices.health import Answers
from mercator_design.robot.devices.ports import DeviceName, Line
from mercator_design.robot.protocols import multiflex, rvr, ydlidar
from mercator_design.robot.protocols.framing import Counts, Decoder
from mercator_design.robot.protocols.rvr import Flags, Notification, Response, Unknown
from mercator_design.robot.protocols.rvr_messages import DAMAGED, Error, Processor, Value
from mercator_design.robot.protocols.rvr_streaming import StreamData

ANSWER_WAIT = 0.3  # [s] for an answer of a device
TRIES = 5  # of a question
_MAX_BACKLOG = 1.0  # [s] for reading the system's full buffers
_PAUSE = 0.004  # [s] between two messages of a device, except of a lidar that scans
_MUCH = 1000  # bytes without meaning from a device that was understood; a few are normal after a start
# What to check if a device has sent nothing, sends no more or sends damaged data, or the RVR's port hears itself:
_NEVER_HEARD: Mapping[DeviceName, str] = {
    "rvr": "is it switched on, charged and awake? Is its UART on (as sold it is off; an update with the app Sphero Edu "
    "turns it on), and this computer's at 115200 baud whatever its clock (enable_uart=1)? Are TX and RX crossed? Is a "
    "login shell on the port (`mercator-robot check` finds it)? Do its lamps flash yellow (more than 2.15 A; switch it "
    "off and on)? Does the UART work (run `mercator-robot check` with TX and RX joined in place of the RVR)?",
    "lidar": "has it power (5 V, 1 A, and more while its motor starts)? Is it an X4, which sends at 128000 baud?",
    "proximity": "is this the hub's port (`mercator-robot install` gives it a name that stays), and are all sensors "
    "plugged in? Unplug the hub and plug it in again",
}
_HEARD_BEFORE: Mapping[DeviceName, str] = {
    "rvr": "it was heard before: has it still power, is a wire loose, or is this computer too busy?",
    "lidar": "it was heard before: has it power (5 V, 1 A, and more while its motor starts), does its motor turn, not "
    "too slowly, is a cable loose, or is this computer too busy?",
    "proximity": "it was heard before: are all sensors plugged in, is its cable loose, or is this computer too busy? "
    "Unplug the hub and plug it in again",
}
_DAMAGED_LINE: Mapping[DeviceName, str] = {
    "rvr": "is its cable loose, too long, or beside one of a motor, and is this computer's UART at 115200 baud "
    "whatever its clock (enable_uart=1)?",
    "lidar": "is its cable loose, too long, or beside one of a motor, and is it an X4, which sends at 128000 baud?",
    "proximity": "is its USB cable loose, too long, or beside one of a motor?",
}
_FOREIGN: Mapping[DeviceName, str] = {
    "rvr": "another device, or another baud rate",
    "lidar": "another model or mode, another device, or another baud rate",
    "proximity": "another device, or another baud rate",
}
_UNKNOWN_COMMAND = {Error.BAD_DEVICE, Error.BAD_COMMAND, Error.NOT_YET_IMPLEMENTED}
_JOINED = "what is sent comes back: the UART works, and its TX and RX are joined; connect them to RX and TX of the RVR"

Event: TypeAlias = Response | Notification | StreamData | Unknown | ydlidar.Event | multiflex.Event
E = TypeVar("E", bound=Event)
_Decoder: TypeAlias = rvr.Host | Decoder[ydlidar.Event] | Decoder[multiflex.Event]


class Heard(NamedTuple):
    """An event of a device."""

    event: Event
    time: float  # when it was read [s, of time.monotonic()]


class Link:
    """The lines to the devices.

    lines: The lines by device.
    answers: Counts of the RVR's answers to commands of `encode_counted`.
    is_ending: Whether a line may be lost without an error.
    understood: When the latest event came that was understood [s], by device.
    """

    def __init__(self, lines: Iterable[Line]) -> None:
        """Make a link over lines to devices; nothing is sent yet."""
        self.lines = {line.device: line for line in lines}
        self._open = list(self.lines.values())
        self._host = rvr.Host()
        self._decoders: Mapping[DeviceName, _Decoder] = {
            "rvr": self._host,
            "lidar": ydlidar.decoder(),
            "proximity": multiflex.decoder(),
        }
        self._heard: deque[Heard] = deque()  # not yielded by `poll` yet
        self.answers = Answers()
        self.is_ending = False
        self.understood: dict[DeviceName, float] = {}
        self._sent = b""  # the latest bytes to the RVR
        self._is_joined = False  # whether the RVR's port receives what it sends

    def send(self, device: DeviceName, data: bytes) -> None:
        """Send bytes to a device; errors are those of `Line.write`."""
        if device == "rvr":
            self._sent = data
        self.lines[device].write(data)

    def encode(self, name: str, target: Processor | None = None, /, **values: Value) -> bytes:
        """The bytes of a command; the RVR answers it only if it refuses, or if the command is a question."""
        return self._host.send(name, target=target, reply=Flags.ANSWER | Flags.ONLY_ERRORS, **values)

    def encode_counted(self, name: str, target: Processor | None = None, /, **values: Value) -> bytes:
        """The bytes of a command that the RVR always answers; `answers` counts the answer."""
        command = self._host.send(name, target=target, reply=Flags.ANSWER, **values)
        self.answers.send(self._host.seq, time.monotonic())
        return command

    def send_command(self, name: str, target: Processor | None = None, /, **values: Value) -> None:
        """Send the RVR a command; errors are those of `send`."""
        self.send("rvr", self.encode(name, target, **values))

    def ask(self, name: str, target: Processor | None = None, /, **values: Value) -> Mapping[str, Any]:
        """Send the RVR a command and return the answer; a command that was damaged on its way is repeated.

        Raises:
            RobotError: if it does not answer, or refuses.
            RobotStopped: if a port is lost.
        """
        response = self.request(name, target, **values)
        if response.error:
            refused = f"{name} was refused: {words(response.error)}"
            raise RobotError(f"rvr: {refused}; {error_remedy(response.error)} (rvr on {self.lines['rvr'].port})")
        return response.values

    def attempt(self, name: str, target: Processor | None = None, /, **values: Value) -> tuple[Mapping[str, Any], str]:
        """As `ask`, of a command that is not needed: return the answer, and why the RVR does not obey, else empty.

        Raises:
            RobotStopped: if a port is lost.
        """
        try:
            response = self.request(name, target, **values)
        except RobotStopped:
            raise
        except RobotError:
            return {}, "no answer"
        return response.values, words(response.error) if response.error else ""

    def refusal(self, name: str, target: Processor | None = None, /, **values: Value) -> str:
        """The second value of `attempt`."""
        _, why = self.attempt(name, target, **values)
        return why

    def request(self, name: str, target: Processor | None = None, /, **values: Value) -> Response:
        """As `ask`, but return also a refusal."""
        asked: set[int] = set()

        def command() -> bytes:
            sent = self._host.send(name, target=target, reply=Flags.ANSWER, **values)
            asked.add(self._host.seq)
            return sent

        for _ in range(TRIES):
            response = self.exchange("rvr", command, Response, lambda response: response.seq in asked)
            if response.error not in DAMAGED:
                break
        return response

    def exchange(
        self,
        device: DeviceName,
        command: Callable[[], bytes],
        kind: type[E] | tuple[type[E], ...],
        answers: Callable[[E], bool] = lambda _: True,
    ) -> E:
        """Send a command until the device answers, and return the answer; errors are those of `ask`."""
        for _ in range(TRIES):
            self.send(device, command())
            if (answer := self.wait_for(kind, answers, ANSWER_WAIT)) is not None:
                return answer
        raise RobotError(f"no answer; {self.remedy(device)}", device=device)

    def counts(self) -> dict[DeviceName, Counts]:
        """The counts of bytes that each device has sent so far."""
        return {device: self._decoders[device].counts for device in self.lines}

    def remedy(self, device: DeviceName) -> str:
        """Remedy for a device that sends nothing, or nothing that is understood; with its port."""
        return f"{self._remedy(device)} ({device} on {self.lines[device].port})"

    def damage_remedy(self, device: DeviceName) -> str:
        """Remedy for a line on which too many bytes are damaged; with its port."""
        return f"{_DAMAGED_LINE[device]} ({device} on {self.lines[device].port})"

    def stream_remedy(self) -> str:
        """Remedy for an RVR that is heard, but does not stream a sensor as it should; with its port."""
        return (
            "the RVR itself is heard: switch it off and on, or update it with the app Sphero Edu; `mercator-robot "
            f"check` reports what it streams, and rvr.period in robot.yaml how often (rvr on {self.lines['rvr'].port})"
        )

    def _remedy(self, device: DeviceName) -> str:
        if device == "rvr" and self._is_joined:
            return _JOINED
        remedy = (_HEARD_BEFORE if device in self.understood else _NEVER_HEARD)[device]
        lost = self._decoders[device].counts.lost
        if lost <= (_MUCH if device in self.understood else 0):
            return remedy
        return f"{remedy} ({lost} bytes from it make no sense: {_FOREIGN[device]})"

    def poll(self, until: float = -math.inf) -> Iterator[Heard]:
        """Read the devices until a time [s, of time.monotonic()], once at least; yield each event when it is read.

        The events that were read while a question waited for its answer come first.

        Raises:
            RobotStopped: if a port is lost.
        """
        while True:
            left = until - time.monotonic()
            self._read(0.0 if self._heard else left)  # what waits is yielded at once
            while self._heard:
                yield self._heard.popleft()
            if left <= 0.0:
                return

    def discard(self) -> None:
        """Read and forget all that has come so far; errors are those of `poll`."""
        for _ in self.poll():
            pass

    def backlog(self) -> Iterator[Heard]:
        """Yield the events that wait in the ports; errors are those of `poll`."""
        end = time.monotonic() + _MAX_BACKLOG
        while time.monotonic() < end and select.select(self._open, [], [], _PAUSE)[0]:
            yield from self.poll()

    def wait_for(self, kind: type[E] | tuple[type[E], ...], matches: Callable[[E], bool], seconds: float) -> E | None:
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
        for event in self._decoders[line.device].receive(data):
            if not isinstance(event, Unknown):
                self.understood[line.device] = now
            elif event.frame.encode() in self._sent:
                self._is_joined = True
            if isinstance(event, Response):
                self.answers.take(event.seq, is_damaged=event.error in DAMAGED)
            yield Heard(event, now)


def words(error: int) -> str:
    """An error of the RVR as text."""
    return Error(error).name.lower().replace("_", " ") if error in list(Error) else f"error {error:#04x}"


def error_remedy(error: int) -> str:
    """Remedy for an error of the RVR."""
    if error in _UNKNOWN_COMMAND:
        return "its firmware does not know this: update it with the app Sphero Edu"
    return "switch it off and on"
