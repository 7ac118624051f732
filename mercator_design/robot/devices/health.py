"""How well the robot is: what of a line arrives whole; the RVR's battery and motors. Without input, output or clock.

Of each line it is counted what comes. Of that to the RVR also what arrives there, by its answers to commands.
"""

import math
from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from mercator_design.errors import RobotStopped
from mercator_design.robot.devices.settings import Limits

WINDOW = 2.0
"""[s] over which it is counted what arrives whole."""
_CALM = 5.0  # [s] for which a line must be well again
_STEP = 0.1  # [s] between looks that are remembered
ANSWERS_WINDOW = 5.0
"""[s] over which it is counted which commands are answered: longer, as there are some 14 a second."""
MIN_ANSWERS = 40
"""Commands of a window that count as answered if there are fewer."""
IN_TIME = 0.3
"""[s] after which a command that is not answered counts as lost."""


class _Look(NamedTuple):
    time: float
    lost: float
    all: float


class LineHealth:
    """Which share of what a device sends arrives whole.

    share: In the last window, 0 to 1; 1 if nothing came.
    """

    def __init__(self, min_share: float, window: float = WINDOW, min_count: float = 0.0) -> None:
        """Begin with a line of which nothing is known.

        Args:
            min_share: Share below which the line cannot be relied on.
            window: Time over which it is counted [s].
            min_count: How much is counted at least; what is missing of it counts as whole.
        """
        self.min_share, self._window, self._min_count = min_share, window, min_count
        self._is_noted, self._ill = False, -math.inf
        self.forget()

    def forget(self) -> None:
        """Begin to count anew. Trouble that was reported before is not reported again."""
        self.share = 1.0
        self._looks: deque[_Look] = deque()

    @property
    def is_broken(self) -> bool:
        """Whether too little arrives whole."""
        return self.share < self.min_share

    def look(self, now: float, lost: float, received: float) -> bool | None:
        """Take in how much was lost, and how much came, up to a time [s], both counted from any beginning.

        Returns:
            True if damage begins to matter with this look, False if it ceases to, else None.
        """
        look = _Look(now, lost, received)
        while self._looks and self._looks[0].time < now - self._window:
            self._looks.popleft()
        if not self._looks:
            self._ill = now  # how the line was until now is not known
        if not self._looks or now - self._looks[-1].time >= _STEP:
            self._looks.append(look)
        first = self._looks[0]
        # Until a window is full, what is missing of it counts as whole: one damaged frame of a few says little.
        came = (look.all - first.all) * max(1.0, self._window / max(now - first.time, _STEP))
        came = max(came, self._min_count)
        self.share = 1.0 - (look.lost - first.lost) / came if came > 0 else 1.0
        worse = matters_below(self.min_share)
        if self.share < matters_below(worse):  # further up, and for some time, so that notes are few
            self._ill = now
        if self.share < worse if not self._is_noted else now - self._ill > _CALM:
            self._is_noted = not self._is_noted
            return self._is_noted
        return None


class Answers:
    """Which commands are answered in time; those that are not were lost on their way, or their answers were.

    all: Commands of which that is known.
    lost: Of these, those without a sound answer in time.
    repeated: Commands that were sent again because the answer said that they were damaged.
    """

    def __init__(self) -> None:
        self.all = self.lost = self.repeated = 0
        self._awaited: dict[int, float] = {}  # when each was sent [s], by its number, the latest last

    def send(self, number: int, now: float) -> None:
        """A command that is to be answered is sent at a time [s]."""
        self._awaited.pop(number, None)
        self._awaited[number] = now

    def take(self, number: int, *, is_damaged: bool) -> None:
        """The answer to a command has come; it may say that the command was damaged."""
        if self._awaited.pop(number, None) is not None:
            self.all += 1
            self.lost += is_damaged

    def look(self, now: float) -> None:
        """Count as lost what has not been answered by a time [s] and should be."""
        for number, sent in list(self._awaited.items()):
            if now - sent <= IN_TIME:
                return
            del self._awaited[number]
            self.all += 1
            self.lost += 1

    def forget(self) -> None:
        """Forget the answers that are awaited: the program has not listened for a while."""
        self._awaited.clear()


def matters_below(least: float) -> float:
    """The share that arrives whole below which users are warned, if less than `least` stops the robot."""
    return 0.5 * (1.0 + least)


GOOD, LOW, CRITICAL = 1, 2, 3
"""States of the battery."""
_HOT, _TOO_HOT = 1, 2  # of a motor
SIDES = ("left", "right")
"""Of motors, by their numbers."""
_RECOVERED = 2  # [%] above the limit, from which on a battery is no longer low


def percent(share: float) -> str:
    """A share as text; rounded down, so that a share below a limit looks so."""
    return f"{math.floor(100.0 * share + 1e-9)} %"


def charge(percentage: int) -> str:
    """The charge of a battery as text."""
    return f"{percentage} %"


class RvrHealth:
    """What the RVR says of its battery and its motors, and what follows from it."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._percentage = 100
        self._state = GOOD
        self._is_low = False
        self._heat = [0, 0]
        self._is_stuck = [False, False]
        self._stuck_for = [0.0, 0.0]  # [s], less the time since
        self._looked: float | None = None

    def take(self, name: str, values: Mapping[str, Any]) -> Iterator[str]:
        """Take in a response or notification by its name; messages for users.

        Raises:
            Stopped: if the robot must not drive.
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
            case "motor_fault" if values["is_fault"]:
                raise RobotStopped("rvr: a motor has a fault")
            case "did_sleep":
                raise RobotStopped("rvr: it fell asleep")

    def look(self, now: float) -> None:
        """Look at a time [s] whether a tread has been stuck for too long.

        The RVR cuts a motor that is stuck for a few seconds, and tries again: so the time for which it was is forgotten
        as slowly as it has grown.

        Raises:
            Stopped: if one has.
        """
        since = 0.0 if self._looked is None else now - self._looked
        self._looked = now
        for k, side in enumerate(SIDES):
            self._stuck_for[k] = max(0.0, self._stuck_for[k] + (since if self._is_stuck[k] else -since))
            if self._stuck_for[k] > self._limits.stall:
                found = f"for {self._stuck_for[k]:.1f} s; the limit is {self._limits.stall:g} s"
                raise RobotStopped(f"rvr: the {side} tread is stuck {found}; free it")

    def _battery(self, told: str) -> Iterator[str]:
        if self._state == CRITICAL or self._percentage < self._limits.battery_critical:
            raise RobotStopped(f"rvr: the battery is critical{told}; charge it")
        was_low = self._is_low
        enough = self._limits.battery_low + (_RECOVERED if was_low else 0)
        self._is_low = self._state == LOW or self._percentage < enough
        if self._is_low and not was_low:
            yield f"rvr: the battery is low{told}; charge it soon"

    def _motor(self, k: int, temperature: float, status: int) -> Iterator[str]:
        before, self._heat[k] = self._heat[k], status
        found = f"rvr: the {SIDES[k]} motor is"
        if status >= _TOO_HOT:
            raise RobotStopped(
                f"{found} too hot ({temperature:.0f} degrees); let it cool, and leave the RVR switched on"
            )
        if status != before:
            yield f"{found} {'hot' if status == _HOT else 'no longer hot'} ({temperature:.0f} degrees)"
