"""The twin's YDLIDAR X4: bytes of commands in, bytes of answers and packets out.

The laser is beside the lens, so the true angle of a sample differs from the reported one, depending on the range. A
decoder corrects this; here the ranges of a fine scan are placed at the angles that a device would report.
"""

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from operator import xor
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Floats
from mercator_design.jit import compiled
from mercator_design.robot.protocols.ydlidar import (
    MODEL,
    SAMPLE_RATE,
    TURN,
    DeviceInfo,
    Health,
    Packet,
    ScanStarted,
    command_decoder,
    correction,
)

Scan: TypeAlias = Callable[[float], tuple[Floats, float]]
"""Returns FINE ranges [m] for each sample at a time [s], counter-clockwise from the robot's front, 0 if nothing is in
range; and how fast the robot then turns [rad/s]."""

SPINS_UP = 0.5
"""[s] that the motor takes to reach its speed."""
FINE = 4

_PACKET = 40  # samples at most
_MM = 4000.0  # units of ranges in a metre
_REBOOTS = 0.5  # [s]
_MAX_RANGE = 0xFFFF
_MIN_CORRECTION, _MAX_CORRECTION = math.radians(-5.0), math.radians(8.0)  # for ranges from 0.1 m on
_AT, _SPREAD = 0.5, 1.2  # [beams] up to which a range belongs to a place, and up to which it is used if none does
_BEHIND = 1e6  # farther than any range [m]
_INTENSITY = 0x55  # of each sample
_CORRECTIONS = np.array([correction(mm / 1000.0) for mm in range(_MAX_RANGE // 4 + 1)])  # by range [mm]


@dataclass(frozen=True, slots=True)
class Hiding:
    """Something that hides what is around, or a laser that fails."""

    distance: float  # [m] at which it is seen; 0: nothing is seen
    sector: tuple[float, float] | None = None  # [degrees, counter-clockwise from the front]; None: all around
    turns: float = 1.0  # part of the turns, evenly distributed

    def is_in(self, turn: int) -> bool:
        """Whether it is there in the turn of a number."""
        return math.floor((turn + 1) * self.turns) > math.floor(turn * self.turns)

    def covers(self, degrees: Floats) -> NDArray[np.bool_]:
        """Whether it covers each of some angles."""
        if self.sector is None:
            return np.full(len(degrees), fill_value=True)
        first, last = self.sector
        return (degrees - first) % 360.0 <= (last - first) % 360.0


@dataclass(frozen=True, slots=True)
class LidarState:
    """Changes of a lidar by faults."""

    model: int = MODEL
    rate: float | None = None  # [1/s] of turns; None: the usual one
    has_intensities: bool = False  # whether samples have three bytes, the first one an intensity
    is_one_way: bool = False  # whether it sends while its motor turns, and hears nothing
    unanswered: frozenset[str] = frozenset()  # commands
    hidings: tuple[Hiding, ...] = ()


class TwinLidar:
    """The lidar. Its motor has power while its port is open, because DTR is on then.

    health: The reported state: 0 good, 1 warning, 2 error.
    """

    def __init__(self, scan: Scan, *, samples: int, number: int = 0) -> None:
        """A lidar without power on its motor.

        Args:
            scan: Returns the ranges around the robot.
            samples: Samples in a turn.
            number: Number of the robot, for the serial number.
        """
        self._scan, self._usual_samples, self._number = scan, samples, number
        self._samples = samples
        self._state = LidarState()
        self.health = 0
        self._line = command_decoder()
        self._ready = -math.inf  # time from which it listens
        self._turns = math.inf  # time from which the motor has its speed
        self._scans = math.inf  # time from which it scans
        self._sent = 0  # samples of this scan
        self._found, self._scratch = np.zeros(_PACKET), np.zeros(_PACKET)

    def set_motor(self, *, on: bool, now: float) -> None:
        """Switch the motor on or off."""
        self._turns = math.inf if not on else min(self._turns, now + SPINS_UP)
        self._restart(now)

    def change(self, state: LidarState, now: float) -> None:
        """Take on the state in which faults put it; a turn begins anew if its speed changes."""
        self._state, before = state, self._samples
        self._samples = self._usual_samples if state.rate is None else round(SAMPLE_RATE / state.rate)
        if state.is_one_way:
            self._scans = min(self._scans, now)
        if self._samples != before:
            self._restart(now)

    def receive(self, data: bytes, now: float) -> bytes:
        """The answer to these bytes; while it scans, it obeys only the commands that end the scan."""
        said = self.advance(now)
        if self._state.is_one_way:
            return said
        return said + b"".join(self.obey(command, now) for command in self._line.receive(data))

    def advance(self, now: float) -> bytes:
        """The packets that are complete."""
        said = []
        start = max(self._scans, self._turns)
        while start <= now:
            first = self._sent % self._samples
            count = 1 if first == 0 else min(_PACKET, self._samples - first)
            if (self._sent + count) / SAMPLE_RATE > now - start:
                break
            said.append(self._packet(first, count, start + (self._sent + 0.5 * (count - 1)) / SAMPLE_RATE))
            self._sent += count
        return b"".join(said)

    def obey(self, command: str, now: float) -> bytes:
        """Do what a command says; returns the bytes of its answer."""
        if command in {"stop", "force_stop", "soft_reboot"}:
            self._scans = math.inf
            self._ready = now + _REBOOTS if command == "soft_reboot" else now
        elif now < self._ready or self._scans <= now:
            pass
        elif command in self._state.unanswered:
            if command == "scan":
                self._scans = now
                self._restart(now)
        elif command == "device_info":
            return DeviceInfo(self._state.model, (1, 4), 1, f"{2026112100000000 + self._number:016}").encode()
        elif command == "health":
            return Health(self.health).encode()
        else:
            self._scans = now
            self._restart(now)
            return ScanStarted().encode()
        return b""

    def _restart(self, now: float) -> None:
        """Begin a new turn of the scan."""
        self._sent = 0
        self._scans = max(self._scans, now)

    def _packet(self, first: int, count: int, middle: float) -> bytes:
        """The samples from one on, whose mean time is `middle` [s]: each sees from where the robot then faces."""
        found = self._found[:count]
        around, turning = self._scan(middle)
        compiled(put)(around, _CORRECTIONS, self._samples, first, turning / SAMPLE_RATE, found, self._scratch)
        self._hide(first, found)
        ranges = tuple(np.minimum(np.rint(_MM * found), _MAX_RANGE).astype(int).tolist())
        step = TURN / self._samples
        packet = Packet(round(first * step), round((first + count - 1) * step), ranges, is_ring_start=first == 0)
        return with_intensities(packet) if self._state.has_intensities else packet.encode()

    def _hide(self, first: int, found: Floats) -> None:
        """Hide ranges [m] of samples from the number `first` on, clockwise from the front, as faults do."""
        turn, places = self._sent // self._samples, -360.0 / self._samples * (first + np.arange(len(found)))
        for hiding in self._state.hidings:
            if hiding.is_in(turn):
                seen = found if hiding.distance == 0.0 else np.full(len(found), hiding.distance)
                corrections = _CORRECTIONS[np.minimum(np.rint(1000.0 * seen).astype(int), len(_CORRECTIONS) - 1)]
                found[hiding.covers(places + np.degrees(corrections))] = hiding.distance


def with_intensities(packet: Packet) -> bytes:
    """The bytes of a packet of models whose samples have three bytes, the first one an intensity."""
    usual = packet.encode()
    head, words = list(struct.unpack_from("<5H", usual)), packet.samples
    head[4] = reduce(xor, (*head[:4], *words, *[_INTENSITY] * len(words)))
    return struct.pack("<5H", *head) + b"".join(struct.pack("<BH", _INTENSITY, word) for word in words)


def put(
    ranges: Floats, corrections: Floats, samples: int, first: int, turned: float, found: Floats, ranks: Floats
) -> None:
    """Place ranges at the samples where a device would report them.

    If several objects come to the same sample, the nearest one hides the others; if none does, the range is 0.

    Args:
        ranges: (beams,) [m], counter-clockwise from the front; 0 if nothing is in range.
        corrections: Corrections of angles [rad], by range [mm].
        samples: Samples in a turn.
        first: Number of the first sample, clockwise from the front.
        turned: Angle [rad] by which the robot turns from one sample to the next; the ranges are of their mean time.
        found: (count,) receives the ranges of the samples from there on [m].
        ranks: (count or more,) scratch.
    """
    beams, count = len(ranges), len(found)
    step, fine = 2.0 * math.pi / samples, 2.0 * math.pi / beams
    for j in range(count):
        found[j] = 0.0
        ranks[j] = math.inf
    middle, spread = 0.5 * (count - 1), abs(turned) * count
    begin = math.floor((_MIN_CORRECTION - spread - (first + count) * step) / fine)
    end = math.ceil((_MAX_CORRECTION + spread - (first - 1) * step) / fine)
    for k in range(begin, end + 1):
        r = ranges[k % beams]
        if r == 0.0:
            continue
        angle = corrections[min(int(1000.0 * r + 0.5), len(corrections) - 1)] - k * fine
        place = (angle - first * step - turned * middle) / (step - turned)
        j = math.floor(place + 0.5)
        off = abs(place - j) * FINE  # in beams
        if not 0 <= j < count or off > _SPREAD:
            continue
        rank = r if off <= _AT else _BEHIND + off  # the nearest one at the place, else the nearest beside it
        if rank < ranks[j]:
            ranks[j] = rank
            found[j] = r
