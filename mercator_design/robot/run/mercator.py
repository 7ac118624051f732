"""The robot as one object: its senses, the wheels, the lamps; start-up and shut-down."""

import contextlib
import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

from mercator_design.config.colours import RGB, ColourName, Levels
from mercator_design.errors import RobotError, RobotStopped
from mercator_design.fsm.reference import Readings, Wheels
from mercator_design.robot.devices.health import ANSWERS_WINDOW, MIN_ANSWERS, LineHealth, RvrHealth, charge, percent
from mercator_design.robot.devices.link import Event, Link, words
from mercator_design.robot.devices.ports import DEVICES, DeviceName, Line, Ports
from mercator_design.robot.devices.samples import STREAMED
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.devices.start import halt, start_hub, start_lidar, stop_lidar, stop_rvr, wake_rvr
from mercator_design.robot.devices.sweep import MIN_READINGS
from mercator_design.robot.protocols.framing import Counts
from mercator_design.robot.protocols.rvr import Notification, Response
from mercator_design.robot.protocols.rvr_messages import DAMAGED, lights
from mercator_design.robot.protocols.rvr_streaming import streaming
from mercator_design.robot.run.safety import Brake
from mercator_design.robot.run.senses import Senses, Stale

COMMANDS_END = 0.3
"""[s] after which the RVR stops by itself if it hears no command: a program that is dead drives no longer."""
PERIOD = 0.05
"""[s] of the RVR's streaming."""
POLL = 1.0
"""[s] between questions after battery and motors."""

_BEGIN = 5.0  # [s] until every sensor has told something; a lidar's motor takes a few
_SHOW = 1.0  # [s] after which the lamps are set again, as a frame may have been lost
_NOTES = 100
_DRIVE = "drive_tank_si_units"
_TANK, _BRAKING = 2, 0  # controllers of the drive


