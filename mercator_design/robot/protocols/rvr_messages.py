"""The messages of the Sphero RVR and its computer: each once, for both directions and both ends.

Messages and their values have the names of the maker's documentation (sdk.sphero.com). Speeds are in m/s, angles in
degrees to the left, and temperatures in degrees Celsius, unless a row says otherwise; normalised values go from -127 to
127.
"""

import math
import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, TypeAlias

from mercator_design.errors import ProtocolError

Value: TypeAlias = float | str | bytes | Sequence[int]
Values: TypeAlias = Mapping[str, Any]
"""The values of a message by name: numbers, bools, a string, or bytes."""

_CODES = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "i8": "b", "i16": "h", "i32": "i", "f32": "f", "bool": "?"}


class Processor(IntEnum):
    """The two processors of the robot: sources and targets of messages."""

    NORDIC = 1
    ST = 2


class Error(IntEnum):
    """Why a command failed ("Details on the Sphero API", error codes). Firmware may send other numbers."""

    SUCCESS = 0x00
    BAD_DEVICE = 0x01
    BAD_COMMAND = 0x02
    NOT_YET_IMPLEMENTED = 0x03
    RESTRICTED = 0x04
    BAD_DATA_LENGTH = 0x05
    FAILED = 0x06
    BAD_DATA_VALUE = 0x07
    BUSY = 0x08
    BAD_TARGET = 0x09
    TARGET_UNAVAILABLE = 0x0A


DAMAGED = frozenset({Error.BAD_DATA_LENGTH, Error.BAD_DATA_VALUE})
"""Errors of commands that were damaged on their way with a right checksum: no command is sent with such data."""


class MessageLayout:
    """The values of a message in their order on the wire, big-endian, from a text like "u8 speed, u16 heading".

    Kinds: u8 u16 u32 u64 i8 i16 i32 f32 bool; the last may be `text` (ends in a zero byte), `bytes` (the rest), or
    `levels` (a byte for each bit that is set in the value before).
    """

    def __init__(self, message: str, text: str) -> None:
        self._message = message
        self._kinds = {name: kind for kind, name in (part.split() for part in text.split(",") if part)}
        self._head = struct.Struct(">" + "".join(_CODES.get(kind, "") for kind in self._kinds.values()))

    def pack(self, values: Values) -> bytes:
        """The values as bytes.

        Raises:
            ProtocolError: naming the values that are missing, unknown or cannot be sent, such as a speed of NaN.
        """
        if values.keys() != self._kinds.keys():
            expected, found = (", ".join(names) or "no values" for names in (self._kinds, values))
            raise ProtocolError(f"{self._message}: expected {expected}, found {found}")
        return b"".join(self._pack(name, kind, values) for name, kind in self._kinds.items())

    def _pack(self, name: str, kind: str, values: Values) -> bytes:
        value = values[name]
        try:
            if kind == "text":
                return bytes(value, "ascii") + b"\0"
            if kind in _CODES:
                if math.isfinite(value) and (kind != "bool" or value in (0, 1)):
                    return struct.pack(f">{_CODES[kind]}", value)
            elif len(value) == (_lit(values) if kind == "levels" else len(value)):
                return bytes([*value])
        except (struct.error, OverflowError, TypeError, ValueError):
            pass
        raise ProtocolError(f"{self._message}: {name}: expected {kind}, found {value!r:.60}")

    def unpack(self, data: bytes) -> dict[str, Any] | None:
        """The values in these bytes; None if there are too few. Bytes that newer firmware adds behind are ignored."""
        if len(data) < self._head.size:
            return None
        numbers, rest = self._head.unpack_from(data), data[self._head.size :]
        values: dict[str, Any] = dict(zip(self._kinds, numbers, strict=False))
        for name, kind in list(self._kinds.items())[len(numbers) :]:
            if kind == "text":
                values[name] = rest.partition(b"\0")[0].decode("ascii", "replace")
            else:
                size = _lit(values) if kind == "levels" else len(rest)
                if len(rest) < size:
                    return None
                values[name] = rest[:size]
        return values


def _lit(values: Values) -> int:
    """The number of bits that are set in the first value."""
    mask: int = next(iter(values.values()))
    return mask.bit_count()


@dataclass(frozen=True, slots=True)
class Message:
    """A command with its response, or a notification."""

    name: str  # the maker's
    did: int  # number of the device: a group of messages
    cid: int  # number of the message in its device
    processors: tuple[Processor, ...]  # that take the command or send the notification; the first is the usual one
    carries: MessageLayout  # values of the command or notification
    returns: MessageLayout | None = None  # values of a successful response; None if it has none


