"""The drive of the twin's RVR: the speeds of its treads follow commands and the robot's position."""

import math
from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

from mercator_design.robot.protocols.rvr_messages import Error

Treads: TypeAlias = tuple[float, float]
"""Speed of the left and the right tread [m/s]."""
Place: TypeAlias = tuple[float, float, float]
"""The robot's pose in its own frame: yaw [degrees], x to the right and y forwards [m]."""

TOP = 2.0
"""[m/s] Limit of speeds, and full speed of normalised commands; the latter is nowhere documented."""
FASTEST_TURN = 624.0
"""[degrees/s]"""
TIMEOUT = 2.0
"""[s] after which a command ends, unless `set_custom_control_system_timeout` sets another time."""
BRAKING = 2.0
"""[m/s2]"""

_STOP, _RAW, _TANK, _YAW_SLEW, _YAW, _RC_RATE, _RC_SLEW, _POSITION = range(8)  # controllers
_OF_YAW, _OF_RC = 3, 4  # types of controllers
_CONTROLLERS = {
    0: (0,),
    1: (1,),
    2: (2,),
    _OF_YAW: (_YAW, _YAW_SLEW),
    _OF_RC: (_RC_RATE, _RC_SLEW),
    5: (7,),
    6: (8,),
    7: (9,),
}
"""The controllers of each type; the first one is the initial default."""
_DEFAULTS = {kind: controllers[0] for kind, controllers in _CONTROLLERS.items()}
_SLEW = {"a": -177.78, "b": 533.33, "c": 200.0, "linear_acceleration": 0.5, "linear_velocity_slew_method": 1}
_GAIN = 5.0  # of the yaw controller [1/s]
_AIMED = 5.0  # [degrees] of error in yaw below which a robot at rest starts to drive
_ARRIVED = 0.02  # [m] from the end of a position drive
_HEADING_FLAGS = 0b111111  # all of them
_AT_ONCE = 1e6  # [m/s2]
_REST: Treads = (0.0, 0.0)


