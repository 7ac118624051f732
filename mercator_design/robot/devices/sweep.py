"""The lidar's last turn: ranges in a ring by angle, each kept until the lidar has measured there again.

Where a packet is lost, ranges of the turn before are kept for one more turn. The lost share of the turn is counted;
whole turns that are lost show by the time that passes.
"""

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple, TypeAlias

from mercator_design.robot.protocols.ydlidar import MAX_RANGE, SAMPLE_RATE, TURN, Packet, angle_ahead

BINS = 1440
"""Bins of the ring: more than an X4 has samples in a turn, so that each sample has its own bin."""
STEP = math.tau / BINS
"""[rad] from one bin to the next; the first is at the front."""
Sector: TypeAlias = tuple[float, float]
"""Two angles [degrees, counter-clockwise from the robot's front]: from the first one on to the second."""

_GAP = 4 * 64  # between packets, above which samples are missing; samples are 0.36 to 0.86 degrees apart
_ASIDE = 2 * 64  # margin of a gap, as turns differ
_SURE = 0.9  # part of the samples that a lidar has measured at least in a time
_MAX_MISSING = 0.6 * TURN  # angle that is missing, above which it is a whole turn
_LATE = 0.1  # [s] for packets that are read late
_SAME_PASS = 90 * 64  # less than a turn, and more than two packets, of which corrected angles may overlap


def covered(sectors: Iterable[Sector]) -> bytes:
    """For each bin, counted from the robot's front, whether one of the sectors covers it."""
    covers = bytearray(BINS)
    for first, last in sectors:
        begin = math.ceil(first * BINS / 360.0)
        for k in range(begin, begin + math.floor((last - first) % 360.0 * BINS / 360.0) + 1):
            covers[k % BINS] = True
    return bytes(covers)


class Swept(NamedTuple):
    """The angle that the lidar has turned [degrees / 64], and the part of it without samples."""

    all: int = 0
    lost: int = 0


