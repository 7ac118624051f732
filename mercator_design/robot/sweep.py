"""The lidar's last turn: ranges in a ring by angle, each kept until the lidar comes by again."""

import math
from dataclasses import replace

from mercator_design.robot.ydlidar import Packet

BINS = 1440
"""Of the ring: more than an X4 has samples in a turn, so that none takes another's place."""
STEP = math.tau / BINS
"""[rad] from one to the next; the first is at the front."""
LEAST_READINGS = 2
"""In a turn of a lidar that sees something."""

_TURN = 360 * 64  # the unit of angles in packets is a 64th of a degree
_BACKWARDS = 10 * 64  # by which a packet may begin before the end of the one before, as turns are not all alike
_SAME_PASS = 90 * 64  # less than a turn, and more than two packets, of which corrected angles may overlap


class Sweep:
    """Takes packets, whatever their size and number; there are ranges at any time.

    What is old is told by the angle that was swept since, not by time: so it does not matter how fast the lidar turns,
    nor in which pieces its bytes arrive.

    Ranges stay where they were seen if it is told how the robot stood, which may turn by half a radian while the lidar
    goes round: angles are then those of a frame that does not turn.
    """

    def __init__(self, front: float = 0.0) -> None:
        """Begin without a range; `front` is the angle of the lidar's front from the robot's [rad]."""
        self._front = front
        self._ranges = [0.0] * BINS
        self._written = [-_TURN] * BINS  # how far the lidar had swept
        self._swept = 0
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
        packet = replace(packet, first=_seen(packet.first, began), last=_seen(packet.last, ended))
        if self._last is not None:
            ahead = (packet.first - self._last) % _TURN
            self._swept += ahead if ahead < _TURN - _BACKWARDS else 0
        span = (packet.last - packet.first) % _TURN
        for angle, distance in packet.points():
            if distance <= 0.0:
                continue
            k = round((angle + self._front) / STEP) % BINS
            # Corrected angles of what is near and far overlap: the nearer hides the other.
            if not (0.0 < self._ranges[k] < distance and self._swept - self._written[k] < _SAME_PASS):
                self._ranges[k] = distance
                self._written[k] = self._swept + span
        ends = packet.is_ring_start and self._began is not None and self._swept - self._began >= _TURN // 2
        if packet.is_ring_start:
            self._began = self._swept
        self._swept += span
        self._last = packet.last
        return ends

    def ranges(self) -> list[float]:
        """Of each bin [m]; 0 where nothing was seen in the last turn."""
        oldest = self._swept - _TURN
        return [
            distance if written > oldest else 0.0 for distance, written in zip(self._ranges, self._written, strict=True)
        ]


def _seen(angle: int, heading: float) -> int:
    """An angle of a packet, from the robot of a heading [rad], in the frame that does not turn."""
    return round(angle - heading * _TURN / math.tau) % _TURN
