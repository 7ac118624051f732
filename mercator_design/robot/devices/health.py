"""The health of a robot: the damage on its lines, and the RVR's battery and motors. Without input, output or clock.

Bytes from each device are counted, and the RVR's answers to commands, which show what arrives there.
"""

import math
from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from mercator_design.errors import RobotStopped
from mercator_design.robot.devices.settings import Limits

WINDOW = 2.0
"""[s] over which the damage of a line is counted."""
_CALM = 5.0  # [s] without damage before a line is reported as good again
_STEP = 0.1  # [s] between counts that are kept
ANSWERS_WINDOW = 5.0
"""[s] over which answers to commands are counted: longer, as there are about 15 a second."""
MIN_ANSWERS = 40
"""Number of commands in a window, at least; missing ones count as answered."""
ANSWER_LIMIT = 0.3
"""[s] after which a command without an answer counts as lost."""


class _Counted(NamedTuple):
    time: float
    lost: float
    all: float


class LineHealth:
    """The share of a device's data that arrives whole.

    share: The share in the last window, 0 to 1; 1 if nothing came.
    """

    def __init__(self, min_share: float, window: float = WINDOW, min_count: float = 0.0) -> None:
        """Make one for a line that is not known yet.

        Args:
            min_share: Share below which the line is broken.
            window: Time over which it is counted [s].
            min_count: Smallest amount for a share; missing data count as whole.
        """
        self.min_share, self._window, self._min_count = min_share, window, min_count
        self._is_noted, self._ill = False, -math.inf
        self.forget()

    def forget(self) -> None:
        """Restart the count. Damage that was reported before is not reported again."""
        self.share = 1.0
        self._counted: deque[_Counted] = deque()

    @property
    def is_broken(self) -> bool:
        """Whether the share is below the limit."""
        return self.share < self.min_share

    def check(self, now: float, lost: float, received: float) -> bool | None:
        """Take the amounts that were lost and received up to a time [s], both counted from any start.

        Returns:
            True if damage is to be reported from now on, False if it is over, None if nothing changes.
        """
        latest = _Counted(now, lost, received)
        while self._counted and self._counted[0].time < now - self._window:
            self._counted.popleft()
        if not self._counted:
            self._ill = now  # the health of the line until now is not known
        if not self._counted or now - self._counted[-1].time >= _STEP:
            self._counted.append(latest)
        first = self._counted[0]
        # Until a window is full, the missing part counts as whole: one damaged frame of a few proves little.
        came = (latest.all - first.all) * max(1.0, self._window / max(now - first.time, _STEP))
        came = max(came, self._min_count)
        self.share = 1.0 - (latest.lost - first.lost) / came if came > 0 else 1.0
        warning = warning_share(self.min_share)
        if self.share < warning_share(warning):  # a higher limit, for some time, so that notes are few
            self._ill = now
        if self.share < warning if not self._is_noted else now - self._ill > _CALM:
            self._is_noted = not self._is_noted
            return self._is_noted
        return None


class Answers:
    """Counts which commands are answered in time. The others, or their answers, were lost on their way.

    all: Number of commands that were answered or lost.
    lost: Number of these without a valid answer in time.
    repeated: Number of commands that were sent again because they had arrived damaged.
    """

    def __init__(self) -> None:
        self.all = self.lost = self.repeated = 0
        self._awaited: dict[int, float] = {}  # time [s] of sending, by sequence number, in order

    def send(self, number: int, now: float) -> None:
        """Take in that a command was sent at a time [s]; it awaits an answer."""
        self._awaited.pop(number, None)
        self._awaited[number] = now

    def take(self, number: int, *, is_damaged: bool) -> None:
        """Take in the answer to a command; it may say that the command arrived damaged."""
        if self._awaited.pop(number, None) is not None:
            self.all += 1
            self.lost += is_damaged

    def check(self, now: float) -> None:
        """Count the commands as lost whose time for an answer is over at a time [s]."""
        for number, sent in list(self._awaited.items()):
            if now - sent <= ANSWER_LIMIT:
                return
            del self._awaited[number]
            self.all += 1
            self.lost += 1

    def forget(self) -> None:
        """Await no answers any more: the program has not read the devices for a while."""
        self._awaited.clear()


