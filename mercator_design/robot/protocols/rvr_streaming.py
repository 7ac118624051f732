"""Sensor streaming of the Sphero RVR: slots of services, which the robot sends once a period.

The robot sends the values of a slot as unsigned integers in the order of the slot's configuration, without their names.
So both ends keep the configurations in `Slots` (SDK for Raspberry Pi 1.0.0).
"""

import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from mercator_design.errors import ProtocolError
from mercator_design.robot.protocols.rvr_messages import Processor

MIN_PERIOD = 33
"""The shortest period [ms], as in the SDK."""
MAX_SERVICES = 5  # in a slot
_SLOTS = range(1, 5)
_INVALID = 0x10  # in a token; its low four bits are the slot
_ENTRY = struct.Struct(">HB")  # of a configuration: service, size

Attribute: TypeAlias = tuple[float, float] | range
"""The values of the smallest and the largest integer; or the range of a count, which is in two's complement."""


@dataclass(frozen=True, slots=True)
class StreamingService:
    """A service that processors can stream."""

    id: int
    processors: tuple[Processor, ...]
    slot: int  # as in the SDK
    size: int  # bytes of each of its integers, as in the SDK; 1, 2 or 4
    attributes: Mapping[str, Attribute]


_NORDIC, _ST, _BOTH = (Processor.NORDIC,), (Processor.ST,), (Processor.NORDIC, Processor.ST)
_CHANNEL, _HALF, _TICKS = range(256), range(2**32), range(-(2**31), 2**31)
_IMU: dict[str, Attribute] = {"pitch": (-180.0, 180.0), "roll": (-90.0, 90.0), "yaw": (-180.0, 180.0)}
_COLOR: dict[str, Attribute] = {**dict.fromkeys(("r", "g", "b", "index"), _CHANNEL), "confidence": (0.0, 1.0)}
SERVICES = {
    "quaternion": StreamingService(0x0, _ST, 1, 4, dict.fromkeys("wxyz", (-1.0, 1.0))),
    "imu": StreamingService(0x1, _ST, 1, 4, _IMU),  # degrees
    "accelerometer": StreamingService(0x2, _ST, 1, 4, dict.fromkeys("xyz", (-16.0, 16.0))),  # g
    "color_detection": StreamingService(0x3, _NORDIC, 1, 1, _COLOR),
    "gyroscope": StreamingService(0x4, _ST, 1, 4, dict.fromkeys("xyz", (-2000.0, 2000.0))),  # degrees/s
    "locator": StreamingService(0x6, _ST, 2, 4, dict.fromkeys("xy", (-16000.0, 16000.0))),  # m
    "velocity": StreamingService(0x7, _ST, 2, 4, dict.fromkeys("xy", (-5.0, 5.0))),  # m/s
    "speed": StreamingService(0x8, _ST, 2, 4, {"speed": (0.0, 5.0)}),  # m/s
    "core_time": StreamingService(0x9, _BOTH, 3, 4, {"upper": _HALF, "lower": _HALF}),
    "ambient_light": StreamingService(0xA, _NORDIC, 2, 4, {"light": (0.0, 120000.0)}),  # lux
    "encoders": StreamingService(0xB, _ST, 2, 4, {"left": _TICKS, "right": _TICKS}),
}
"""Services by name. Axes: x to the right, y forwards, z up; yaw is 0 forwards and positive to the left."""
_BY_ID = {service.id: name for name, service in SERVICES.items()}
_SIZES = (1, 2, 4)


@dataclass(frozen=True, slots=True)
class StreamData:
    """The values of a processor's slot."""

    processor: Processor
    slot: int
    is_valid: bool  # whether the robot marks the values as good
    values: Mapping[str, Mapping[str, float]]  # by service and attribute


def streaming(services: Iterable[str], period: int) -> Iterator[tuple[str, Processor, dict[str, Any]]]:
    """The commands (name, target, values) that start streaming of services every `period` ms; slots as in the SDK.

    Raises:
        ProtocolError: if a service is unknown, a slot has too many services, or the period is too short.
    """
    services = list(services)
    if unknown := [name for name in services if name not in SERVICES]:
        raise ProtocolError(f"expected services among {', '.join(SERVICES)}, found {', '.join(unknown)}")
    if period < MIN_PERIOD:
        raise ProtocolError(f"period: expected at least {MIN_PERIOD} ms, found {period}")
    for processor in Processor:
        for slot, names in slots_of(processor, services).items():
            yield "configure_streaming_service", processor, configuration(slot, names)
    for processor in Processor:
        yield "start_streaming_service", processor, {"period": period}


