"""Sensor streaming of the Sphero RVR: slots of services, which the robot sends once a period.

What a robot sends of a slot are unsigned integers in the order of the slot's configuration, which alone tells what they
are; so both ends follow the commands in `Slots` (SDK for Raspberry Pi 1.0.0).
"""

import struct
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from mercator_design.errors import ProtocolError
from mercator_design.robot.protocols.rvr_messages import Processor

MIN_PERIOD = 33
"""Of streaming [ms]; the SDK asks for no less."""
SLOT_SIZE = 5
"""Services in a slot at most."""
_SLOTS = range(1, 5)
_INVALID = 0x10  # in a token; its low four bits are the slot
_ENTRY = struct.Struct(">HB")  # of a configuration: service, size

Attribute: TypeAlias = tuple[float, float] | range
"""What the least and the greatest integer stand for; or the values of a count, negative ones in two's complement."""


@dataclass(frozen=True, slots=True)
class Service:
    """What processors can stream.

    slot: Where the SDK puts it.
    size: Bytes of each of its integers, as the SDK asks for them; it might ask for 1, 2 or 4.
    """

    id: int
    processors: tuple[Processor, ...]
    slot: int
    size: int
    attributes: Mapping[str, Attribute]

    @property
    def entry(self) -> bytes:
        """What asks for it in a configuration."""
        return _ENTRY.pack(self.id, self.size.bit_length() - 1)


_NORDIC, _ST, _BOTH = (Processor.NORDIC,), (Processor.ST,), (Processor.NORDIC, Processor.ST)
_CHANNEL, _HALF, _TICKS = range(256), range(2**32), range(-(2**31), 2**31)
_IMU: dict[str, Attribute] = {"pitch": (-180.0, 180.0), "roll": (-90.0, 90.0), "yaw": (-180.0, 180.0)}
_COLOR: dict[str, Attribute] = {
    "r": _CHANNEL,
    "g": _CHANNEL,
    "b": _CHANNEL,
    "index": _CHANNEL,
    "confidence": (0.0, 1.0),
}
SERVICES = {
    "quaternion": Service(0x0, _ST, 1, 4, dict.fromkeys("wxyz", (-1.0, 1.0))),
    "imu": Service(0x1, _ST, 1, 4, _IMU),  # degrees
    "accelerometer": Service(0x2, _ST, 1, 4, dict.fromkeys("xyz", (-16.0, 16.0))),  # g
    "color_detection": Service(0x3, _NORDIC, 1, 1, _COLOR),
    "gyroscope": Service(0x4, _ST, 1, 4, dict.fromkeys("xyz", (-2000.0, 2000.0))),  # degrees/s
    "locator": Service(0x6, _ST, 2, 4, dict.fromkeys("xy", (-16000.0, 16000.0))),  # m
    "velocity": Service(0x7, _ST, 2, 4, dict.fromkeys("xy", (-5.0, 5.0))),  # m/s
    "speed": Service(0x8, _ST, 2, 4, {"speed": (0.0, 5.0)}),  # m/s
    "core_time": Service(0x9, _BOTH, 3, 4, {"upper": _HALF, "lower": _HALF}),
    "ambient_light": Service(0xA, _NORDIC, 2, 4, {"light": (0.0, 120000.0)}),  # lux
    "encoders": Service(0xB, _ST, 2, 4, {"left": _TICKS, "right": _TICKS}),
}
"""By name. Axes: x to the right, y forwards, z up; yaw is 0 forwards and positive to the left."""
_BY_ID = {service.id: name for name, service in SERVICES.items()}
_SIZES = (1, 2, 4)


@dataclass(frozen=True, slots=True)
class StreamData:
    """What a processor's slot measured.

    is_valid: Whether the robot says that the values are good.
    values: By service and attribute.
    """

    processor: Processor
    slot: int
    is_valid: bool
    values: Mapping[str, Mapping[str, float]]


