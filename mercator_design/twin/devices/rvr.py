"""The twin's Sphero RVR: bytes of commands in, bytes of responses, notifications and streams out.

It falls asleep after five minutes without a command, and then refuses all but waking; its versions and names are made
up. Sources: docs/reference/robot-protocols.md; where these are silent, docs/reference/twin.md has the assumptions.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from mercator_design.robot.protocols.rvr import Flags, RvrCommand, RvrEnd, Unknown
from mercator_design.robot.protocols.rvr_messages import COMMANDS, Error, Processor
from mercator_design.robot.protocols.rvr_streaming import sizes_in
from mercator_design.twin.devices.drive import TwinDrive
from mercator_design.twin.devices.senses import Measure, TwinSenses

WAKES = 2.0
"""[s] that waking takes."""
SLEEPS = 300.0
"""[s] after the last command that keeps the robot awake."""
_WARNING = 10.0  # [s] before it sleeps

_GOOD, _LOW, _CRITICAL = 1, 2, 3  # states of the battery
_THRESHOLDS = {"critical_threshold": 6.5, "low_threshold": 7.0, "hysteresis": 0.1}  # [V]
_EMPTY, _FULL = 6.4, 8.2  # [V]
_ECHO = 16  # bytes at most
_THERMOMETERS = 4, 5, 8  # numbers of those of the left motor, the right motor, the Nordic
_TEMPERATURE = 30.0  # [degrees Celsius] usual
_HOT, _TOO_HOT = 60.0, 70.0  # [degrees Celsius] of a motor; nowhere documented
_CURRENT = 0.35  # [A] of a motor that turns
_VERSIONS = {Processor.NORDIC: (9, 1, 462), Processor.ST: (9, 2, 482)}
_MADE_UP: Mapping[str, Mapping[str, Any]] = {
    "get_board_revision": {"revision": 3},
    "get_stats_id": {"stats_id": 513},
    "get_sku": {"sku": "RV01ROW"},
    "get_bootloader_version": {"major": 1, "minor": 2, "revision": 3},
    "get_battery_voltage_state_thresholds": _THRESHOLDS,
}
_ACCEPTED = {
    # Their notifications never occur here.
    "enable_gyro_max_notify",
    "enable_robot_infrared_message_notify",
    "set_locator_flags",
    # Slots are kept by the line.
    "configure_streaming_service",
}
_SLOT_COMMANDS = {"configure_streaming_service", "clear_streaming_service"}
_LEDS = 31  # the last is the white one


class Refused(NamedTuple):
    """Commands that the robot does not obey."""

    command: str
    service: str | None  # only configurations of slots with this service; None: all
    error: int | None  # with which it refuses them; None: it does not answer

    def matches(self, command: RvrCommand) -> bool:
        """Whether a command is one of them."""
        if command.name != self.command:
            return False
        return self.service is None or self.service in sizes_in(bytes(command.values.get("configuration", b"")))


class TwinRvr:
    """The robot. It is awake when it is switched on.

    leds: Brightness of each LED, by its bit.
    level: Charge of the battery [%].
    drive: Its drive.
    senses: Its senses.
    refused: Commands that it does not obey.
    locks_slots: Whether it refuses to change slots while it streams, which then only `stop_streaming_service` ends.
    """

    def __init__(self, measure: Measure, *, tread_distance: float, number: int = 0) -> None:
        """Switch a robot on.

        Args:
            measure: Returns the measurement of a device.
            tread_distance: Distance between the treads [m].
            number: Number of the robot, for its names.
        """
        self.leds = bytearray(_LEDS)
        self.level = 100.0
        self._line = RvrEnd()
        self.senses = TwinSenses(measure, self._line)
        self.drive = TwinDrive(tread_distance, self.senses.place, self._notify)
        self._number = number
        self._began = self._active = self._now = 0.0
        self._awake = 0.0  # from when on
        self._warned = False
        self._battery_state = _GOOD
        self._notifies = dict.fromkeys(
            ("battery_voltage_state_change", "motor_fault", "motor_stall", "motor_thermal_protection_status"), False
        )
        self.refused: tuple[Refused, ...] = ()
        self.locks_slots = False
        self._temperatures = [_TEMPERATURE] * 2  # of the motors
        self._is_fault = False  # of a motor
        self._said: list[bytes] = []
        parts = (self, self.senses, self.drive)
        self._obeyed_by = {name: part for part in parts for name in COMMANDS if hasattr(part, name)}

    @property
    def is_awake(self) -> bool:
        """Whether it obeys commands."""
        return self._now >= self._awake

    def receive(self, data: bytes, now: float) -> bytes:
        """The answer to these bytes."""
        said = self.advance(now)
        return said + b"".join(self.obey(event) for event in self._line.receive(data))

    def advance(self, now: float) -> bytes:
        """The bytes that the robot sends by itself up to now."""
        was_awake = self.is_awake
        self._now = self.senses.now = self.drive.now = now
        if self.is_awake and not was_awake:
            self._notify("did_wake")
            self._active = now
        if self.is_awake and now >= self._active + SLEEPS:
            self.sleep()
        elif self.is_awake and now >= self._active + SLEEPS - _WARNING and not self._warned:
            self._warned = True
            self._notify("will_sleep")
        self.drive.advance()
        self._said.append(self.senses.advance())
        self._watch_battery()
        return self._take_said()

    def hang_up(self, now: float) -> None:
        """Note that the port was closed."""
        self._now = self.drive.now = now
        self.drive.end_position_drive()

    def heat(self, temperatures: Mapping[int, float]) -> None:
        """Set the temperatures of motors (0 left, 1 right) [degrees Celsius]; others have the usual one."""
        before = self.get_motor_thermal_protection_status()
        self._temperatures = [temperatures.get(motor, _TEMPERATURE) for motor in (0, 1)]
        status = self.get_motor_thermal_protection_status()
        if status != before:
            self._notify("motor_thermal_protection_status", **status)
        self.drive.cut = frozenset(motor for motor in (0, 1) if self._temperatures[motor] >= _TOO_HOT)

    def set_motor_fault(self, *, is_fault: bool) -> None:
        """Set whether a motor has a fault."""
        if is_fault != self._is_fault:
            self._is_fault = is_fault
            self._notify("motor_fault", is_fault=is_fault)

    def obey(self, event: RvrCommand | Unknown) -> bytes:
        """Do what a command says; returns the bytes of its answer."""
        frame = event.frame
        if Flags.ACTIVITY in frame.flags:
            self._active, self._warned = self._now, False
        refused = [] if isinstance(event, Unknown) else [each.error for each in self.refused if each.matches(event)]
        if None in refused:
            return b""
        answer = event.error if isinstance(event, Unknown) else refused[0] if refused else self._result(event)
        if isinstance(answer, int):
            return self._line.answer(frame, answer)
        return self._line.answer(frame, **(answer or {})) + self._take_said()

    def _result(self, command: RvrCommand) -> Mapping[str, Any] | Error | None:
        message = COMMANDS[command.name]
        if not self.is_awake and message.returns is None and command.name != "wake":
            return Error.RESTRICTED
        if not all(math.isfinite(value) for value in command.values.values() if isinstance(value, float)):
            return Error.BAD_DATA_VALUE
        if self.locks_slots and command.name in _SLOT_COMMANDS and self.senses.is_streaming(command.processor):
            return Error.RESTRICTED
        if not self._line.follow(command):
            return Error.BAD_DATA_VALUE
        if command.name in _MADE_UP:
            return _MADE_UP[command.name]
        if command.name in _ACCEPTED:
            return None
        self.drive.command = command.name
        obey: Callable[..., Mapping[str, Any] | Error | None] = getattr(self._obeyed_by[command.name], command.name)
        if len(message.processors) > 1:
            return obey(command.processor, **command.values)
        return obey(**command.values)

    def _notify(self, name: str, **values: Any) -> None:  # noqa: ANN401 - what the notification carries
        if self._notifies.get(name, True):
            self._said.append(self._line.notify(name, **values))

    def _take_said(self) -> bytes:
        said = b"".join(self._said)
        self._said.clear()
        return said

    def _volts(self) -> float:
        return _EMPTY + (_FULL - _EMPTY) * self.level / 100

    def _watch_battery(self) -> None:
        volts = self._volts()
        rising = _THRESHOLDS["hysteresis"]
        critical = _THRESHOLDS["critical_threshold"] + rising * (self._battery_state == _CRITICAL)
        low = _THRESHOLDS["low_threshold"] + rising * (self._battery_state != _GOOD)
        state = _CRITICAL if volts < critical else _LOW if volts < low else _GOOD
        if state != self._battery_state:
            self._battery_state = state
            self._notify("battery_voltage_state_change", state=state)

    def echo(self, _: Processor, data: bytes) -> Mapping[str, Any] | Error:
        return {"data": data} if len(data) <= _ECHO else Error.BAD_DATA_LENGTH

    def generate_api_error(self, _: Processor, error: int) -> Error | None:
        return Error(error) if error in set(Error) else Error.BAD_DATA_VALUE

    def get_main_application_version(self, processor: Processor) -> Mapping[str, Any]:
        return dict(zip(("major", "minor", "revision"), _VERSIONS[processor], strict=True))

    def get_processor_name(self, processor: Processor) -> Mapping[str, Any]:
        return {"name": "Nordic" if processor == Processor.NORDIC else "ST"}

    def get_mac_address(self) -> Mapping[str, Any]:
        return {"mac_address": f"D0:12:34:56:78:{self._number % 256:02X}"}

    def get_bluetooth_advertising_name(self) -> Mapping[str, Any]:
        return {"name": f"RV-{self._number:04X}"}

    def get_core_up_time_in_milliseconds(self) -> Mapping[str, Any]:
        return {"up_time": round(1000 * (self._now - self._began))}

    def sleep(self) -> None:
        self.drive.halt("sleep")
        self.senses.end()
        self._awake = math.inf
        self._notify("did_sleep")

    def wake(self) -> None:
        self._awake = min(self._awake, self._now + WAKES)

    def get_battery_percentage(self) -> Mapping[str, Any]:
        return {"percentage": round(self.level)}

    def get_battery_voltage_state(self) -> Mapping[str, Any]:
        return {"state": self._battery_state}

    def get_battery_voltage_in_volts(self, reading_type: int) -> Mapping[str, Any] | Error:
        return {"voltage": self._volts()} if reading_type <= 2 else Error.BAD_DATA_VALUE

    def get_current_sense_amplifier_current(self, amplifier_id: int) -> Mapping[str, Any] | Error:
        if amplifier_id > 1:
            return Error.BAD_DATA_VALUE
        return {"amplifier_current": _CURRENT if self.drive.treads[amplifier_id] else 0.0}

    def enable_battery_voltage_state_change_notify(self, is_enabled: bool) -> None:
        self._notifies["battery_voltage_state_change"] = is_enabled

    def enable_motor_fault_notify(self, is_enabled: bool) -> None:
        self._notifies["motor_fault"] = is_enabled

    def enable_motor_stall_notify(self, is_enabled: bool) -> None:
        """Notify from now on; motors that are stuck already are reported at once."""
        self._notifies["motor_stall"] = is_enabled
        for motor in sorted(self.drive.stalled):
            self._notify("motor_stall", motor_index=motor, is_triggered=True)

    def enable_motor_thermal_protection_status_notify(self, is_enabled: bool) -> None:
        self._notifies["motor_thermal_protection_status"] = is_enabled

    def get_motor_thermal_protection_status(self) -> Mapping[str, Any]:
        values: dict[str, Any] = {}
        for side, temperature in zip(("left", "right"), self._temperatures, strict=True):
            values[f"{side}_motor_temperature"] = temperature
            values[f"{side}_motor_status"] = (temperature >= _HOT) + (temperature >= _TOO_HOT)
        return values

    def get_motor_fault_state(self) -> Mapping[str, Any]:
        return {"is_fault": self._is_fault}

    def get_temperature(self, id0: int, id1: int) -> Mapping[str, Any] | Error:
        found = dict(zip(_THERMOMETERS, (*self._temperatures, _TEMPERATURE), strict=True))
        if not {id0, id1} <= found.keys():
            return Error.BAD_DATA_VALUE
        return {"id0": id0, "temp0": found[id0], "id1": id1, "temp1": found[id1]}

    def disable_notifications_and_active_commands(self) -> None:
        self._notifies = dict.fromkeys(self._notifies, False)
        if not self.locks_slots:
            self.senses.end()
        self.drive.drive_stop()

    def set_all_leds(self, led_group: int, led_brightness_values: bytes) -> Error | None:
        if led_group >> _LEDS:
            return Error.BAD_DATA_VALUE
        for bit, level in zip((b for b in range(_LEDS) if led_group >> b & 1), led_brightness_values, strict=True):
            self.leds[bit] = level
        return None

    def release_led_requests(self) -> None:
        self.leds[:] = bytes(_LEDS)
