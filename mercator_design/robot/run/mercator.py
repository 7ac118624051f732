"""The robot: its senses, wheels and lamps; start-up and shut-down."""

import contextlib
import math
import time
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import partial
from typing import Any

import serial

from mercator_design.config.colours import RGB, ColourName, Levels
from mercator_design.errors import RobotError, RobotStopped
from mercator_design.modules.reference import Actions, Readings
from mercator_design.robot.devices.link import Heard, Link, error_remedy, words
from mercator_design.robot.devices.ports import DeviceName, Line
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.devices.start import (
    BATTERY_QUERIES,
    DRIVE,
    MOTOR_QUERIES,
    commands_end,
    halt,
    secure_rvr,
    start_hub,
    start_lidar,
    stop_lidar,
    stop_rvr,
    wake_rvr,
    watch_rvr,
)
from mercator_design.robot.devices.streams import start_streams
from mercator_design.robot.protocols.rvr import Response
from mercator_design.robot.protocols.rvr_messages import DAMAGED, lights
from mercator_design.robot.run.monitor import Monitor, Note, Notes
from mercator_design.robot.run.safety import Brake
from mercator_design.robot.run.senses import Senses, Stale

QUERY_EVERY = 1.0
"""[s] between queries of battery and motors."""

START_LIMIT = 5.0  # [s] for the first sample of every sensor; a lidar's motor takes a few
_CHECK_EVERY = 0.01  # [s] between checks whether they have come
_SHOW_EVERY = 1.0  # [s] after which the lamps are set again, as a frame may have been lost
_QUERIES = (*BATTERY_QUERIES, *MOTOR_QUERIES)


