"""The senses of the twin's RVR: measurements, streams and notifications.

The simulator's devices measure. Their values are converted to the robot's units and axes: x to the right and y forwards
of its pose when its yaw and its locator were reset.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

from mercator_design.robot.protocols.rvr import RvrEnd
from mercator_design.robot.protocols.rvr_messages import Error, Processor
from mercator_design.robot.protocols.rvr_streaming import SERVICES, StreamData
from mercator_design.twin.devices import next_due
from mercator_design.twin.devices.drive import Place, wrapped

Measure: TypeAlias = Callable[[str], Sequence[float]]
"""The present measurement of a robot's device, by its name in `sim.devices`, with y forwards; `treads`: the distance
of each tread [m]."""

_NO_CLASS = 255  # of a colour that the robot has not learnt
_TICKS = 3000.0  # of an encoder for a metre; nowhere documented
_FIELD = 0.3, 0.4  # [gauss] of the earth, along the floor to the arena's +y, and downwards
_CALIBRATING = 3.0  # [s] of the magnetometer


class TwinSenses:
    """The senses. Public methods with the names of commands execute these; set `now` before.

    lamp_fails: Whether the lamp of the colour sensor does not come on.
    silent: Services that are not streamed, nor are the others in their slots; as in `slow` and `invalid`.
    slow: The shortest period of services [s].
    invalid: Services whose values are marked as invalid.
    """

    def __init__(self, measure: Measure, line: RvrEnd) -> None:
        """The senses of a robot that is switched on.

        Args:
            measure: Returns the measurement of a device.
            line: Its end of the serial line, with the slots of streaming.
        """
        self.now = 0.0
        self._measure, self._line = measure, line
        self._start = self._zero = self._world_yaw()
        self._from, self._base = self._world_place(), (0.0, 0.0)
        self._streams: dict[Processor, tuple[float, float]] = {}  # period, next time [s]
        self._is_lit = False  # whether a program wants the lamp
        self.lamp_fails = False
        self.silent: frozenset[str] = frozenset()
        self.slow: Mapping[str, float] = {}
        self.invalid: frozenset[str] = frozenset()
        self._next: dict[tuple[Processor, int], float] = {}  # time of slow slots [s]
        self._colours: tuple[float, float, int] | None = None  # period, next time [s], minimum confidence
        self._calibrated = math.inf

    def place(self) -> Place:
        """The robot's pose by its locator."""
        x, y = self._world_place()
        right, forwards = _turned(x - self._from[0], y - self._from[1], math.pi / 2 - self._zero)
        return wrapped(math.degrees(self._world_yaw() - self._zero)), self._base[0] + right, self._base[1] + forwards

    def advance(self) -> bytes:
        """The streams and notifications up to now."""
        said = []
        for processor, (period, due) in self._streams.items():
            if self.now >= due:
                said += [self._stream(processor, slot) for slot in sorted(self._line.slots.of(processor))]
                self._streams[processor] = period, next_due(due, period, self.now)
        if self._colours is not None and self.now >= self._colours[1]:
            period, due, min_confidence = self._colours
            red, green, blue = self._colour()
            values: dict[str, Any] = {"red": red, "green": green, "blue": blue, "confidence": 255 * self._lamp}
            if values["confidence"] >= min_confidence:
                said.append(self._line.notify("color_detection", **values, color_classification_id=_NO_CLASS))
            self._colours = period, next_due(due, period, self.now), min_confidence
        if self.now >= self._calibrated:
            north = round(wrapped(math.degrees(math.pi / 2 - self._zero)))
            said.append(
                self._line.notify("magnetometer_calibration_complete", is_successful=True, yaw_north_direction=north)
            )
            self._calibrated = math.inf
        return b"".join(said)

    def end(self) -> None:
        """End all streams and notifications of colours."""
        self._streams.clear()
        self._colours = None

    def reset_yaw(self) -> None:
        self._base, self._from, self._zero = self.place()[1:], self._world_place(), self._world_yaw()

    def reset_locator_x_and_y(self) -> None:
        self._base, self._from = (0.0, 0.0), self._world_place()

    @property
    def _lamp(self) -> bool:
        return self._is_lit and not self.lamp_fails

    def is_streaming(self, processor: Processor) -> bool:
        """Whether a processor streams."""
        return processor in self._streams

    def enable_color_detection(self, is_enabled: bool) -> None:
        self._is_lit = is_enabled

    def enable_color_detection_notify(
        self, is_enabled: bool, interval: int, minimum_confidence_threshold: int
    ) -> Error | None:
        if is_enabled and interval == 0:
            return Error.BAD_DATA_VALUE
        period = interval / 1000
        self._colours = (
            (period, next_due(self.now, period, self.now), minimum_confidence_threshold) if is_enabled else None
        )
        return None

    def get_current_detected_color_reading(self) -> None:
        self._colours = self._colours or (math.inf, self.now, 0)

    def get_rgbc_sensor_values(self) -> dict[str, Any]:
        red, green, blue = (257 * level for level in self._colour())
        return {"red": red, "green": green, "blue": blue, "clear": min(red + green + blue, 0xFFFF)}

    def get_ambient_light_sensor_value(self) -> dict[str, Any]:
        return {"ambient_light_value": self._measure("ambient_light")[0]}

    def start_streaming_service(self, processor: Processor, period: int) -> Error | None:
        if period == 0:
            return Error.BAD_DATA_VALUE
        self._streams[processor] = period / 1000, next_due(self.now, period / 1000, self.now)
        return None

    def stop_streaming_service(self, processor: Processor) -> None:
        self._streams.pop(processor, None)

    clear_streaming_service = stop_streaming_service

    def get_encoder_counts(self) -> dict[str, Any]:
        left, right = (round(_TICKS * way) for way in self._measure("treads"))
        return {"left": left, "right": right}

    def get_magnetometer_reading(self) -> dict[str, Any]:
        level, down = _FIELD
        heading = self._world_yaw()
        return {"x_axis": -level * math.cos(heading), "y_axis": level * math.sin(heading), "z_axis": -down}

    def magnetometer_calibrate_to_north(self) -> None:
        self._calibrated = self.now + _CALIBRATING

    def _world_yaw(self) -> float:
        return self._measure("imu")[2]

    def _world_place(self) -> tuple[float, float]:
        x, y = self._measure("locator")
        return x, y

    def _colour(self) -> tuple[int, int, int]:
        red, green, blue = map(round, self._measure("ground_sensors")) if self._lamp else (0, 0, 0)
        return red, green, blue

    def _stream(self, processor: Processor, slot: int) -> bytes:
        services = self._line.slots.of(processor)[slot]
        if not self.silent.isdisjoint(services) or self.now < self._next.get((processor, slot), -math.inf) - 1e-9:
            return b""
        slowest = max((self.slow.get(name, 0.0) for name in services), default=0.0)
        self._next[processor, slot] = self.now + slowest
        values = {name: dict(zip(SERVICES[name].attributes, self._service(name), strict=True)) for name in services}
        return self._line.stream(StreamData(processor, slot, self.invalid.isdisjoint(services), values))

    def _service(self, name: str) -> Sequence[float]:
        """The attributes of a streaming service, in their order."""
        match name:
            case "imu":
                pitch, roll, _ = map(math.degrees, self._measure("imu"))
                return pitch, roll, self.place()[0]
            case "gyroscope":
                return [math.degrees(turn) for turn in self._measure("gyroscope")]
            case "quaternion":
                w, x, y, z = self._measure("quaternion")  # against the start, about an axis that is upright
                w, z = _turned(w, z, 0.5 * (self._start - self._zero))
                return w, x, y, z
            case "locator":
                return self.place()[1:]
            case "velocity":
                x, y = self._measure("velocity")  # against the start
                return _turned(x, y, self._start - self._zero)
            case "speed":
                return (math.hypot(*self._measure("velocity")),)
            case "color_detection":
                return *self._colour(), _NO_CLASS, float(self._lamp)
            case "core_time":
                return divmod(round(1000 * self.now), 1 << 32)
            case "encoders":
                return [*self.get_encoder_counts().values()]
        return self._measure(name)


def _turned(x: float, y: float, angle: float) -> tuple[float, float]:
    """A vector that is turned counter-clockwise by an angle [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return c * x - s * y, s * x + c * y
