"""The twin's Teraranger Hub Multiflex: bytes of commands in, bytes of acknowledgements and distances out."""

from collections.abc import Callable, Sequence

from mercator_design.robot.protocols.multiflex import (
    BINARY_MODE,
    MAX_DISTANCE,
    NOTHING,
    SENSORS,
    TEXT_MODE,
    Acknowledgement,
    Distances,
    HubCommand,
    command_decoder,
    use_sensors,
)
from mercator_design.twin.devices import next_due

RATE = 50.0
"""[1/s] Measurements of all sensors together; a frame has one of each sensor in use (data sheet of 2017)."""


class TwinHub:
    """The hub. It sends as soon as it has power.

    plugged_in: Bit i is set if sensor i is connected.
    is_old: Whether its firmware refuses all commands.
    """

    def __init__(self, measure: Callable[[], Sequence[float]]) -> None:
        """A hub in binary mode with all sensors in use.

        Args:
            measure: Returns the distance of each sensor [m]; minus infinity if too near, infinity if none is in range.
        """
        self._measure = measure
        self._line = command_decoder()
        self._text = self.is_old = False
        self.plugged_in = self._mask = (1 << SENSORS) - 1
        self._due = 0.0

    def receive(self, data: bytes, now: float) -> bytes:
        """The answer to these bytes."""
        said = self.advance(now)
        return said + b"".join(self.obey(command) for command in self._line.receive(data))

    def advance(self, now: float) -> bytes:
        """The frame that is due, if any."""
        if now < self._due:
            return b""
        mask = self._mask & self.plugged_in
        period = max(mask.bit_count(), 1) / RATE
        self._due = next_due(self._due, period, now)
        used = [mask >> i & 1 for i in range(SENSORS)]
        distances = [_millimetres(d) if on else NOTHING for d, on in zip(self._measure(), used, strict=True)]
        frame = Distances(tuple(distances), mask)
        return frame.encode_text() if self._text else frame.encode()

    def obey(self, command: HubCommand) -> bytes:
        """Do what a command says; returns the bytes of its answer."""
        done = not self.is_old
        if self.is_old:
            pass
        elif command in (TEXT_MODE, BINARY_MODE):
            self._text = command == TEXT_MODE
        elif command == use_sensors(command.arguments[-1]):
            self._mask = command.arguments[-1]
        else:
            done = False
        return Acknowledgement(command.code, done).encode()


def _millimetres(distance: float) -> int:
    """A distance [m] as the hub sends it."""
    millimetres = 1000.0 * max(distance, 0.0)
    return NOTHING if millimetres > MAX_DISTANCE else round(millimetres)
