"""The serial line of the Sphero RVR: frames, and the two ends that exchange them (115200 baud, 8N1).

    8D  flags [target] [source] device command sequence [error] data ...  checksum  D8

Between 8D and D8 the bytes 8D, D8 and AB are escaped, so a frame begins at every 8D. The checksum is the inverted sum
of the bytes between them before escaping ("Details on the Sphero API", packet structure, packet encoding).

`Host` is the computer's end: it numbers commands and finds the command of each response. `RvrEnd` is the robot's end.
"""

import re
from dataclasses import dataclass
from enum import IntFlag

from mercator_design.errors import ProtocolError
from mercator_design.robot.protocols.framing import Counts, Decoder
from mercator_design.robot.protocols.rvr_messages import (
    COMMANDS,
    NOTIFICATIONS,
    Error,
    Message,
    Processor,
    Value,
    Values,
)
from mercator_design.robot.protocols.rvr_streaming import Slots, StreamData

MAX_FRAME = 512
"""Bytes of a frame on the line; a longer one has lost its end."""
_NOTIFICATION_SEQ = 0xFF
_MAX_AWAITED = 128
"""Responses that a host waits for, at most: it always has a free sequence number."""

_FIRST, _LAST = b"\x8d", b"\xd8"
_STARTS = re.compile(_FIRST)
_WHOLE = re.compile(rb"\x8d[^\x8d\xd8]{0,%d}(\xd8|\Z)?" % (MAX_FRAME - 2))
_SPECIAL = re.compile(rb"[\x8d\xd8\xab]")
_ESCAPED = re.compile(rb"\xab([\x05\x50\x23])")
_ESCAPES_NOTHING = re.compile(rb"\xab(?![\x05\x50\x23])")
_NODE = 0x0F  # the processor in a target or source
_CLEARED = 0x88  # bits of a special byte, behind AB


class Flags(IntFlag):
    """The first byte of a frame ("Details on the Sphero API", packet structure)."""

    RESPONSE = 0x01
    ANSWER = 0x02  # a response is wanted
    ONLY_ERRORS = 0x04  # but not if the command succeeds
    ACTIVITY = 0x08  # keeps the robot from falling asleep
    TARGET = 0x10
    SOURCE = 0x20
    MORE = 0x80  # a second byte of flags follows; nobody sends it