def warning_share(min_share: float) -> float:
    """The share that arrives whole below which users are warned, if less than `min_share` stops the robot."""
    return 0.5 * (1.0 + min_share)


GOOD, LOW, CRITICAL = 1, 2, 3
"""States of the battery."""
_HOT, _TOO_HOT = 1, 2  # of a motor
SIDES = ("left", "right")
"""Sides of the motors, by their numbers."""
_HYSTERESIS = 2  # [%] above the limit, where a battery is no longer low


def percent(share: float) -> str:
    """A share as text, rounded down, so that a share below a limit never looks equal to it."""
    return f"{math.floor(100.0 * share + 1e-9)} %"


def charge(percentage: int) -> str:
    """The charge of a battery as text."""
    return f"{percentage} %"


class RvrHealth:
    """The RVR's battery and motors, as it reports them."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._percentage = 100
        self._state = GOOD
        self._is_low = False
        self._heat = [0, 0]
        self._is_stuck = [False, False]
        self._stuck_for = [0.0, 0.0]  # [s], less the time since it can turn again
        self._looked: float | None = None

    def take(self, name: str, values: Mapping[str, Any]) -> Iterator[str]:
        """Take in a response or notification by its name; yield messages for users.

        Raises:
            RobotStopped: if the robot must not drive.
        """
        match name:
            case "get_battery_percentage" if values:
                self._percentage = values["percentage"]
                yield from self._battery(f" ({charge(self._percentage)})")
            case "battery_voltage_state_change" | "get_battery_voltage_state" if values:
                self._state = values["state"]
                yield from self._battery("")
            case "motor_stall" if values["motor_index"] < len(SIDES):
                side = values["motor_index"]
                self._is_stuck[side] = values["is_triggered"]
                yield f"rvr: the {SIDES[side]} tread {'is stuck' if values['is_triggered'] else 'can turn again'}"
            case "motor_thermal_protection_status" | "get_motor_thermal_protection_status" if values:
                for k, side in enumerate(SIDES):
                    yield from self._motor(k, values[f"{side}_motor_temperature"], values[f"{side}_motor_status"])
            case "motor_fault" | "get_motor_fault_state" if values and values["is_fault"]:
                raise RobotStopped("rvr: a motor has a fault")
            case "did_sleep":
                raise RobotStopped("rvr: it fell asleep")

    def check(self, now: float) -> None:
        """Check at a time [s] whether a tread has been stuck for too long.

        The RVR cuts the power of a stuck motor after a few seconds and tries again: so the time for which it was stuck
        falls as slowly as it has grown.

        Raises:
            RobotStopped: if a tread has.
        """
        since = 0.0 if self._looked is None else now - self._looked
        self._looked = now
        for k, side in enumerate(SIDES):
            self._stuck_for[k] = max(0.0, self._stuck_for[k] + (since if self._is_stuck[k] else -since))
            if self._stuck_for[k] > self._limits.stall:
                found = f"for {self._stuck_for[k]:.1f} s; the limit is {self._limits.stall:g} s"
                raise RobotStopped(f"rvr: the {side} tread is stuck {found}; free it")

    def _battery(self, found: str) -> Iterator[str]:
        if self._state == CRITICAL or self._percentage < self._limits.battery_critical:
            raise RobotStopped(f"rvr: the battery is critical{found}; charge it")
        was_low = self._is_low
        enough = self._limits.battery_low + (_HYSTERESIS if was_low else 0)
        self._is_low = self._state == LOW or self._percentage < enough
        if self._is_low and not was_low:
            yield f"rvr: the battery is low{found}; charge it soon"

    def _motor(self, k: int, temperature: float, status: int) -> Iterator[str]:
        before, self._heat[k] = self._heat[k], status
        found = f"rvr: the {SIDES[k]} motor is"
        if status >= _TOO_HOT:
            raise RobotStopped(
                f"{found} too hot ({temperature:.0f} degrees); let it cool, and leave the RVR switched on"
            )
        if status != before:
            yield f"{found} {'hot' if status == _HOT else 'no longer hot'} ({temperature:.0f} degrees)"