class Mercator:
    """A Mercator robot, to be started up, and closed on every way out, which stops it and shuts it down.

    senses: What it perceives.
    facts: Versions and the like, to show to users.
    notes: Notes that wait for `report`, each with whether users should see it at once; the latest only.
    stop_failure: Why its stop is not confirmed, once it is closed; empty if it is confirmed.
    listen: Called with each event of the devices and its time [s].
    """

    def __init__(
        self, settings: Settings, ports: Ports, reads: Iterable[str], labels: Mapping[ColourName, RGB]
    ) -> None:
        """Make the robot; nothing is sent yet.

        Args:
            settings: What is particular to it.
            ports: Its open ports.
            reads: The senses that are needed, of modules.SENSES; the robot stops if one of them is stale.
            labels: What the ground sensor reads on each colour of the floor.

        Raises:
            RobotError: if it lacks a sense.
        """
        self.senses = Senses(settings, reads, labels)
        lines = {device: Line(device, port) for device, port in zip(DEVICES, ports, strict=True) if port is not None}
        self._link = Link(lines.values(), self._take)
        self._lidar, self._has_hub, self._devices = lines.get("lidar"), "proximity" in lines, [*lines]
        self._settings = settings
        self._is_blind = self._do_commands_end = False
        self._polled = -math.inf
        self._shown: tuple[float, Mapping[str, Levels]] | None = None
        self._health = RvrHealth(settings.limits)
        self._answered = LineHealth(settings.limits.rvr_whole, ANSWERS_WINDOW, MIN_ANSWERS)
        self.facts: dict[str, Any] = {}
        self.stop_failure = ""
        self.notes: deque[tuple[str, bool]] = deque(maxlen=_NOTES)
        self._reports: tuple[Callable[[str], None], Callable[[str], None]] | None = None
        self.listen: Callable[[Event, float], None] = lambda _event, _now: None
        self.brake = Brake(
            partial(self._link.send, "rvr"), self._drive_command, halt(self._link), settings.limits.speed
        )

    def introduce(self, report: Callable[[str], None]) -> None:
        """Report its name and facts, and warnings."""
        facts = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in self.facts.items())
        report(f"{self._settings.name}: {facts}")
        if not self._do_commands_end:
            report(f"Warning: not confirmed that the RVR stops by itself {COMMANDS_END:g} s after the last command")
        swarm = self._settings.swarm
        if swarm.heartbeat is not None and swarm.key is None:
            unsigned = "heartbeats are not signed: anybody in the network can keep this robot running"
            report(f"Warning: {unsigned}; swarm.key in robot.yaml")
            self.note(unsigned)

    def report(self, note: Callable[[str], None], report: Callable[[str], None] = lambda _: None) -> None:
        """Send notes to `note` from now on, and those that matter to users to `report`, too."""
        self._reports = note, report
        while self.notes:
            text, matters = self.notes.popleft()
            self.note(text, matters=matters)

    def note(self, text: str, *, matters: bool = False) -> None:
        """Write a note; report it to users if it matters to them."""
        if self._reports is None:
            self.notes.append((text, matters))
            return
        note, report = self._reports
        note(text)
        if matters:
            report(text)

    def attend(self, until: float) -> None:
        """Read the devices until a time [s, of time.monotonic()], once at least.

        Raises:
            Stopped: if a device says that the robot must not drive, or a port is lost.
        """
        self._link.attend(until)
        self._look(time.monotonic())

    def _look(self, now: float) -> None:
        """Check at a time [s] the quality of the lines, and whether a tread is stuck."""
        for device, text, is_worse in self.senses.look(now, self._counts()):
            remedy = f"; {self._link.remedy_of_damage(device)}" if is_worse else ""
            self.note(f"{device}: {text}{remedy}", matters=True)
        self._look_at_answers(now)
        self._health.look(now)

    def _look_at_answers(self, now: float) -> None:
        """Check at a time [s] whether the RVR answers commands: it does not answer those that are damaged on their way.

        Raises:
            Stopped: if too few are answered.
        """
        answers, line = self._link.answers, self._answered
        answers.look(now)
        is_worse = line.look(now, answers.lost, answers.all)
        found, least = f"{percent(line.share)} of the commands to it are answered", percent(line.least)
        if line.is_broken:
            raise RobotStopped(f"rvr: only {found}; the limit is {least}; {self._link.remedy_of_damage('rvr')}")
        if is_worse is not None:
            worse = f"only {found}; below {least} the robot stops; {self._link.remedy_of_damage('rvr')}"
            self.note(f"rvr: {worse if is_worse else f'{found} again'}", matters=True)

    def _counts(self) -> dict[DeviceName, Counts]:
        return {device: self._link.counts(device) for device in self._devices}

    def lines(self) -> dict[DeviceName, list[float]]:
        """Of each line the share that arrives whole, and the bytes that came, were lost, and frames that were refused.

        Of the lidar's the readings of its last turn, too; of the RVR's the share of commands that were answered, and of
        commands how many were sent, not answered, and repeated.
        """
        found: dict[DeviceName, list[float]] = {
            device: [round(self.senses.lines[device].share, 4), *count] for device, count in self._counts().items()
        }
        answers = self._link.answers
        found["rvr"] += [round(self._answered.share, 4), answers.all, answers.lost, answers.repeated]
        if "lidar" in found:
            found["lidar"].append(self.senses.sight)
        return found

    def readings(self) -> Readings:
        """The readings of now; those of a stale sensor are neutral.

        Raises:
            Stopped: if a sense that is needed is stale.
        """
        self.check_ages()
        return self.senses.readings(time.monotonic())

    def check_ages(self) -> None:
        """Check that no sense that is needed is stale.

        Raises:
            Stopped: if a sense that is needed is stale.
        """
        for why in self.stale(time.monotonic()).values():
            raise RobotStopped(why)

    def stale(self, now: float) -> dict[str, str]:
        """By name, a message for each sample that is needed and too old at a time [s]."""
        return {name: f"{name}: {found.words}; {self._remedy(found)}" for name, found in self.senses.stale(now).items()}

    def _remedy(self, found: Stale) -> str:
        link = self._link
        return link.remedy_of_damage(found.device) if found.is_damaged else link.remedy(found.device)

    def drive(self, wheels: Wheels, *, is_dry: bool = False) -> None:
        """Turn the treads, at fractions of the limit of their speed; if dry, leave them at rest.

        Raises:
            Stopped: if something has stopped the wheels, a fraction is out of range or no number, or the port is lost.
        """
        speed = self._settings.limits.speed
        left, right = speed * wheels.left, speed * wheels.right
        self.brake.check(left, right)
        self.brake.drive(*((0.0, 0.0) if is_dry else (left, right)))

    def poll(self) -> None:
        """Ask for the state of battery and motors from time to time; this keeps the RVR awake and shows that it hears.

        Raises:
            Stopped: if the port is lost.
        """
        if time.monotonic() - self._polled > POLL:
            self._polled = time.monotonic()
            for name in ("get_battery_voltage_state", "get_battery_percentage", "get_motor_thermal_protection_status"):
                self._link.send("rvr", self._link.counted(name))

    def show(self, colours: Mapping[str, Levels]) -> None:
        """Give lamps, of rvr_messages.LIGHTS, their colours."""
        now = time.monotonic()
        if self._shown is None or self._shown[1] != colours or now - self._shown[0] > _SHOW:
            self._shown = now, colours
            self._link.send("rvr", self._link.counted("set_all_leds", **lights(colours)))

    def close(self) -> None:
        """Stop the wheels, then all else; nothing is raised, but `stop_failure` says why the stop is not confirmed."""
        self.brake.stop("the run has ended")
        link = self._link
        link.is_ending = True
        try:
            stop_rvr(link)
        except RobotError as error:
            self.stop_failure = f"RVR stop not confirmed: {error}"
        with contextlib.suppress(RobotError):
            if self._lidar is not None:
                stop_lidar(link, self._lidar)
        if self.stop_failure:
            self.note(self.stop_failure)

    def start(self) -> None:
        """Start it up; errors are those of `attend`, and RobotError: if a device cannot be used."""
        link = self._link
        self.facts |= wake_rvr(link).words()
        self._polled = time.monotonic()
        link.ask("set_custom_control_system_timeout", command_timeout=round(1000 * COMMANDS_END))
        self._watch_commands_end()
        link.ask("enable_battery_voltage_state_change_notify", is_enabled=True)
        for notify in ("motor_fault", "motor_stall", "motor_thermal_protection_status"):
            link.ask(f"enable_{notify}_notify", is_enabled=True)
        link.ask("get_motor_thermal_protection_status")
        link.ask("reset_yaw")
        link.ask("reset_locator_x_and_y")
        link.ask("enable_color_detection", is_enabled=True)
        for name, processor, values in streaming(STREAMED, round(1000 * PERIOD)):
            link.ask(name, processor, **values)
        if self._lidar is not None:
            self.facts |= start_lidar(link, self._lidar).words()
        if self._has_hub:
            start_hub(link)
        self._until_all_is_told()

    def sense_anew(self) -> None:
        """Wait for fresh samples of all senses that are needed: others may have come at any time before.

        Raises:
            RobotError: if it is not.
            Stopped: as `attend`.
        """
        self._link.catch_up()
        self._until_all_is_told()

    def _until_all_is_told(self) -> None:
        self.senses.forget()  # what the lines bring while devices are started may be of before
        self._link.answers.forget()
        self._answered.forget()

        def is_told() -> bool:
            now = time.monotonic()
            self._look(now)
            return not self.stale(now)

        self._link.until(is_told, _BEGIN)
        for why in self.stale(time.monotonic()).values():
            raise RobotError(why)

    def _watch_commands_end(self) -> None:
        """Check that a drive command, of speed zero, ends by itself after the time that was set.

        The maker's documents do not say what a robot that was stopped so answers: only if it says that it still drives,
        this is held against it.

        Raises:
            RobotError: if it does, and the settings do not permit that.
        """
        self.brake.drive(0.0, 0.0)
        told = time.monotonic()
        first = self._controller()
        self.attend(told + 0.5 * COMMANDS_END)
        self._link.said.clear()  # what has stopped by then did so because its speed is zero
        self.attend(told + COMMANDS_END + 0.1)
        has_stopped = any(getattr(said, "name", "") == "robot_has_stopped" for said in self._link.said)
        last = self._controller()
        self._do_commands_end = has_stopped or (first, last) == (_TANK, _BRAKING)
        self.facts["commands_end"] = f"seen after {COMMANDS_END:g} s" if self._do_commands_end else "not seen"
        if self._do_commands_end or self._settings.limits.unending_commands or not first == last == _TANK:
            return
        self.attend(told + 2.0 * COMMANDS_END)  # this computer may have been late, or the line
        if self._controller() == _TANK:
            raise RobotError(
                f"rvr: it reports that a drive command does not end after {COMMANDS_END:g} s, so it would drive on if "
                "this program died; update its firmware, or permit this with limits.unending_commands in robot.yaml"
            )

    def _controller(self) -> int | None:
        """The active controller of the RVR's drive; None if it does not answer."""
        try:
            return int(self._link.ask("get_active_control_system_id")["controller_id"])
        except RobotStopped:
            raise
        except RobotError:
            return None

    def _drive_command(self, left: float, right: float) -> bytes:
        return self._link.counted(_DRIVE, left_velocity=left, right_velocity=right)

    def _take(self, event: Event, now: float) -> None:
        if self._link.is_ending:
            return
        self.listen(event, now)
        if self.senses.take(event, now):
            self._note_sight()
        match event:
            case Response():
                if event.error:
                    self.note(f"{event.name} was refused: {words(event.error)}")
                self._heed(event.name, event.values)
                if event.name == _DRIVE and event.error in DAMAGED:
                    self._link.answers.repeated += self.brake.repeat()
                elif event.name == _DRIVE and event.error:
                    port = self._link.port("rvr")
                    raise RobotStopped(
                        f"rvr: it does not drive: {words(event.error)}; switch it off and on (rvr on {port})"
                    )
            case Notification():
                told = [event.name, *(f"{name} {value}" for name, value in event.values.items())]
                self.note(f"rvr: {' '.join(told).replace('_', ' ')}")
                self._heed(event.name, event.values)

    def _note_sight(self) -> None:
        """Note when turns of the lidar begin or cease to be nearly empty, as those of one whose laser fails are."""
        was_blind, self._is_blind = self._is_blind, self.senses.sight < MIN_READINGS
        if was_blind != self._is_blind:
            self.note("lidar: sees nothing" if self._is_blind else "lidar: sees something again")

    def _heed(self, name: str, values: Mapping[str, Any]) -> None:
        """Note what the RVR reports of itself; stop if it reports that it must not drive."""
        if name == "get_battery_percentage" and values:
            before, self.facts["battery"] = self.facts.get("battery"), charge(values["percentage"])
            if before != self.facts["battery"]:
                self.note(f"battery {self.facts['battery']}")
        for text in self._health.take(name, values):
            self.note(text, matters=True)