class TwinDrive:
    """The drive. Public methods with the names of commands execute these; set `now` and `command` before.

    now: The time [s].
    command: The name of the command that is executed.
    target: The target speeds of the treads.
    cause: What set these: a command, or "timeout", "sleep", "port closed".
    treads: The present speeds of the treads.
    stalled: Motors that are stuck (0 left, 1 right).
    cut: Motors that have no power, whatever the target speeds are.
    """

    def __init__(self, tread_distance: float, place: Callable[[], Place], notify: Callable[..., None]) -> None:
        """A drive at rest.

        Args:
            tread_distance: [m] from tread to tread.
            place: Returns the robot's pose.
            notify: Sends a notification, of a name and values.
        """
        self.now = 0.0
        self.target = self.treads = _REST
        self.command = self.cause = "start"
        self._half = 0.5 * tread_distance
        self._place, self._notify = place, notify
        self._aim: Callable[[], Treads] = lambda: _REST
        self._controller = _STOP
        self._limit = _AT_ONCE  # of the change of speed [m/s2]
        self._deadline = math.inf
        self._timeout = TIMEOUT
        self._then = 0.0
        self._stopped = True
        self.stalled: frozenset[int] = frozenset()
        self.cut: frozenset[int] = frozenset()
        self._defaults, self._slew = dict(_DEFAULTS), dict(_SLEW)
        self._drove_to = False

    def advance(self) -> None:
        """Update the treads."""
        if self.now >= self._deadline:
            self._stop("timeout")
        self._retarget()
        change = self._limit * max(0.0, self.now - self._then)
        left, right = (
            0.0 if motor in self.stalled | self.cut else now + min(max(aim - now, -change), change)
            for motor, (aim, now) in enumerate(zip(self.target, self.treads, strict=True))
        )
        self._then, self.treads = self.now, (left, right)
        if self._drove_to:
            self._drove_to = False
            self._notify("xy_position_drive_result", success=True)
        if self._controller == _STOP and not self._stopped and self.treads == _REST:
            self._stopped = True
            self._notify("robot_has_stopped")

    def halt(self, cause: str) -> None:
        """Stop at once."""
        self._stop(cause)
        self.treads = _REST

    def end_position_drive(self) -> None:
        """Stop a drive to a position, which has no timeout, because the port was closed."""
        if self._controller == _POSITION:
            self._stop("port closed")

    def stall(self, motors: Iterable[int]) -> None:
        """Set which motors (0 left, 1 right) are stuck."""
        before, self.stalled = self.stalled, frozenset(motors)
        for motor in sorted(before ^ self.stalled):
            self._notify("motor_stall", motor_index=motor, is_triggered=motor in self.stalled)

    def _retarget(self) -> None:
        left, right = self._aim()
        self.target = min(max(left, -TOP), TOP), min(max(right, -TOP), TOP)

    def _drive(self, controller: int, aim: Callable[[], Treads]) -> None:
        self.cause, self._controller, self._aim = self.command, controller, aim
        self._limit = self._slew["linear_acceleration"] if controller in {_YAW_SLEW, _RC_SLEW} else _AT_ONCE
        self._deadline = self.now + self._timeout
        self._stopped = False
        self._retarget()

    def _stop(self, cause: str, deceleration: float = BRAKING) -> None:
        was_stopped = self._stopped
        self._drive(_STOP, lambda: _REST)
        self.cause = cause
        self._limit, self._stopped, self._deadline = deceleration, was_stopped, math.inf

    def _turning(self, speed: float, turn: float) -> Treads:
        """Treads of a speed [m/s] and a turn to the left [degrees/s]."""
        aside = math.radians(min(max(turn, -FASTEST_TURN), FASTEST_TURN)) * self._half
        speed = min(max(speed, -TOP), TOP)
        return speed - aside, speed + aside

    def _towards(self, yaw: float, speed: float) -> Callable[[], Treads]:
        """Target speeds that turn the robot to a yaw [degrees], and drive once it has turned there."""
        is_off = self.treads != _REST

        def aim() -> Treads:
            nonlocal is_off
            error = wrapped(yaw - self._place()[0])
            is_off = is_off or abs(error) < _AIMED
            return self._turning(speed if is_off else 0.0, _GAIN * error)

        return aim

    def raw_motors(self, left_mode: int, left_duty_cycle: int, right_mode: int, right_duty_cycle: int) -> Error | None:
        signs = {0: 0.0, 1: 1.0, 2: -1.0}
        if left_mode not in signs or right_mode not in signs:
            return Error.BAD_DATA_VALUE
        left, right = signs[left_mode] * left_duty_cycle / 255, signs[right_mode] * right_duty_cycle / 255
        self._drive(_RAW, lambda: (TOP * left, TOP * right))
        return None

    def drive_tank_si_units(self, left_velocity: float, right_velocity: float) -> None:
        self._drive(_TANK, lambda: (left_velocity, right_velocity))

    def drive_tank_normalized(self, left_velocity: int, right_velocity: int) -> None:
        self._drive(_TANK, lambda: (TOP * left_velocity / 127, TOP * right_velocity / 127))

    def drive_rc_si_units(self, yaw_angular_velocity: float, linear_velocity: float, flags: int) -> None:
        treads = self._turning(linear_velocity, yaw_angular_velocity)
        controller = _RC_SLEW if flags & 1 else self._defaults[_OF_RC]
        self._drive(controller, lambda: treads)

    def drive_rc_normalized(self, yaw_angular_velocity: int, linear_velocity: int, flags: int) -> None:
        self.drive_rc_si_units(FASTEST_TURN * yaw_angular_velocity / 127, TOP * linear_velocity / 127, flags)

    def drive_with_heading(self, speed: int, heading: int, flags: int) -> Error | None:
        if heading > 359 or flags > _HEADING_FLAGS:
            return Error.BAD_DATA_VALUE
        forwards = -1.0 if flags & 1 else 1.0
        self._drive(self._defaults[_OF_YAW], self._towards(-heading, forwards * TOP * speed / 255))
        return None

    def drive_with_yaw_si(self, yaw_angle: float, linear_velocity: float) -> None:
        self._drive(self._defaults[_OF_YAW], self._towards(yaw_angle, linear_velocity))

    def drive_with_yaw_normalized(self, yaw_angle: int, linear_velocity: int) -> None:
        self.drive_with_yaw_si(yaw_angle, TOP * linear_velocity / 127)

    def drive_to_position_si(
        self, yaw_angle: float, x: float, y: float, linear_speed: float, flags: int
    ) -> Error | None:
        """Drive to a position, then turn to a yaw; flags: 1 backwards, 2 the shorter turn, 4 relative."""
        if flags & 3 == 3 or linear_speed < 0.0:
            return Error.BAD_DATA_VALUE
        at_yaw, at_x, at_y = self._place()
        if flags & 4:
            x, y = x + at_x, y + at_y
        away = wrapped(_direction(x - at_x, y - at_y) - at_yaw)
        backwards = bool(flags & 1) or (bool(flags & 2) and abs(away) > 90.0)
        has_arrived = False

        def aim() -> Treads:
            nonlocal has_arrived
            yaw, now_x, now_y = self._place()
            distance = math.hypot(x - now_x, y - now_y)
            has_arrived = has_arrived or distance < _ARRIVED
            if has_arrived:
                error = wrapped(yaw_angle - yaw)
                if abs(error) < 0.5 * _AIMED:
                    self._drove_to = True
                    self._stop(self.cause)
                    return _REST
                return self._turning(0.0, _GAIN * error)
            towards = _direction(x - now_x, y - now_y) + (180.0 if backwards else 0.0)
            error = wrapped(towards - yaw)
            speed = min(linear_speed, _GAIN * distance) * max(0.0, math.cos(math.radians(error))) ** 8
            return self._turning(-speed if backwards else speed, _GAIN * error)

        self._drive(_POSITION, aim)
        self._deadline = math.inf
        return None

    def drive_to_position_normalized(
        self, yaw_angle: int, x: float, y: float, linear_speed: int, flags: int
    ) -> Error | None:
        return self.drive_to_position_si(yaw_angle, x, y, TOP * linear_speed / 127, flags)

    def drive_stop(self) -> None:
        self._stop("drive_stop")

    def drive_stop_custom_decel(self, deceleration_rate: float) -> Error | None:
        if not deceleration_rate > 0.0:
            return Error.BAD_DATA_VALUE
        self._stop(self.command, deceleration_rate)
        return None

    def get_stop_controller_state(self) -> dict[str, Any]:
        return {"stopped": self._stopped}

    def set_custom_control_system_timeout(self, command_timeout: int) -> None:
        self._timeout = command_timeout / 1000

    def restore_default_control_system_timeout(self) -> None:
        self._timeout = TIMEOUT

    def set_default_control_system_for_type(self, control_system_type: int, controller_id: int) -> Error | None:
        if controller_id not in _CONTROLLERS.get(control_system_type, ()):
            return Error.BAD_DATA_VALUE
        self._defaults[control_system_type] = controller_id
        return None

    def get_default_control_system_for_type(self, control_system_type: int) -> dict[str, Any] | Error:
        if control_system_type not in self._defaults:
            return Error.BAD_DATA_VALUE
        return {"controller_id": self._defaults[control_system_type]}

    def restore_initial_default_control_systems(self) -> None:
        self._defaults = dict(_DEFAULTS)

    def get_active_control_system_id(self) -> dict[str, Any]:
        return {"controller_id": self._controller}

    def set_drive_target_slew_parameters(self, **parameters: float) -> Error | None:
        if not parameters["linear_acceleration"] > 0.0:
            return Error.BAD_DATA_VALUE
        self._slew = parameters
        return None

    def get_drive_target_slew_parameters(self) -> dict[str, Any]:
        return self._slew

    def restore_default_drive_target_slew_parameters(self) -> None:
        self._slew = dict(_SLEW)


def wrapped(angle: float) -> float:
    """The same angle [degrees] from -180 to 180."""
    return (angle + 180.0) % 360.0 - 180.0


def _direction(x: float, y: float) -> float:
    """The yaw [degrees] of a point that is x to the right and y forwards."""
    return math.degrees(math.atan2(-x, y))