_COMMANDS = """
10 00 both    echo(bytes data) -> bytes data
10 09 both    generate_api_error(u8 error)
11 00 both    get_main_application_version() -> u16 major, u16 minor, u16 revision
11 01 both    get_bootloader_version() -> u16 major, u16 minor, u16 revision
11 03 nordic  get_board_revision() -> u8 revision
11 06 nordic  get_mac_address() -> text mac_address
11 13 nordic  get_stats_id() -> u16 stats_id
11 1f both    get_processor_name() -> text name
11 38 nordic  get_sku() -> text sku
11 39 nordic  get_core_up_time_in_milliseconds() -> u64 up_time
13 01 nordic  sleep()
13 0d nordic  wake()                                                   # takes two seconds
13 10 nordic  get_battery_percentage() -> u8 percentage
13 17 nordic  get_battery_voltage_state() -> u8 state                  # 0 unknown, 1 good, 2 low, 3 critical
13 1b nordic  enable_battery_voltage_state_change_notify(bool is_enabled)
13 25 nordic  get_battery_voltage_in_volts(u8 reading_type) -> f32 voltage   # 0 filtered, 2 raw
13 26 nordic  get_battery_voltage_state_thresholds() -> f32 critical_threshold, f32 low_threshold, f32 hysteresis
13 27 nordic  get_current_sense_amplifier_current(u8 amplifier_id) -> f32 amplifier_current   # A; 0 left, 1 right motor
16 01 st      raw_motors(u8 left_mode, u8 left_duty_cycle, u8 right_mode, u8 right_duty_cycle)   # 1 on, 2 back
16 06 st      reset_yaw()
16 07 st      drive_with_heading(u8 speed, u16 heading, u8 flags)      # 0 to 359, clockwise; 1 reverse, 2 boost, 4 fast
16 0e st      set_default_control_system_for_type(u8 control_system_type, u8 controller_id)
16 22 st      set_custom_control_system_timeout(u16 command_timeout)   # ms; 2000 at start
16 25 st      enable_motor_stall_notify(bool is_enabled)
16 27 st      enable_motor_fault_notify(bool is_enabled)
16 29 st      get_motor_fault_state() -> bool is_fault
16 32 st      drive_tank_si_units(f32 left_velocity, f32 right_velocity)   # the robot clamps to -2 to 2
16 33 st      drive_tank_normalized(i8 left_velocity, i8 right_velocity)
16 34 st      drive_rc_si_units(f32 yaw_angular_velocity, f32 linear_velocity, u8 flags)   # 1 limits the acceleration
16 35 st      drive_rc_normalized(i8 yaw_angular_velocity, i8 linear_velocity, u8 flags)
16 36 st      drive_with_yaw_si(f32 yaw_angle, f32 linear_velocity)
16 37 st      drive_with_yaw_normalized(i16 yaw_angle, i8 linear_velocity)
16 38 st      drive_to_position_si(f32 yaw_angle, f32 x, f32 y, f32 linear_speed, u8 flags)   # 1 back, 2 any
16 39 st      drive_to_position_normalized(i16 yaw_angle, f32 x, f32 y, i8 linear_speed, u8 flags)
16 3c st      set_drive_target_slew_parameters(\
f32 a, f32 b, f32 c, f32 linear_acceleration, u8 linear_velocity_slew_method)
16 3d st      get_drive_target_slew_parameters() -> \
f32 a, f32 b, f32 c, f32 linear_acceleration, u8 linear_velocity_slew_method
16 3e st      drive_stop_custom_decel(f32 deceleration_rate)           # m/s2
16 40 st      restore_default_drive_target_slew_parameters()
16 41 st      get_stop_controller_state() -> bool stopped
16 42 st      drive_stop()                                             # brakes at 2 m/s2
16 43 st      restore_default_control_system_timeout()
16 44 st      get_active_control_system_id() -> u8 controller_id
16 45 st      restore_initial_default_control_systems()
16 46 st      get_default_control_system_for_type(u8 control_system_type) -> u8 controller_id
18 0f st      enable_gyro_max_notify(bool is_enabled)
18 13 st      reset_locator_x_and_y()
18 17 st      set_locator_flags(u8 flags)
18 23 nordic  get_rgbc_sensor_values() -> u16 red, u16 green, u16 blue, u16 clear
18 25 st      magnetometer_calibrate_to_north()                        # magnetometer_calibration_complete follows
18 30 nordic  get_ambient_light_sensor_value() -> f32 ambient_light_value
18 35 nordic  enable_color_detection_notify(bool is_enabled, u16 interval, u8 minimum_confidence_threshold)   # ms
18 37 nordic  get_current_detected_color_reading()                     # color_detection follows
18 38 nordic  enable_color_detection(bool is_enabled)                  # the lamp below: without it no colour is right
18 39 both    configure_streaming_service(u8 token, bytes configuration)
18 3a both    start_streaming_service(u16 period)                      # ms
18 3b both    stop_streaming_service()
18 3c both    clear_streaming_service()
18 3e st      enable_robot_infrared_message_notify(bool is_enabled)
18 4a st      get_temperature(u8 id0, u8 id1) -> u8 id0, f32 temp0, u8 id1, f32 temp1   # 4 left, 5 right motor
18 4b st      get_motor_thermal_protection_status() -> \
f32 left_motor_temperature, u8 left_motor_status, f32 right_motor_temperature, u8 right_motor_status
18 4c st      enable_motor_thermal_protection_status_notify(bool is_enabled)
18 52 st      get_magnetometer_reading() -> f32 x_axis, f32 y_axis, f32 z_axis
18 53 st      get_encoder_counts() -> i32 left, i32 right
18 54 nordic  disable_notifications_and_active_commands()
19 05 nordic  get_bluetooth_advertising_name() -> text name
1a 1a nordic  set_all_leds(u32 led_group, levels led_brightness_values)
1a 4e nordic  release_led_requests()
"""

