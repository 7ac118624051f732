"""The lidar's last turn: ranges in a ring by angle, each kept until the lidar has looked there again.

Where a packet is lost the lidar has not looked, as far as is known: what was seen there in the turn before is kept for
one more turn. How much of what it sweeps is lost is counted.
"""

import math
from collections import deque
from dataclasses import replace
from typing import NamedTuple

from mercator_design.robot.protocols.ydlidar import Packet

BINS = 1440
"""Of the ring: more than an X4 has samples in a turn, so that none takes another's place."""
STEP = math.tau / BINS
"""[rad] from one to the next; the first is at the front."""
MIN_READINGS = 2
"""In a turn of a lidar that sees something."""

_TURN = 360 * 64  # the unit of angles in packets is a 64th of a degree
_BACKWARDS = 10 * 64  # by which a packet may begin before the end of the one before, as turns are not all alike
_GAP = 4 * 64  # between the angles of packets, from which on samples are missing; a sample is 0.36 to 0.86 degrees
_ASIDE = 2 * 64  # of a gap, within which it may be that the lidar has not looked; a turn is not quite like the other
_SAME_PASS = 90 * 64  # less than a turn, and more than two packets, of which corrected angles may overlap


class Swept(NamedTuple):
    """How far the lidar has turned [degrees / 64], and for how much of that no samples came."""

    all: int = 0
    lost: int = 0


class Sweep:
    """Takes packets, whatever their size and number; there are ranges at any time.

    What is old is told by the angle that was swept since, not by time: so it does not matter how fast the lidar turns,
    nor in which pieces its bytes arrive.

    Ranges stay where they were seen if it is told how the robot stood, which may turn by half a radian while the lidar
    goes round: angles are then those of a frame that does not turn.

    swept: How far the lidar has turned, against the robot, and how much of that was lost.
    """

    def __init__(self, front: float = 0.0) -> None:
        """Begin without a range; `front` is the angle of the lidar's front from the robot's [rad]."""
        self._front = front
        self._ranges = [0.0] * BINS
        self._written = [-_TURN] * BINS  # how far the lidar had swept
        self._places = [-_TURN] * BINS  # the same, of the sample itself
        self._swept = 0
        self._gaps: deque[tuple[int, int]] = deque()  # of the last turn: from where to where nothing came
        self._seen: int | None = None  # as _last, against the robot
        self.swept = Swept()
        self._last: int | None = None  # angle of the last packet's last sample
        self._began: int | None = None  # how far the lidar had swept at the last ring start

    @property
    def is_whole(self) -> bool:
        """Whether a whole turn has been seen."""
        return self._swept >= _TURN

    def add(self, packet: Packet, began: float = 0.0, ended: float = 0.0) -> bool:
        """Take in a packet; whether it ends a turn. Ring starts of a lidar that does not get round end none.

        Args:
            packet: Of the lidar.
            began: The robot's heading [rad] at the packet's first sample ...
            ended: ... and at its last.
        """
        if packet.is_suspect:
            return False
        is_gap = self._count(packet)
        packet = replace(packet, first=_seen(packet.first, began), last=_seen(packet.last, ended))
        if self._last is not None:
            ahead = _ahead(self._last, packet.first)
            if is_gap:
                self._gaps.append((self._swept - _ASIDE, self._swept + ahead + _ASIDE))
            self._swept += ahead
        span = (packet.last - packet.first) % _TURN
        while self._gaps and self._gaps[0][1] < self._swept + span - _TURN:
            self._gaps.popleft()
        step = span / max(len(packet.samples) - 1, 1)
        for i, (angle, distance) in enumerate(packet.points()):
            if distance <= 0.0:
                continue
            k = round((angle + self._front) / STEP) % BINS
            # Corrected angles of what is near and far overlap: the nearer hides the other.
            if not (0.0 < self._ranges[k] < distance and self._swept - self._written[k] < _SAME_PASS):
                self._ranges[k] = distance
                self._written[k] = self._swept + span
                self._places[k] = self._swept + round(i * step)
        ends = packet.is_ring_start and self._began is not None and self._swept - self._began >= _TURN // 2
        if packet.is_ring_start:
            self._began = self._swept
        self._swept += span
        self._last = packet.last
        return ends

    def _count(self, packet: Packet) -> bool:
        """Count how far the lidar has turned with a packet; whether samples before it are missing."""
        ahead = 0 if self._seen is None else _ahead(self._seen, packet.first)
        is_gap = ahead > _GAP
        self._seen = packet.last
        turned = ahead + (packet.last - packet.first) % _TURN
        self.swept = Swept(self.swept.all + turned, self.swept.lost + (ahead if is_gap else 0))
        return is_gap

    def ranges(self) -> list[float]:
        """Of each bin [m]; 0 where nothing was seen in the last turn, or in the one before if nothing came since."""
        oldest = self._swept - _TURN
        found = [
            distance if written > oldest else 0.0 for distance, written in zip(self._ranges, self._written, strict=True)
        ]
        if self._gaps:
            for k in [k for k, written in enumerate(self._written) if oldest - _TURN < written <= oldest]:
                now = self._places[k] + _TURN
                if any(begin <= now <= end for begin, end in self._gaps):
                    found[k] = self._ranges[k]
        return found


def _ahead(last: int, first: int) -> int:
    """How far it is from a packet's last sample to the next one's first; 0 if that is before it."""
    ahead = (first - last) % _TURN
    return ahead if ahead < _TURN - _BACKWARDS else 0


def _seen(angle: int, heading: float) -> int:
    """An angle of a packet, from the robot of a heading [rad], in the frame that does not turn."""
    return round(angle - heading * _TURN / math.tau) % _TURN
