"""Watches a robot's devices by their events: battery, motors, lines, the lidar's sight. No ports, no clocks."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

from mercator_design.errors import RobotStopped
from mercator_design.robot.devices.health import (
    ANSWERS_WINDOW,
    MIN_ANSWERS,
    Answers,
    LineHealth,
    RvrHealth,
    charge,
    percent,
)
from mercator_design.robot.devices.link import Event, words
from mercator_design.robot.devices.ports import DeviceName
from mercator_design.robot.devices.settings import Limits
from mercator_design.robot.protocols.framing import Counts
from mercator_design.robot.protocols.rvr import Notification, Response
from mercator_design.robot.run.senses import Senses

_MAX_WAITING = 100
_DARK = (
    "it reads nothing but 0, 0, 0, which counts as not seen (white), not as black: is the lamp below the robot on, and "
    "is the robot on the floor? If its black floor reads so, set limits.dark: null in robot.yaml"
)


class Note(NamedTuple):
    """A note for the log."""

    text: str
    matters: bool = False  # whether users should see it at once


class Notes:
    """Notes of a robot. The latest ones wait until `send_to` sets their receivers."""

    def __init__(self) -> None:
        self._waiting: deque[Note] = deque(maxlen=_MAX_WAITING)
        self._receivers: tuple[Callable[[str], None], Callable[[str], None]] | None = None

    def send_to(self, log: Callable[[str], None], users: Callable[[str], None] = lambda _: None) -> None:
        """Send notes to `log` from now on, and those that matter also to `users`."""
        self._receivers = log, users
        while self._waiting:
            self.add(self._waiting.popleft())

    def add(self, note: Note) -> None:
        """Send a note, or keep it until it can be sent."""
        if self._receivers is None:
            self._waiting.append(note)
            return
        log, users = self._receivers
        log(note.text)
        if note.matters:
            users(note.text)


class Monitor:
    """Watches the devices of a robot; `RobotStopped` is raised if one reports that the robot must not drive.

    battery: Charge as text; empty until the RVR sends it.
    """

    def __init__(
        self, limits: Limits, senses: Senses, answers: Answers, damage_remedy: Callable[[DeviceName], str]
    ) -> None:
        """Make one, before the first event.

        Args:
            limits: The robot's limits.
            senses: The robot's senses, with the damage of the lines.
            answers: Counts of the RVR's answers to commands.
            damage_remedy: Returns what to check if the line of a device is damaged.
        """
        self.battery = ""
        self._senses, self._answers, self._remedy = senses, answers, damage_remedy
        self._rvr = RvrHealth(limits)
        self._answered = LineHealth(limits.rvr_whole, ANSWERS_WINDOW, MIN_ANSWERS)
        self._is_dark = False

    def take(self, event: Event) -> Iterator[Note]:
        """Take in an event; yield notes on it.

        Raises:
            RobotStopped: if the robot must not drive.
        """
        match event:
            case Response():
                if event.error:
                    yield Note(f"{event.name} was refused: {words(event.error)}")
            case Notification():
                said = [event.name, *(f"{name} {value}" for name, value in event.values.items())]
                yield Note(f"rvr: {' '.join(said).replace('_', ' ')}")
            case _:
                return
        if event.name == "get_battery_percentage" and event.values:
            before, self.battery = self.battery, charge(event.values["percentage"])
            if before != self.battery:
                yield Note(f"battery {self.battery}")
        for text in self._rvr.take(event.name, event.values):
            yield Note(text, matters=True)

    def check(self, now: float, counts: Mapping[DeviceName, Counts]) -> Iterator[Note]:
        """Check at a time [s] the lines, counts of bytes so far, what lidar and ground sensor see, and the treads.

        Raises:
            RobotStopped: if a tread is stuck for too long, or too few commands are answered.
        """
        was_dark, self._is_dark = self._is_dark, self._senses.is_dark
        if was_dark != self._is_dark:
            yield Note(f"ground: {_DARK if self._is_dark else 'it is seen again'}", matters=True)
        for device, count in counts.items():
            swept = self._senses.sweep.swept
            lost, received = (swept.lost, swept.all) if device == "lidar" else (count.lost, count.received)
            line = self._senses.lines[device]
            is_worse = line.check(now, lost, received)
            yield from self._changed(device, line, is_worse, "of what it sends arrives whole", "it counts as silent")
        for text in self._senses.sight.check(now):
            yield Note(f"lidar: {text}", matters=True)
        answers, line = self._answers, self._answered
        answers.check(now)
        is_worse, answered = line.check(now, answers.lost, answers.all), "of the commands to it are answered"
        if line.is_broken:
            limit = f"the limit is {percent(line.min_share)}"
            raise RobotStopped(f"rvr: only {percent(line.share)} {answered}; {limit}; {self._remedy('rvr')}")
        yield from self._changed("rvr", line, is_worse, answered, "the robot stops")
        self._rvr.check(now)

    def _changed(
        self, device: DeviceName, line: LineHealth, is_worse: bool | None, of_what: str, consequence: str
    ) -> Iterator[Note]:
        """Note that damage of a line has to be reported, or is over."""
        if is_worse is None:
            return
        found = f"{percent(line.share)} {of_what}"
        below = f"below {percent(line.min_share)} {consequence}; {self._remedy(device)}"
        yield Note(f"{device}: {f'only {found}; {below}' if is_worse else f'{found} again'}", matters=True)

    def lines(self, counts: Mapping[DeviceName, Counts]) -> dict[DeviceName, list[float]]:
        """The numbers of each device's line, in the order of `LINES` (logs/events.py)."""
        found: dict[DeviceName, list[float]] = {
            device: [round(self._senses.lines[device].share, 4), *count] for device, count in counts.items()
        }
        answers = self._answers
        found["rvr"] += [round(self._answered.share, 4), answers.all, answers.lost, answers.repeated]
        if "lidar" in found:
            found["lidar"].append(self._senses.sight.readings)
        return found

    def forget(self) -> None:
        """Restart the count of answers: the program has not read the devices for a while."""
        self._answers.forget()
        self._answered.forget()
