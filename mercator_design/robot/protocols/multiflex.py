"""The serial line (USB) of the Teraranger Hub Multiflex: distances, commands and their acknowledgements.

    4D 46  eight distances  mask  CRC          "MF", big-endian: binary output
    4D 46  eight times a tab and a number  0D 0A                 text output
    00  command  argument ...  CRC             commands
    52 45  command  00 or FF  CRC              "RE": acknowledgements

Source: "TeraRanger Multiflex" (data sheet of 2017), section 4, on its UART and USB protocol.
"""

import math
import re
import struct
from dataclasses import dataclass
from typing import TypeAlias

from mercator_design.robot.protocols.framing import Decoder

SENSORS = 8
MIN_DISTANCE, MAX_DISTANCE = 50, 2000
"""Limits of what is measured [mm], from the maker's ROS driver."""
NOTHING = 0xFFFF
"""The distance without a sensor, or with nothing in sight."""

_FRAME = struct.Struct(f">2s{SENSORS}HBB")
_TEXT = re.compile(rb"MF(?:\t(?:-1|\d{1,5})){%d}\r\n" % SENSORS)
_TEXT_BEGUN = re.compile(rb"MF(?:\t(?:-1|\d{1,5})){0,%d}(?:\t-?|\r)?\Z" % SENSORS)
_SIZES = {0x11: 4, 0x21: 4, 0x52: 5}
_OK, _REFUSED = 0x00, 0xFF


def _crc8_of(crc: int) -> int:
    for _ in range(8):
        crc = crc << 1 ^ (0x107 if crc & 0x80 else 0)
    return crc


_CRCS = bytes(map(_crc8_of, range(0x100)))


def crc8(data: bytes) -> int:
    """CRC-8 with polynomial 07 and initial value 0."""
    crc = 0
    for byte in data:
        crc = _CRCS[crc ^ byte]
    return crc


@dataclass(frozen=True, slots=True)
class Distances:
    """What the sensors measured (data sheet, 4.2)."""

    millimetres: tuple[int, ...]  # of each sensor; 65535 if there is none
    mask: int = 0xFF  # bit i is set if sensor i is in use

    def metres(self) -> list[float]:
        """The distances [m]: inf if nothing is in sight, -inf if something is too near, NaN if the sensor is off."""
        return [_metres(mm) if self.mask >> i & 1 else math.nan for i, mm in enumerate(self.millimetres)]

    def encode(self) -> bytes:
        """The frame of binary output."""
        frame = _FRAME.pack(b"MF", *self.millimetres, self.mask, 0)[:-1]
        return frame + bytes([crc8(frame)])

    def encode_text(self) -> bytes:
        """The line of text output, which has no mask."""
        return b"MF" + b"".join(b"\t%d" % (-1 if mm == NOTHING else mm) for mm in self.millimetres) + b"\r\n"


def _metres(mm: int) -> float:
    if mm == NOTHING or MAX_DISTANCE < mm < 0x8000:
        return math.inf
    return mm / 1000.0 if MIN_DISTANCE <= mm <= MAX_DISTANCE else -math.inf


@dataclass(frozen=True, slots=True)
class HubCommand:
    """A command to the hub, which acknowledges it (data sheet, 4.1 and 4.3)."""

    code: int
    arguments: bytes

    def encode(self) -> bytes:
        body = bytes([0, self.code]) + self.arguments
        return body + bytes([crc8(body)])


TEXT_MODE, BINARY_MODE = HubCommand(0x11, b"\x01"), HubCommand(0x11, b"\x02")


def use_sensors(mask: int) -> HubCommand:
    """The command to use the sensors whose bits are set (data sheet, 4.4)."""
    return HubCommand(0x52, bytes([3, mask]))


@dataclass(frozen=True, slots=True)
class Acknowledgement:
    """The hub has obeyed a command, or refused it (data sheet, 4.1)."""

    code: int
    ok: bool

    def encode(self) -> bytes:
        body = b"RE" + bytes([self.code, _OK if self.ok else _REFUSED])
        return body + bytes([crc8(body)])


Event: TypeAlias = Distances | Acknowledgement


def decoder() -> Decoder[Event]:
    """The decoder of what the hub sends, in binary or text output."""
    return Decoder(re.compile(rb"M(?:F|\Z)|R(?:E|\Z)"), _size, _read)


def command_decoder() -> Decoder[HubCommand]:
    """The decoder of what the computer sends."""
    return Decoder(re.compile(rb"\0"), _command_size, _read_command)


def _size(data: bytes, start: int) -> int:
    if data[start] == ord("R"):
        return 5
    if text := _TEXT.match(data, start):
        return text.end() - start
    # What may become text is not tried as binary, which one in 256 would be by chance.
    return max(_FRAME.size, len(data) + 1 - start if _TEXT_BEGUN.match(data, start) else 0)


def _read(whole: bytes) -> Event | None:
    if _TEXT.fullmatch(whole):
        numbers = tuple(NOTHING if number == b"-1" else int(number) for number in whole[3:-2].split(b"\t"))
        return Distances(numbers) if max(numbers) <= NOTHING else None
    if crc8(whole):
        return None
    if whole[:1] == b"R":
        return Acknowledgement(whole[2], whole[3] == _OK) if whole[3] in (_OK, _REFUSED) else None
    _, *millimetres, mask, _ = _FRAME.unpack(whole)
    return Distances(tuple(millimetres), mask)


def _command_size(data: bytes, start: int) -> int:
    return _SIZES.get(data[start + 1], 0) if start + 1 < len(data) else 2


def _read_command(whole: bytes) -> HubCommand | None:
    return None if crc8(whole) else HubCommand(whole[1], whole[2:-1])