def slots_of(processor: Processor, services: Iterable[str]) -> dict[int, list[str]]:
    """The slots of a processor for services, as in the SDK; each slot has its services in the given order."""
    slots: dict[int, list[str]] = {}
    for name in services:
        if processor in SERVICES[name].processors:
            slots.setdefault(SERVICES[name].slot, []).append(name)
    return dict(sorted(slots.items()))


def configuration(slot: int, services: Sequence[str]) -> dict[str, Any]:
    """The values of the command that configures a slot.

    Raises:
        ProtocolError: if it has too many services.
    """
    if len(services) > MAX_SERVICES:
        raise ProtocolError(f"slot {slot}: expected at most {MAX_SERVICES} services, found {len(services)}")
    entries = [_ENTRY.pack(SERVICES[name].id, _SIZES.index(SERVICES[name].size)) for name in services]
    return {"token": slot, "configuration": b"".join(entries)}


class Slots:
    """The configured slots of a robot, from the commands sent to it."""

    def __init__(self) -> None:
        self._sizes: dict[tuple[Processor, int], dict[str, int]] = {}  # of each service in a slot

    def follow(self, command: str, processor: Processor, values: Mapping[str, Any]) -> bool:
        """Take in a command; whether it is valid. Most commands have nothing to do with slots."""
        if command == "clear_streaming_service":
            self._sizes = {slot: sizes for slot, sizes in self._sizes.items() if slot[0] != processor}
        elif command == "configure_streaming_service":
            sizes = sizes_in(bytes(values["configuration"]))
            here = all(processor in SERVICES[name].processors for name in sizes)
            if values["token"] not in _SLOTS or not 0 < len(sizes) <= MAX_SERVICES or not here:
                return False
            self._sizes[processor, values["token"]] = sizes
        return True

    def of(self, processor: Processor) -> dict[int, tuple[str, ...]]:
        """The services of each configured slot of a processor."""
        return {slot: tuple(sizes) for (of, slot), sizes in self._sizes.items() if of == processor}

    def read(self, processor: Processor, token: int, data: bytes) -> StreamData | None:
        """The values of a slot; None if the slot is not configured, or the data do not have its length."""
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
        """The values of the notification with these data; a scaled value is the nearest integer within its range.

        Raises:
            KeyError: if the slot is not configured, or one of its values is missing.
        """
        integers = [
            _integer(data.values[name][attribute], size, meaning).to_bytes(size, "big")
            for name, size in self._sizes[data.processor, data.slot].items()
            for attribute, meaning in SERVICES[name].attributes.items()
        ]
        return {"token": data.slot | (0 if data.is_valid else _INVALID), "sensor_data": b"".join(integers)}


def sizes_in(configuration: bytes) -> dict[str, int]:
    """Bytes of the integers of each service in a configuration; empty if an entry is not valid."""
    entries = [configuration[i : i + _ENTRY.size] for i in range(0, len(configuration), _ENTRY.size)]
    asked = [_ENTRY.unpack(entry) for entry in entries if len(entry) == _ENTRY.size]
    sizes = {_BY_ID[service]: _SIZES[code] for service, code in asked if service in _BY_ID and code < len(_SIZES)}
    return sizes if len(sizes) == len(entries) else {}


def _value(integer: int, size: int, meaning: Attribute) -> float:
    largest = (1 << 8 * size) - 1
    if isinstance(meaning, range):
        count = integer * (len(meaning) - 1) // largest
        return count if count < meaning.stop else count - len(meaning)
    low, high = meaning
    return low + integer / largest * (high - low)


def _integer(value: float, size: int, meaning: Attribute) -> int:
    largest = (1 << 8 * size) - 1
    if isinstance(meaning, range):
        return -(-(int(value) % len(meaning)) * largest // (len(meaning) - 1))  # the smallest that stands for it
    low, high = meaning
    return round((min(max(value, low), high) - low) / (high - low) * largest)