_NOTIFICATIONS = """
13 11 nordic  did_wake()                                               # not in the maker's documents; robots send it
13 19 nordic  will_sleep()                                             # in ten seconds
13 1a nordic  did_sleep()
13 1c nordic  battery_voltage_state_change(u8 state)                   # 0 unknown, 1 good, 2 low, 3 critical
16 26 st      motor_stall(u8 motor_index, bool is_triggered)           # 0 left, 1 right
16 28 st      motor_fault(bool is_fault)
16 3a st      xy_position_drive_result(bool success)
16 3f st      robot_has_stopped()
18 10 st      gyro_max(u8 flags)                                       # bits +x, -x, +y, -y, +z, -z
18 2c st      robot_to_robot_infrared_message_received(u8 infrared_code)
18 36 nordic  color_detection(u8 red, u8 green, u8 blue, u8 confidence, u8 color_classification_id)   # class 255: none
18 3d both    streaming_service_data(u8 token, bytes sensor_data)      # see rvr_streaming.py
18 4d st      motor_thermal_protection_status(\
f32 left_motor_temperature, u8 left_motor_status, f32 right_motor_temperature, u8 right_motor_status)   # 2 critical
18 51 st      magnetometer_calibration_complete(bool is_successful, i16 yaw_north_direction)
"""

_ROW = re.compile(r"^(\w\w) (\w\w) (nordic|st|both) +(\w+)\((.*?)\)(?: -> ([\w, ]+))?(?: +#.*)?$", re.MULTILINE)
_PROCESSORS = {"nordic": (Processor.NORDIC,), "st": (Processor.ST,), "both": (Processor.NORDIC, Processor.ST)}


def _messages(table: str) -> dict[str, Message]:
    return {
        name: Message(
            name,
            int(did, 16),
            int(cid, 16),
            _PROCESSORS[who],
            MessageLayout(name, carries),
            MessageLayout(name, returns) if returns else None,
        )
        for did, cid, who, name, carries, returns in _ROW.findall(table)
    }


COMMANDS = _messages(_COMMANDS)
NOTIFICATIONS = _messages(_NOTIFICATIONS)

LIGHTS = {
    "headlight_right": 0,
    "headlight_left": 3,
    "status_indication_left": 6,
    "status_indication_right": 9,
    "battery_door_rear": 12,
    "battery_door_front": 15,
    "power_button_front": 18,
    "power_button_rear": 21,
    "brakelight_left": 24,
    "brakelight_right": 27,
}
"""The first of the three bits (red, green, blue) of each light in a group of LEDs; bit 30 is the white one below."""


def lights(colours: Mapping[str, tuple[int, int, int]]) -> dict[str, Any]:
    """The values of one `set_all_leds` that sets the colours of some `LIGHTS`, 0 to 255 a channel."""
    in_order = sorted((LIGHTS[name], colour) for name, colour in colours.items())
    return {
        "led_group": sum(0b111 << bit for bit, _ in in_order),
        "led_brightness_values": [level for _, colour in in_order for level in colour],
    }
