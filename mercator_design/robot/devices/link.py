"""The link to the three devices: commands, questions, and the events that arrive meanwhile."""

import select
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeAlias, TypeVar

from mercator_design.errors import RobotError
from mercator_design.robot.devices.health import Answers
from mercator_design.robot.devices.ports import DeviceName, Line
from mercator_design.robot.protocols import multiflex, rvr, ydlidar
from mercator_design.robot.protocols.framing import Counts
from mercator_design.robot.protocols.multiflex import Acknowledgement
from mercator_design.robot.protocols.rvr import Flags, Notification, Response, Unknown
from mercator_design.robot.protocols.rvr_messages import DAMAGED, Error, Processor, Value
from mercator_design.robot.protocols.rvr_streaming import StreamData
from mercator_design.robot.protocols.ydlidar import DeviceInfo, Health, ScanStarted

_ANSWER = 0.3  # [s] that a device may take to answer, ...
_TRIES = 5  # ... and how often it is asked
_LOOK = 0.01  # [s]
_BEHIND = 1.0  # [s] that it takes to hear what fits into the system's buffers, at most, ...
_PAUSE = 0.004  # ... and from one message to the next, where devices leave as much, which a lidar that scans need not
_REMEMBERED = 100
_MUCH = 1000  # bytes without a meaning from a device that makes sense; a few are normal after a start
_REMEDIES: Mapping[DeviceName, str] = {
    "rvr": "is it switched on, charged and awake? Is its UART on (as sold it is off; an update with the app Sphero Edu "
    "turns it on), and this computer's at 115200 baud whatever its clock (enable_uart=1)? Are TX and RX crossed? Is a "
    "login shell on the port (raspi-config)? Do its lamps flash yellow (more than 2.15 A; switch it off and on)? Does "
    "the UART work (`mercator-robot check` tells, with TX and RX joined in place of the RVR)?",
    "lidar": "has it power (5 V, 1 A, and more while its motor starts)? Is it an X4, which speaks at 128000 baud?",
    "proximity": "is this the hub's port (`mercator-robot install` gives it a name that stays), and are all sensors "
    "plugged in?",
}
_REMEDIES_OF_HEARD: Mapping[DeviceName, str] = {
    "rvr": "it was heard before: has it still power, is a wire loose, or is this computer too busy?",
    "lidar": "it was heard before: has it power (5 V, 1 A, and more while its motor starts), does its motor turn, is a "
    "cable loose, or is this computer too busy?",
    "proximity": "it was heard before: are all sensors plugged in, is its cable loose, or is this computer too busy?",
}
_REMEDIES_OF_DAMAGED: Mapping[DeviceName, str] = {
    "rvr": "is its cable loose, too long, or beside one of a motor, and is this computer's UART at 115200 baud "
    "whatever its clock (enable_uart=1)?",
    "lidar": "is its cable loose, too long, or beside one of a motor, and is it an X4, which speaks at 128000 baud?",
    "proximity": "is its USB cable loose, too long, or beside one of a motor?",
}
_JOINED = "what is sent comes back: the UART works, and its TX and RX are joined; connect them to RX and TX of the RVR"

Said: TypeAlias = Response | Notification | Health | DeviceInfo | ScanStarted | Acknowledgement
Event: TypeAlias = Response | Notification | StreamData | Unknown | ydlidar.Event | multiflex.Event
S = TypeVar("S", bound=Said)


class Link:
    """The lines to the devices.

    said: Answers and notifications, the latest last.
    answers: Of the RVR, to commands that are `counted`.
    is_ending: Whether a line that is lost is no matter any more.
    """

    def __init__(self, lines: Iterable[Line], take: Callable[[Event, float], None]) -> None:
        """Begin; nothing is sent yet.

        Args:
            lines: To the devices.
            take: Called with what is heard, and when [s].
        """
        self._lines = {line.device: line for line in lines}
        self._open = list(self._lines.values())
        self._take = take
        self._host, self._lidar, self._hub = rvr.Host(), ydlidar.decoder(), multiflex.decoder()
        self.said: deque[Said] = deque(maxlen=_REMEMBERED)
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
        kind: type[S],
        answers: Callable[[S], bool] = lambda _: True,
    ) -> S:
        """Send a command until the device answers, and return the answer; errors are those of `ask`."""

        def found() -> list[S]:
            return [said for said in self.said if isinstance(said, kind) and answers(said)]

        for _ in range(_TRIES):
            self.said.clear()
            self.send(device, command())
            if self.until(lambda: bool(found()), _ANSWER):
                return found()[0]
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

    def remedy_of_damage(self, device: DeviceName) -> str:
        """What to check if too many bytes to or from a device are damaged, and its port."""
        return f"{_REMEDIES_OF_DAMAGED[device]} ({device} on {self.port(device)})"

    def _remedy(self, device: DeviceName) -> str:
        if device == "rvr" and self._is_joined:
            return _JOINED
        remedy = (_REMEDIES_OF_HEARD if device in self._understood else _REMEDIES)[device]
        lost = self.counts(device).lost
        if lost <= (_MUCH if device in self._understood else 0):
            return remedy
        return f"{remedy} ({lost} bytes from it make no sense: another device, or another baud rate)"

    def until(self, done: Callable[[], bool], seconds: float) -> bool:
        """Read the devices until `done()`, for `seconds` at most; whether it is done. Errors are those of `attend`."""
        end = time.monotonic() + seconds
        while not done():
            if time.monotonic() >= end:
                return False
            self.attend(time.monotonic() + _LOOK)
        return True

    def attend(self, until: float) -> None:
        """Read the devices until a time [s, of time.monotonic()], once at least.

        Raises:
            Stopped: if a port is lost; or what `take` raises.
        """
        while True:
            left = until - time.monotonic()
            ready, _, _ = select.select(self._open, [], [], max(0.0, left))
            for line in ready:
                self._hear(line)
            if left <= 0.0:
                return

    def catch_up(self) -> None:
        """Read all bytes that have already come; errors are those of `attend`."""
        end = time.monotonic() + _BEHIND
        while time.monotonic() < end and select.select(self._open, [], [], _PAUSE)[0]:
            self.attend(time.monotonic())

    def _hear(self, line: Line) -> None:
        try:
            data = line.read()
        except RobotError:
            self._open.remove(line)
            if self.is_ending:
                return
            raise
        now = time.monotonic()
        heard: Iterable[Event]
        match line.device:
            case "rvr":
                heard = self._host.receive(data)
            case "lidar":
                heard = self._lidar.receive(data)
            case _:
                heard = self._hub.receive(data)
        for event in heard:
            if not isinstance(event, Unknown):
                self._understood.add(line.device)
            elif event.frame.encode() == self._sent:
                self._is_joined = True
            if isinstance(event, Response):
                self.answers.take(event.seq, is_damaged=event.error in DAMAGED)
            if isinstance(event, Said):
                self.said.append(event)
            self._take(event, now)


def words(error: int) -> str:
    """An error of the RVR's, as text."""
    return Error(error).name.lower().replace("_", " ") if error in list(Error) else f"error {error:#04x}"