def streaming(services: Iterable[str], period: int) -> Iterator[tuple[str, Processor, dict[str, Any]]]:
    """The commands that start the streaming of services every `period` ms: name, target, values; slots as in the SDK.

    Raises:
        ProtocolError: if there is no such service, a slot would be too full, or the period too short.
    """
    services = list(services)
    if unknown := [name for name in services if name not in SERVICES]:
        raise ProtocolError(f"expected services among {', '.join(SERVICES)}, found {', '.join(unknown)}")
    if period < MIN_PERIOD:
        raise ProtocolError(f"period: expected at least {MIN_PERIOD} ms, found {period}")
    for processor in Processor:
        for slot in _SLOTS:
            entries = [
                service.entry
                for service in map(SERVICES.__getitem__, services)
                if service.slot == slot and processor in service.processors
            ]
            if len(entries) > SLOT_SIZE:
                raise ProtocolError(f"slot {slot}: expected at most {SLOT_SIZE} services, found {len(entries)}")
            if entries:
                yield "configure_streaming_service", processor, {"token": slot, "configuration": b"".join(entries)}
    for processor in Processor:
        yield "start_streaming_service", processor, {"period": period}


class Slots:
    """What the slots of a robot hold, from the commands that go by."""

    def __init__(self) -> None:
        self._sizes: dict[tuple[Processor, int], dict[str, int]] = {}  # of each service in a slot

    def follow(self, command: str, processor: Processor, values: Mapping[str, Any]) -> bool:
        """Whether the command can be obeyed, which most need nothing for."""
        if command == "clear_streaming_service":
            self._sizes = {slot: sizes for slot, sizes in self._sizes.items() if slot[0] != processor}
        elif command == "configure_streaming_service":
            sizes = _sizes(bytes(values["configuration"]))
            here = all(processor in SERVICES[name].processors for name in sizes)
            if values["token"] not in _SLOTS or not 0 < len(sizes) <= SLOT_SIZE or not here:
                return False
            self._sizes[processor, values["token"]] = sizes
        return True

    def of(self, processor: Processor) -> dict[int, tuple[str, ...]]:
        """The services of each slot that is configured."""
        return {slot: tuple(sizes) for (of, slot), sizes in self._sizes.items() if of == processor}

    def read(self, processor: Processor, token: int, data: bytes) -> StreamData | None:
        """What a slot measured; None if nobody knows what is in it, or it cannot be that for its length."""
        slot = token & ~_INVALID
        sizes = self._sizes.get((processor, slot))
        if sizes is None or len(data) != sum(size * len(SERVICES[name].attributes) for name, size in sizes.items()):
            return None
        values: dict[str, dict[str, float]] = {}
        for name, size in sizes.items():
            values[name] = {}
            for attribute, meaning in SERVICES[name].attributes.items():
                values[name][attribute] = _value(int.from_bytes(data[:size], "big"), size, meaning)
                data = data[size:]
        return StreamData(processor, slot, not token & _INVALID, values)

    def write(self, data: StreamData) -> dict[str, Any]:
        """The values of the notification that says it; of a scaled value the nearest integer, within its range.

        Raises:
            KeyError: if the slot is not configured, or a value of it is missing.
        """
        integers = [
            _integer(data.values[name][attribute], size, meaning).to_bytes(size, "big")
            for name, size in self._sizes[data.processor, data.slot].items()
            for attribute, meaning in SERVICES[name].attributes.items()
        ]
        return {"token": data.slot | (0 if data.is_valid else _INVALID), "sensor_data": b"".join(integers)}


def _sizes(configuration: bytes) -> dict[str, int]:
    """Bytes of the integers of each service in a configuration; nothing if there is anything else in it."""
    entries = [configuration[i : i + _ENTRY.size] for i in range(0, len(configuration), _ENTRY.size)]
    asked = [_ENTRY.unpack(entry) for entry in entries if len(entry) == _ENTRY.size]
    sizes = {_BY_ID[service]: _SIZES[code] for service, code in asked if service in _BY_ID and code < len(_SIZES)}
    return sizes if len(sizes) == len(entries) else {}


def _value(integer: int, size: int, meaning: Attribute) -> float:
    most = (1 << 8 * size) - 1
    if isinstance(meaning, range):
        count = integer * (len(meaning) - 1) // most
        return count if count < meaning.stop else count - len(meaning)
    low, high = meaning
    return low + integer / most * (high - low)


def _integer(value: float, size: int, meaning: Attribute) -> int:
    most = (1 << 8 * size) - 1
    if isinstance(meaning, range):
        return -(-(int(value) % len(meaning)) * most // (len(meaning) - 1))  # the least that stands for it
    low, high = meaning
    return round((min(max(value, low), high) - low) / (high - low) * most)
