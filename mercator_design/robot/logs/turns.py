"""Turns of the lidar in logs: what came in its packets, and when, small enough for the log of a run.

A turn of a run has the bytes of its samples, and of each packet the first and the last angle: 2.7 kB, a quarter of the
same as readings. Beams leave evenly between two packets; those of a packet had left when it came. With a turn come the
yaws and places of the RVR since the turn before, each with its time.
"""

import base64
import math
from array import array
from collections import deque
from collections.abc import Iterable
from itertools import chain
from sys import byteorder

from mercator_design.robot.devices.link import Heard
from mercator_design.robot.devices.samples import converted
from mercator_design.robot.logs.events import TurnTaken
from mercator_design.robot.protocols.ydlidar import Packet, PacketTurns

_PER_SECOND = 10_000
_MAX_SAMPLES = 200
"""Samples of the RVR between two turns, ten seconds of them; the latest ones are kept."""


class TurnCollector:
    """Makes events of a run of what its devices send."""

    def __init__(self, began: float) -> None:
        """Make one for a log that began at a time [s, of time.monotonic()]."""
        self._began = began
        self._turns = PacketTurns()
        self._yaws: deque[tuple[float, float]] = deque(maxlen=_MAX_SAMPLES)
        self._places: deque[tuple[float, float, float]] = deque(maxlen=_MAX_SAMPLES)

    def take(self, heard: Iterable[Heard]) -> list[TurnTaken]:
        """The turns that end with events of devices."""
        found = []
        for event, now in heard:
            time = round(now - self._began, 4)
            if isinstance(event, Packet):
                if (packets := self._turns.receive(event, time)) and (turn := self._turn(packets)) is not None:
                    found.append(turn)
                continue
            for name, values in converted(event):
                if name == "attitude":
                    self._yaws.append((time, round(values[2], 5)))
                elif name == "position":
                    x, y = values
                    self._places.append((time, round(x, 5), round(y, 5)))
        return found

    def _turn(self, packets: list[tuple[Packet, float]]) -> TurnTaken | None:
        """The event of a turn; None if it ended before the log began."""
        end = packets[-1][1]
        if end < 0.0:
            return None
        turn = TurnTaken(
            time=end,
            packets=times_and_angles(packets),
            ranges=encoded(packet for packet, _ in packets),
            yaws=tuple(self._yaws),
            places=tuple(self._places),
        )
        self._yaws.clear()
        self._places.clear()
        return turn


def times_and_angles(packets: list[tuple[Packet, float]]) -> tuple[tuple[int, int, int, int], ...]:
    """The packets of a turn, as in `TurnTaken.packets`."""
    end = packets[-1][1]
    return tuple(
        (round(_PER_SECOND * (end - time)), packet.first, packet.last, len(packet.samples)) for packet, time in packets
    )


def encoded(packets: Iterable[Packet]) -> str:
    """The samples of packets, as in `TurnTaken.ranges`."""
    samples = array("H", chain.from_iterable(packet.samples for packet in packets))
    if byteorder == "big":
        samples.byteswap()
    return base64.b64encode(samples).decode()


def packets_of(turn: TurnTaken) -> list[tuple[Packet, float]]:
    """The packets of a turn of a run, and when each had come [s, since the log began]."""
    samples = array("H", base64.b64decode(turn.ranges))
    if byteorder == "big":
        samples.byteswap()
    found, begin = [], 0
    for before, first, last, count in turn.packets:
        packet = Packet(first, last, tuple(samples[begin : begin + count]))
        found.append((packet, turn.time - before / _PER_SECOND))
        begin += count
    return found


def readings_of(turn: TurnTaken, front: float) -> tuple[tuple[float, float], ...]:
    """The readings of a turn: angle [rad, from the robot's front] and range [m]; `front` is the lidar's angle [rad]."""
    if turn.readings or not turn.ranges:
        return turn.readings
    return readings((packet for packet, _ in packets_of(turn)), front)


def readings(packets: Iterable[Packet], front: float) -> tuple[tuple[float, float], ...]:
    """The readings of packets, as in `TurnTaken.readings`."""
    points = (point for packet in packets for point in packet.points())
    return tuple((round((angle + front) % math.tau, 5), round(reach, 5)) for angle, reach in points)