class Mercator:
    """A Mercator robot; `start` starts it up, and `close`, on every way out, stops it and shuts it down.

    senses: Its perception.
    monitor: The watch on its devices.
    facts: Versions and the like from its start-up, for users.
    notes: Notes on its devices.
    stop_failure: Why its stop is not confirmed, once it is closed; empty if it is confirmed.
    """

    def __init__(
        self,
        settings: Settings,
        ports: Mapping[DeviceName, serial.Serial],
        reads: Iterable[str],
        labels: Mapping[ColourName, RGB],
        extra: Collection[str] = (),
    ) -> None:
        """Make the robot; nothing is sent yet.

        Args:
            settings: The robot's settings.
            ports: The open ports of its devices.
            reads: The senses that are needed, of modules.SENSES; the robot stops if one of them is stale.
            labels: What the ground sensor reads on each colour of the floor.
            extra: Further sensors of the RVR, of samples.FIELDS, which it streams if it can.

        Raises:
            RobotError: if the robot lacks a sense.
        """
        self.senses = Senses(settings, reads, labels)
        self._link = Link(Line(device, port) for device, port in ports.items())
        self._settings = settings
        self._extra = extra
        self._refused: dict[str, str] = {}  # what the RVR does not do and the robot can do without, and why
        self._do_commands_end = False
        self._queried = -math.inf
        self._shown: tuple[float, Mapping[str, Levels]] | None = None
        self.monitor = Monitor(settings.limits, self.senses, self._link.answers, self._link.damage_remedy)
        self.facts: dict[str, Any] = {}
        self._doubts: list[str] = []
        self.notes = Notes()
        self.stop_failure = ""
        self.brake = Brake(
            partial(self._link.send, "rvr"), self._drive_command, halt(self._link), settings.limits.speed
        )

    def introduce(self, report: Callable[[str], None]) -> None:
        """Report its name and facts, and warnings."""
        facts = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in self.facts.items())
        report(f"{self._settings.name}: {facts}")
        if not self._do_commands_end:
            timeout = self._settings.rvr.timeout
            report(f"Warning: not confirmed that the RVR stops by itself {timeout:g} s after the last command")
        for doubt in self._doubts:
            report(f"Warning: {doubt}")
            self.notes.add(Note(doubt))
        swarm = self._settings.swarm
        if swarm.heartbeat is not None and swarm.key is None:
            unsigned = "heartbeats are not signed: anybody in the network can keep this robot running"
            report(f"Warning: {unsigned}; swarm.key in robot.yaml")
            self.notes.add(Note(unsigned))

    def attend(self, until: float, taken: list[Heard] | None = None) -> list[Heard]:
        """Read the devices until a time [s, of time.monotonic()], once at least; return their events.

        They are appended to `taken`, if it is given: so it also has the events before an error.

        Raises:
            RobotStopped: if a device reports that the robot must not drive, or a port is lost.
        """
        return self._take(self._link.poll(until), [] if taken is None else taken)

    def _take(self, events: Iterable[Heard], taken: list[Heard]) -> list[Heard]:
        """Take in events as they come, then check the devices; errors are those of `attend`."""
        for heard in events:
            taken.append(heard)
            self.senses.take(*heard)
            self._add_notes(self.monitor.take(heard.event))
            if isinstance(heard.event, Response) and heard.event.name == DRIVE and heard.event.error:
                self._refuse_drive(heard.event.error)
        self._add_notes(self.monitor.check(time.monotonic(), self._link.counts()))
        return taken

    def _add_notes(self, notes: Iterable[Note]) -> None:
        for note in notes:
            self.notes.add(note)

    def _refuse_drive(self, error: int) -> None:
        """Take in that the RVR has refused a drive command; send it again if it was damaged on its way."""
        if error not in DAMAGED:
            port = self._link.lines["rvr"].port
            raise RobotStopped(f"rvr: it does not drive: {words(error)}; {error_remedy(error)} (rvr on {port})")
        self._link.answers.repeated += self.brake.repeat()

    def lines(self) -> dict[DeviceName, list[float]]:
        """The numbers of each line, as `Monitor.lines`."""
        return self.monitor.lines(self._link.counts())

    def readings(self) -> Readings:
        """The present readings; those of a stale sensor are neutral.

        Raises:
            RobotStopped: if a sense that is needed is stale.
        """
        self.check_ages()
        return self.senses.readings(time.monotonic())

    def check_ages(self) -> None:
        """Raise `RobotStopped` if a sense that is needed is stale."""
        for why in self.stale(time.monotonic()).values():
            raise RobotStopped(why)

    def stale(self, now: float) -> dict[str, str]:
        """A message for each sample that is needed and too old at a time [s], by name."""
        return self._messages(self.senses.stale(now))

    def _not_fit(self, now: float) -> dict[str, str]:
        """The same, also for each that comes too seldom."""
        return self._messages(self.senses.slow() | self.senses.stale(now))

    def _messages(self, stale: Mapping[str, Stale]) -> dict[str, str]:
        return {name: f"{name}: {found.words}; {self._remedy(found)}" for name, found in stale.items()}

    def _remedy(self, found: Stale) -> str:
        if found.is_damaged:
            return self._link.damage_remedy(found.device)
        if found.device == "rvr":
            heard, later = self._link.understood.get("rvr", -math.inf), 0.5 * self._settings.limits.rvr
            if heard > found.since + later:
                return self._link.stream_remedy()
        return found.remedy or self._link.remedy(found.device)

    def drive(self, actions: Actions, *, is_dry: bool = False) -> None:
        """Turn the treads at fractions of their maximum speed; a dry run leaves them at rest.

        Raises:
            RobotStopped: if something has stopped the wheels, a fraction is out of range or NaN, or the port is lost.
        """
        speed = self._settings.limits.speed
        left, right = speed * actions.left, speed * actions.right
        self.brake.check(left, right)
        self.brake.drive(*((0.0, 0.0) if is_dry else (left, right)))

    def query(self) -> None:
        """Query battery and motors every `QUERY_EVERY`: this keeps the RVR awake, and its answers show damage."""
        if time.monotonic() - self._queried > QUERY_EVERY:
            self._queried = time.monotonic()
            for name in _QUERIES:
                if name not in self._refused:
                    self._link.send("rvr", self._link.encode_counted(name))

    def show(self, colours: Mapping[str, Levels]) -> None:
        """Set the colours of lamps, of rvr_messages.LIGHTS."""
        now = time.monotonic()
        if self._shown is None or self._shown[1] != colours or now - self._shown[0] > _SHOW_EVERY:
            self._shown = now, colours
            self._link.send("rvr", self._link.encode_counted("set_all_leds", **lights(colours)))

    def close(self) -> None:
        """Stop the wheels, then all else. Raises nothing: `stop_failure` says why the stop is not confirmed."""
        self.brake.stop("the run has ended")
        link = self._link
        link.is_ending = True
        try:
            stop_rvr(link)
        except RobotError as error:
            self.stop_failure = f"RVR stop not confirmed: {error}"
        with contextlib.suppress(RobotError):
            if "lidar" in link.lines:
                stop_lidar(link)
        if self.stop_failure:
            self.notes.add(Note(self.stop_failure))

    def start(self) -> None:
        """Start the robot up; errors are those of `attend`, and a RobotError if a device cannot be used."""
        link = self._link
        rvr = wake_rvr(link)
        self.facts |= rvr.words()
        self._queried = time.monotonic()
        secure_rvr(link, self._settings.rvr.timeout)
        self._watch_commands_end()
        self._refused = {**rvr.refused, **watch_rvr(link)}
        self._start_sensors()
        for what, why in self._refused.items():
            self.notes.add(Note(f"rvr: it does without {what.replace('_', ' ')}: {why}", matters=True))
        self.attend(time.monotonic())  # the lidar does not start with a critical battery
        if "lidar" in link.lines:
            lidar = start_lidar(link)
            self.facts |= lidar.words()
            self._doubts += [f"lidar: {doubt}" for doubt in lidar.doubts().values()]
        if "proximity" in link.lines and (doubt := start_hub(link)):
            self._doubts.append(f"proximity: {doubt}")
        self._await_samples()

    def _start_sensors(self) -> None:
        """Light the lamp of the ground sensor, and let the RVR stream what is needed, and what it can besides."""
        link, needed = self._link, self.senses.needed_of_rvr
        optional = [name for name in (*self.senses.wanted_of_rvr, *self._extra) if name not in needed]
        for command in ("reset_yaw", "reset_locator_x_and_y"):
            if self.senses.count_from_start:
                link.ask(command)
            elif why := link.refusal(command):  # the log depends on them, readings do not
                self._refused[command] = why
        if "ground" in needed:
            link.ask("enable_color_detection", is_enabled=True)
        elif "ground" in optional and (why := link.refusal("enable_color_detection", is_enabled=True)):
            self._refused["enable_color_detection"] = why
        self._refused |= start_streams(link, needed, optional, self._settings.rvr.period)

    def sense_anew(self) -> None:
        """Read what has come, and wait for fresh samples of all senses that are needed.

        Raises:
            RobotError: if one does not come.
            RobotStopped: as `attend`.
        """
        self._take(self._link.backlog(), [])
        self._await_samples()

    def _await_samples(self) -> None:
        """Wait for a fresh sample of each sense that is needed."""
        self.attend(time.monotonic())
        self.senses.forget(time.monotonic())  # samples from the start-up may be old
        self.monitor.forget()
        end = time.monotonic() + START_LIMIT
        while ((stale := self._not_fit(now := time.monotonic())) or self.senses.may_be_dark) and now < end:
            self.query()  # the answers show whether the RVR is there
            self.attend(now + _CHECK_EVERY)
        for why in stale.values():
            raise RobotError(why)

    def _watch_commands_end(self) -> None:
        """Check that a drive command ends by itself; errors are those of `commands_end` and `attend`."""
        self._do_commands_end = commands_end(
            self._link, self._settings, lambda: self.brake.drive(0.0, 0.0), self.attend
        )
        seen = f"seen after {self._settings.rvr.timeout:g} s"
        self.facts["commands_end"] = seen if self._do_commands_end else "not seen"

    def _drive_command(self, left: float, right: float) -> bytes:
        return self._link.encode_counted(DRIVE, left_velocity=left, right_velocity=right)
