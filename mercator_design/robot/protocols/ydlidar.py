"""The serial line of the YDLIDAR X4: two-byte commands, their answers, and packets of a scan (128000 baud, 8N1).

    A5 command
    A5 5A  length and mode  type  content                        answers
    AA 55  kind  n  first angle  last angle  checksum  n samples     packets

All numbers are little-endian. The device counts angles clockwise; here they are counter-clockwise.
Sources: "YDLIDAR X4 development manual" 1.6, sections 2.2 to 3.5; the YDLidar SDK where it differs.
"""

import math
import re
import struct
from dataclasses import dataclass
from functools import reduce
from operator import xor
from typing import TypeAlias

from mercator_design.robot.protocols.framing import Decoder

COMMANDS = {
    "scan": 0x60,
    "force_scan": 0x61,
    "stop": 0x65,
    "force_stop": 0x00,
    "soft_reboot": 0x80,
    "device_info": 0x90,
    "health": 0x92,
}
"""The bytes behind A5, from the SDK; the manual (3.4) has another for `health`."""
_HEALTH_IN_MANUAL = 0x91
_NAMES = {code: name for name, code in COMMANDS.items()} | {_HEALTH_IN_MANUAL: "health"}

TURN = 360 * 64
"""A full turn; the unit of angles in packets is a 64th of a degree."""
SAMPLE_RATE = 5000
"""Samples per second of an X4 (data sheet)."""
MODEL = 6
"""The model number of an X4."""
MAX_RANGE = 12.0
"""[m] beyond which a sample is no reading (maker's ROS driver)."""
MAX_SAMPLES = 80
"""Samples in a packet, from the SDK; an X4 sends 40."""
MAX_TURN_SAMPLES = 10_000
"""Samples between ring starts, two seconds of them; more are not a turn."""

_BACKWARDS = 10 * 64  # by which a packet may begin before the end of the previous one, as turns differ
_PACKET = struct.Struct("<HBBHHH")
_PACKET_MARK = 0x55AA
_RADIANS = math.tau / TURN
_MM = 4  # samples are quarters of a millimetre
_STARTS = re.compile(rb"\xaa(?:\x55|\Z)|\xa5(?:\x5a|\Z)")

Point: TypeAlias = tuple[float, float]
"""Angle [rad], counter-clockwise from the device's front, 0 to 2 pi; range [m], 0 if nothing came back."""


def correction(range_m: float) -> float:
    """The angle to add to a sample's angle [rad, counter-clockwise]: laser and lens are apart (manual, 3.1).

    Args:
        range_m: Range [m] of the sample; 0 if nothing came back.
    """
    mm = 1000.0 * range_m
    return -math.atan(21.8 * (155.3 - mm) / (155.3 * mm)) if range_m > 0.0 else 0.0