_TARGET, _SOURCE, _RESPONSE, _MORE = map(int, (Flags.TARGET, Flags.SOURCE, Flags.RESPONSE, Flags.MORE))
_FOLLOW = (_TARGET, _SOURCE, _RESPONSE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """The fields between 8D and D8."""

    did: int
    cid: int
    seq: int
    data: bytes = b""
    flags: Flags = Flags.ACTIVITY  # without TARGET, SOURCE and RESPONSE, which follow from the other fields
    target: int | None = None  # port in the high four bits, processor in the low ones; None if there is none
    source: int | None = None  # as the target
    error: int | None = None  # of a response; None in a command or notification

    def encode(self) -> bytes:
        flags = int(self.flags)
        for flag, value in zip(_FOLLOW, (self.target, self.source, self.error), strict=True):
            flags |= flag if value is not None else 0
        fields = [flags, self.target, self.source, self.did, self.cid, self.seq, self.error]
        body = bytes(field for field in fields if field is not None) + self.data
        body += bytes([~sum(body) & 0xFF])
        return _FIRST + _SPECIAL.sub(lambda special: bytes([0xAB, special[0][0] & ~_CLEARED]), body) + _LAST


def frame_decoder() -> Decoder[Frame]:
    """The decoder of frames of both ends."""
    return Decoder(_STARTS, _size, _read)


def _size(data: bytes, start: int) -> int:
    whole = _WHOLE.match(data, start)
    if whole is None or whole[1] is None:
        return 0
    return whole.end() - start + (whole[1] == b"")


def _read(whole: bytes) -> Frame | None:
    body = _ESCAPED.sub(lambda escaped: bytes([escaped[1][0] | _CLEARED]), whole[1:-1])
    if _ESCAPES_NOTHING.search(whole) or sum(body) & 0xFF != 0xFF:
        return None
    flags = body[0]
    size = 4 + sum(flags & flag != 0 for flag in _FOLLOW)
    if flags & _MORE or len(body) <= size:
        return None
    take = iter(body[1:size]).__next__
    return Frame(
        flags=Flags(flags & ~sum(_FOLLOW)),
        target=take() if flags & _TARGET else None,
        source=take() if flags & _SOURCE else None,
        did=take(),
        cid=take(),
        seq=take(),
        error=take() if flags & _RESPONSE else None,
        data=body[size:-1],
    )


@dataclass(frozen=True, slots=True)
class RvrCommand:
    """A command of the computer."""

    name: str
    processor: Processor
    values: Values
    frame: Frame


@dataclass(frozen=True, slots=True)
class Response:
    """The robot's answer to a command; it has values only if the command succeeded."""

    name: str
    processor: Processor
    values: Values
    error: int  # one of `Error`, or a number that none of the maker's documents has
    seq: int  # of the command


@dataclass(frozen=True, slots=True)
class Notification:
    """A message that the robot sends by itself."""

    name: str
    processor: Processor
    values: Values


@dataclass(frozen=True, slots=True)
class Unknown:
    """A frame without meaning: of an unknown message, with too few data, or a response to no command."""

    frame: Frame
    error: Error  # with which a robot refuses such a command


class Host:
    """The computer's end of the line.

    seq: The number of the latest command.
    """

    def __init__(self, seq: int = 1) -> None:
        """Make an end whose first command has the number `seq`."""
        self._decoder = frame_decoder()
        self.seq = (seq - 1) % 256
        self._awaited: dict[int, tuple[Message, Processor]] = {}
        self._slots = Slots()

    @property
    def counts(self) -> Counts:
        return self._decoder.counts

    def send(
        self, name: str, /, *, target: Processor | None = None, reply: Flags | None = None, **values: Value
    ) -> bytes:
        """The bytes of a command to the robot.

        Args:
            name: One of `COMMANDS`.
            target: The processor, for commands that both take; NORDIC by default.
            reply: ANSWER, or ANSWER with ONLY_ERRORS, for a command that returns nothing; others always want an answer.
            values: Values of the command.

        Raises:
            ProtocolError: if values are missing, unknown, not finite or out of range.
        """
        message = COMMANDS[name]
        processor = target or message.processors[0]
        if processor not in message.processors:
            raise ProtocolError(f"{name}: expected another target, found {processor.name}")
        data = message.carries.pack(values)
        reply = Flags.ANSWER if message.returns else reply or Flags(0)
        if not self._slots.follow(name, processor, values):
            raise ProtocolError(f"{name}: expected services of {processor.name} in a slot, found {values}")
        self.seq = (self.seq + 1) % 256
        while self.seq in self._awaited:
            self.seq = (self.seq + 1) % 256
        if reply:
            if len(self._awaited) == _MAX_AWAITED:
                del self._awaited[next(iter(self._awaited))]
            self._awaited[self.seq] = message, processor
        flags = Flags.ACTIVITY | reply
        return Frame(did=message.did, cid=message.cid, seq=self.seq, data=data, flags=flags, target=processor).encode()

    def receive(self, data: bytes) -> list[Response | Notification | StreamData | Unknown]:
        """The robot's messages that these bytes complete."""
        return [self._event(frame) for frame in self._decoder.receive(data)]

    def _event(self, frame: Frame) -> Response | Notification | StreamData | Unknown:
        if frame.error is not None:
            return self._response(frame, frame.error)
        understood = _understand(_NOTIFICATIONS, frame, frame.source)
        if isinstance(understood, Error):
            return Unknown(frame, understood)
        name, processor, values = understood
        if name == "streaming_service_data":
            measured = self._slots.read(processor, values["token"], values["sensor_data"])
            return measured or Unknown(frame, Error.BAD_DATA_VALUE)
        return Notification(name, processor, values)

    def _response(self, frame: Frame, error: int) -> Response | Unknown:
        message, processor = self._awaited.get(frame.seq, (None, Processor.NORDIC))
        if message is None or (message.did, message.cid) != (frame.did, frame.cid):
            return Unknown(frame, Error.BAD_COMMAND)
        if frame.source is not None and frame.source & _NODE != processor:
            return Unknown(frame, Error.BAD_TARGET)
        del self._awaited[frame.seq]
        values = message.returns.unpack(frame.data) if message.returns and error == Error.SUCCESS else {}
        if values is None:
            return Unknown(frame, Error.BAD_DATA_LENGTH)
        return Response(message.name, processor, values, error, frame.seq)


class RvrEnd:
    """The robot's end of the line.

    slots: The services that it is asked to stream.
    """

    def __init__(self) -> None:
        self._decoder = frame_decoder()
        self.slots = Slots()

    def receive(self, data: bytes) -> list[RvrCommand | Unknown]:
        """The computer's commands that these bytes complete."""
        return [self._event(frame) for frame in self._decoder.receive(data) if frame.error is None]

    def _event(self, frame: Frame) -> RvrCommand | Unknown:
        understood = _understand(_COMMANDS, frame, frame.target)
        if isinstance(understood, Error):
            return Unknown(frame, understood)
        return RvrCommand(*understood, frame)

    def follow(self, command: RvrCommand) -> bool:
        """Configure the slots if an accepted command does so; whether the configuration is valid."""
        return self.slots.follow(command.name, command.processor, command.values)

    def answer(self, frame: Frame, /, error: int = Error.SUCCESS, **values: Value) -> bytes:
        """The response to a command; no bytes if the computer wants none."""
        if Flags.ANSWER not in frame.flags or (Flags.ONLY_ERRORS in frame.flags and error == Error.SUCCESS):
            return b""
        message = _COMMANDS.get((frame.did, frame.cid))
        data = message.returns.pack(values) if message and message.returns and error == Error.SUCCESS else b""
        source = frame.target or (message.processors[0] if message else Processor.NORDIC)
        response = Frame(
            did=frame.did, cid=frame.cid, seq=frame.seq, data=data, flags=Flags(0), source=source, error=error
        )
        return response.encode()

    def notify(self, name: str, /, processor: Processor | None = None, **values: Value) -> bytes:
        """The bytes of one of `NOTIFICATIONS`."""
        message = NOTIFICATIONS[name]
        source = processor or message.processors[0]
        data = message.carries.pack(values)
        return Frame(did=message.did, cid=message.cid, seq=_NOTIFICATION_SEQ, data=data, source=source).encode()

    def stream(self, measured: StreamData) -> bytes:
        """The notification with the values of a slot."""
        return self.notify("streaming_service_data", measured.processor, **self.slots.write(measured))


def _by_number(messages: dict[str, Message]) -> dict[tuple[int, int], Message]:
    return {(message.did, message.cid): message for message in messages.values()}


_COMMANDS, _NOTIFICATIONS = _by_number(COMMANDS), _by_number(NOTIFICATIONS)


def _understand(
    messages: dict[tuple[int, int], Message], frame: Frame, address: int | None
) -> tuple[str, Processor, Values] | Error:
    """The name, the robot's processor and the values of a message; or the error if it cannot be understood."""
    message = messages.get((frame.did, frame.cid))
    if message is None:
        return Error.BAD_COMMAND if any(did == frame.did for did, _ in messages) else Error.BAD_DEVICE
    processor = message.processors[0] if address is None else address & _NODE
    if processor not in message.processors:
        return Error.BAD_TARGET
    values = message.carries.unpack(frame.data)
    return Error.BAD_DATA_LENGTH if values is None else (message.name, Processor(processor), values)