class Sweep:
    """Takes packets of any size and number, and has ranges at any time.

    The age of a range is the angle swept since, not a time: so the lidar's speed and the pieces in which bytes arrive
    do not matter.

    With the robot's headings, angles are those of a frame that does not turn: the robot may turn by half a radian
    during a turn of the lidar.

    swept: The angle that the lidar has turned, relative to the robot, and the lost part.
    readings: Number of readings in the turn that ended last, without those nearer than `nearest`.
    """

    def __init__(self, front: float = 0.0, blind: Iterable[Sector] = (), nearest: float = 0.0) -> None:
        """Make one without ranges.

        Args:
            front: Angle of the lidar's front from the robot's [rad].
            blind: Sectors of which readings are ignored.
            nearest: Distance [m] below which readings are not counted.
        """
        self._front, self._blind, self._nearest = front, covered(blind), nearest
        self._is_partly_blind = any(self._blind)
        self._ranges = [0.0] * BINS
        self._written = [-TURN] * BINS  # angle swept at the end of the packet
        self._places = [-TURN] * BINS  # angle swept at the sample itself
        self._swept = 0
        self._gaps: deque[tuple[int, int]] = deque()  # of the last turn: angles swept between which nothing came
        self._seen: int | None = None  # as _last, relative to the robot
        self.swept = Swept()
        self.readings = self._readings = 0  # the latter of the present turn
        self._read = math.inf  # time of the latest packet [s]
        self._step = 0.0  # angle from one sample to the next
        self._behind = 0.0  # angle that is missing by the time
        self._paused = math.inf  # time of the packet behind the latest pause [s]
        self._last: int | None = None  # angle of the last packet's last sample
        self._began: int | None = None  # angle swept at the last ring start

    @property
    def is_whole(self) -> bool:
        """Whether a whole turn has been seen."""
        return self._swept >= TURN

    def add(self, packet: Packet, began: float = 0.0, ended: float = 0.0, read: float = 0.0) -> bool:
        """Take in a packet; return whether it ends a turn. A ring start before half a turn ends none.

        Args:
            packet: The packet.
            began: The robot's heading [rad] at the packet's first sample.
            ended: The robot's heading [rad] at its last sample.
            read: Time [s] at which it was read, perhaps late and with others.
        """
        if packet.is_suspect:
            return False
        is_gap = self._count(packet, read)
        if self._is_partly_blind:
            packet = self._masked(packet)
        packet = replace(packet, first=_seen(packet.first, began), last=_seen(packet.last, ended))
        if self._last is not None:
            ahead = angle_ahead(self._last, packet.first)
            if is_gap:
                self._gaps.append((self._swept - _ASIDE, self._swept + ahead + _ASIDE))
            self._swept += ahead
        ends = packet.is_ring_start and self._began is not None and self._swept - self._began >= TURN // 2
        if packet.is_ring_start:
            self._began = self._swept
        if ends:
            self.readings, self._readings = self._readings, 0
        span = (packet.last - packet.first) % TURN
        while self._gaps and self._gaps[0][1] < self._swept + span - TURN:
            self._gaps.popleft()
        step = span / max(len(packet.samples) - 1, 1)
        for i, (angle, distance) in enumerate(packet.points()):
            if not 0.0 < distance <= MAX_RANGE:
                continue
            self._readings += distance >= self._nearest
            k = self._bin(angle)
            # Corrected angles of near and far samples overlap: the nearer one counts.
            if not (0.0 < self._ranges[k] < distance and self._swept - self._written[k] < _SAME_PASS):
                self._ranges[k] = distance
                self._written[k] = self._swept + span
                self._places[k] = self._swept + round(i * step)
        self._swept += span
        self._last = packet.last
        return ends

    def _bin(self, angle: float) -> int:
        """The bin of a reading at an angle from the lidar's front [rad]."""
        return round((angle + self._front) / STEP) % BINS

    def _masked(self, packet: Packet) -> Packet:
        """A packet without the readings in blind sectors."""
        seen = zip(packet.samples, packet.points(), strict=True)
        samples = tuple(0 if self._blind[self._bin(angle)] else sample for sample, (angle, _) in seen)
        return replace(packet, samples=samples)

    def _count(self, packet: Packet, read: float) -> bool:
        """Add a packet to `swept`; return whether samples before it are missing."""
        ahead = 0 if self._seen is None else angle_ahead(self._seen, packet.first)
        is_gap = ahead > _GAP
        self._seen = packet.last
        span = (packet.last - packet.first) % TURN
        missing = self._missing_turns(read)
        self._behind = max(0.0, self._behind - missing - ahead - span)
        if len(packet.samples) > 1:
            self._step = span / (len(packet.samples) - 1)
        lost = missing + (ahead if is_gap else 0)
        self.swept = Swept(self.swept.all + missing + ahead + span, self.swept.lost + lost)
        return is_gap

    def _missing_turns(self, read: float) -> int:
        """The angle of whole turns that are missing before the latest pause, once late packets have been read."""
        waited = _SURE * SAMPLE_RATE * self._step * max(0.0, read - self._read)
        self._read = read
        if waited > _MAX_MISSING:
            self._paused = read
        if waited > _MAX_MISSING or self._behind > 0.0:
            self._behind += waited
        if self._behind <= _MAX_MISSING or read - self._paused <= _LATE:
            return 0
        return TURN * max(1, round(self._behind / TURN))

    def ranges(self) -> list[float]:
        """The range of each bin [m]; 0 where nothing was seen in the last turn, or, in a gap, in the turn before."""
        oldest = self._swept - TURN
        found = [
            distance if written > oldest else 0.0 for distance, written in zip(self._ranges, self._written, strict=True)
        ]
        if self._gaps:
            for k in [k for k, written in enumerate(self._written) if oldest - TURN < written <= oldest]:
                now = self._places[k] + TURN
                if any(begin <= now <= end for begin, end in self._gaps):
                    found[k] = self._ranges[k]
        return found


def _seen(angle: int, heading: float) -> int:
    """An angle of a packet in the frame that does not turn, with the robot's heading [rad]."""
    return round(angle - heading * TURN / math.tau) % TURN