@dataclass(frozen=True, slots=True)
class Packet:
    """A part of a turn (manual, 3.1)."""

    first: int  # angle of the first sample [degrees / 64, clockwise], before correction
    last: int  # that of the last one
    samples: tuple[int, ...]  # ranges [mm / 4]; 0 where nothing came back
    is_ring_start: bool = False  # whether a turn begins
    frequency: int = 0  # turns per second [Hz / 10], which a ring start may have; else 0

    @property
    def is_suspect(self) -> bool:
        """Whether its angles go backwards elsewhere than through north, so that those of the samples are unknown."""
        return self.last < self.first and (self.first < 3 * TURN // 4 or self.last > TURN // 4)

    def points(self) -> list[Point]:
        """The samples in their order, clockwise."""
        step = (self.last - self.first) % TURN / max(len(self.samples) - 1, 1)
        first, turn = self.first, math.tau
        ranges = [sample / (1000.0 * _MM) for sample in self.samples]
        return [
            (((correction(r) if r else 0.0) - (first + i * step) * _RADIANS) % turn % turn, r)
            for i, r in enumerate(ranges)
        ]

    def encode(self) -> bytes:
        kind = self.frequency << 1 | self.is_ring_start
        head = [_PACKET_MARK, kind, len(self.samples), self.first << 1 | 1, self.last << 1 | 1]
        words = struct.pack(f"<{len(self.samples)}H", *self.samples)
        return _PACKET.pack(*head, _checksum(_PACKET.pack(*head, 0) + words)) + words


@dataclass(frozen=True, slots=True)
class DeviceInfo:
    """The identity of the device (manual, 3.3)."""

    model: int  # 6 for an X4
    firmware: tuple[int, int]  # major and minor number, as the SDK reads them; the manual has them the other way round
    hardware: int
    serial: str  # sixteen digits

    def encode(self) -> bytes:
        """The answer to `device_info`."""
        major, minor = self.firmware
        return _INFO + bytes([self.model, minor, major, self.hardware, *map(int, self.serial)])


@dataclass(frozen=True, slots=True)
class Health:
    """The health of the device (manual, 3.4)."""

    status: int  # 0 for good, 1 for a warning, 2 for an error
    error_code: int = 0

    def encode(self) -> bytes:
        """The answer to `health`."""
        return _HEALTH + struct.pack("<BH", self.status, self.error_code)


@dataclass(frozen=True, slots=True)
class ScanStarted:
    """The answer that the device scans; packets follow."""

    def encode(self) -> bytes:
        """The answer to `scan` and `force_scan`."""
        return _SCAN


Event: TypeAlias = Packet | DeviceInfo | Health | ScanStarted
_INFO, _HEALTH, _SCAN = (bytes.fromhex(h) for h in ("a55a1400000004", "a55a0300000006", "a55a0500004081"))
_ANSWERS = {_INFO: 27, _HEALTH: 10, _SCAN: 7}


def encode_command(name: str) -> bytes:
    """The bytes of one of `COMMANDS`."""
    return bytes([0xA5, COMMANDS[name]])


def command_decoder() -> Decoder[str]:
    """The decoder of what the computer sends; its events are names of `COMMANDS`."""
    return Decoder(re.compile(rb"\xa5"), lambda _, __: 2, lambda command: _NAMES.get(command[1]))


def decoder() -> Decoder[Event]:
    """The decoder of what the device sends: packets with a right checksum, and answers."""
    return Decoder(_STARTS, _size, _read)


def _size(data: bytes, start: int) -> int:
    head = data[start : start + _PACKET.size]
    if head[0] == 0xA5:
        return next((size for answer, size in _ANSWERS.items() if answer.startswith(head[:7])), 0)
    possible = (
        (len(head) < 4 or 1 <= head[3] <= MAX_SAMPLES)
        and (len(head) < 5 or head[4] & 1)
        and (len(head) < 7 or head[6] & 1)
    )
    return (_PACKET.size + (2 * head[3] if len(head) > 3 else 0)) if possible else 0


def _read(whole: bytes) -> Event | None:
    if whole[0] == 0xAA:
        _, kind, n, first, last, checksum = _PACKET.unpack_from(whole)
        if checksum != _checksum(whole):
            return None
        samples = struct.unpack_from(f"<{n}H", whole, _PACKET.size)
        return Packet(first >> 1, last >> 1, samples, bool(kind & 1), kind >> 1)
    content = whole[7:]
    if whole[:7] == _INFO:
        model, minor, major, hardware, *digits = content
        return DeviceInfo(model, (major, minor), hardware, "".join(map(str, digits))) if max(digits) < 10 else None
    if whole[:7] == _HEALTH:
        return Health(*struct.unpack("<BH", content)) if content[0] <= 2 else None
    return ScanStarted()


def _checksum(whole: bytes) -> int:
    """The exclusive or of all words but the checksum itself."""
    words: tuple[int, ...] = struct.unpack(f"<{len(whole) // 2}H", whole)
    return reduce(xor, words) ^ words[4]


def angle_ahead(last: int, first: int) -> int:
    """The angle from a packet's last sample to the next one's first; 0 if they overlap."""
    ahead = (first - last) % TURN
    return ahead if ahead < TURN - _BACKWARDS else 0


class PacketTurns:
    """Joins packets to whole turns, without suspect packets and those before the first turn begins.

    A turn begins with a ring start, or, if this is lost, with the first packet beyond north. A ring start less than
    half a turn later belongs to the turn that has begun at north.
    """

    def __init__(self) -> None:
        self._packets: list[tuple[Packet, float]] | None = None
        self._samples = 0
        self._last: Packet | None = None
        self._turned = 0  # from the turn's first sample to that of the last packet [degrees / 64]
        self._began_at_north = False

    def receive(self, packet: Packet, time: float = 0.0) -> list[tuple[Packet, float]] | None:
        """Take a packet that came at a time; return the turn that it ends by beginning the next one, with the times."""
        ended = None
        if self._begins(packet):
            ended, self._packets, self._samples = self._packets, [], 0
        if self._packets is not None and not packet.is_suspect:
            self._packets.append((packet, time))
            self._samples += len(packet.samples)
            if self._samples > MAX_TURN_SAMPLES:
                self._packets = None
        return ended

    def _begins(self, packet: Packet) -> bool:
        """Whether a turn begins with a packet."""
        is_beyond_north = False
        if not packet.is_suspect:
            if (last := self._last) is not None:
                step = (last.last - last.first) % TURN + angle_ahead(last.last, packet.first)
                is_beyond_north = last.first + step >= TURN
                self._turned += step
            self._last = packet
        is_far = self._turned >= TURN // 2
        begins = is_far or not self._began_at_north if packet.is_ring_start else is_far and is_beyond_north
        if begins:
            self._turned, self._began_at_north = 0, not packet.is_ring_start
        return begins


class Turns:
    """As `PacketTurns`, of samples without their times."""

    def __init__(self) -> None:
        self._turns = PacketTurns()

    def receive(self, packet: Packet) -> list[Point] | None:
        """Take a packet; return the turn that it ends by beginning the next one."""
        ended = self._turns.receive(packet)
        return None if ended is None else [point for each, _ in ended for point in each.points()]
