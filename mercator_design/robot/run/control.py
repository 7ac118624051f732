"""Control of a robot: start it up, watch it, and stop it on every way out."""

import contextlib
import math
import time
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

from mercator_design.config.colours import RGB, ColourName
from mercator_design.errors import RobotError, RobotStopped
from mercator_design.robot.devices.ports import DeviceName, open_ports
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.logs.log import Log
from mercator_design.robot.run.mercator import Mercator
from mercator_design.robot.run.monitor import Note
from mercator_design.robot.run.safety import STALL, Signals, Watchdog, raise_priority

if TYPE_CHECKING:
    from mercator_design.robot.devices.link import Heard

FIRST_HEARTBEAT = 5.0  # [s] of waiting for it
_NOTE_EVERY = 10.0  # [s] between notes on refused heartbeats


class Control:
    """Control of a robot.

    robot: The robot.
    heard: Events of its devices in the latest `wait`, also if it raised an error.
    """

    def __init__(self, robot: Mercator, watchdog: Watchdog, log: Log | None) -> None:
        self.robot, self._watchdog, self._log = robot, watchdog, log
        self.heard: list[Heard] = []
        self._heard, self._late = time.monotonic(), 0.0
        self._refused, self._noted = 0, -math.inf  # heartbeats; time of the latest note on them

    def start(self) -> None:
        """Start the robot up; errors are those of `Mercator.start`."""
        self.robot.start()
        self._heard = time.monotonic()

    def await_heartbeat(self) -> None:
        """Wait for the first heartbeat, if the settings want heartbeats.

        Raises:
            RobotError: if none comes, or as `wait`.
        """
        end = time.monotonic() + FIRST_HEARTBEAT
        while self._watchdog.awaits_heartbeat:
            if time.monotonic() > end:
                beats = self._watchdog.heartbeats
                refused = f" ({beats.refused} were refused: {beats.why})" if beats.refused else ""
                raise RobotError(
                    f"swarm: no heartbeat{refused}; is `mercator-robot heartbeat` running, and can it reach this "
                    "robot? If this robot has a key, it needs the same"
                )
            self.wait(time.monotonic() + 0.1)

    def refresh(self) -> None:
        """Wait for fresh samples if the program has not read the devices for a while, as when it waited for its user.

        Raises:
            RobotError: if a sensor that is needed sends nothing new, or as `wait`.
        """
        late = max(self._late, time.monotonic() - self._heard)
        if late > STALL:
            self.robot.sense_anew()
            if self._log is not None and math.isfinite(self._log.began):
                self._log.remark(held_up(late))
        self._heard, self._late = time.monotonic(), 0.0

    def arm(self) -> None:
        """As `await_heartbeat` and `refresh`; from now on commands to the wheels, and heartbeats, must be regular."""
        self.await_heartbeat()
        self.refresh()
        self._watchdog.arm()

    def wait(self, until: float) -> float:
        """Read the devices until a time [s, of time.monotonic]; return the time afterwards.

        Raises:
            RobotStopped: if the wheels were stopped, a device reports that they must not turn, or a port is lost.
            RobotError: if the log cannot be written.
        """
        begin = time.monotonic()
        self.heard = []
        self.robot.attend(until, self.heard)
        now = time.monotonic()
        self._late = max(self._late, begin - self._heard, now - max(begin, until))
        if self.robot.brake.why:
            raise RobotStopped(self.robot.brake.why)
        if self._log is not None and self._log.failure:
            raise RobotError(self._log.failure)
        self._heard = now
        if now - self._noted > _NOTE_EVERY:
            self.note_refused()
        return now

    def note_refused(self) -> None:
        """Note the number of refused heartbeats if it has grown since the last note."""
        beats = self._watchdog.heartbeats
        if beats.refused > self._refused:
            self._refused, self._noted = beats.refused, time.monotonic()
            found = f"{beats.refused} heartbeats refused, the last from {self._watchdog.refused_from}: {beats.why}"
            self.robot.notes.add(Note(f"swarm: {found}", matters=True))

    def cycles(self, period: float, first: float | None = None) -> Iterator[float]:
        """The starts [s, of time.monotonic] of control cycles, without end; a late cycle delays the next ones.

        Args:
            period: Time from one cycle to the next [s].
            first: Time of the first cycle [s]; None: at once.

        Raises:
            RobotStopped, RobotError: as `wait`.
        """
        due = time.monotonic() if first is None else first
        while True:
            yield self.wait(due)
            due = max(due + period, time.monotonic())


def held_up(seconds: float) -> str:
    """The note on a time in which the program did not read the devices."""
    return f"held up for {seconds:.1f} s: samples are missing, or have wrong times"


@contextlib.contextmanager
def in_control(
    settings: Settings,
    reads: Iterable[str],
    labels: Mapping[ColourName, RGB],
    log: Log | None,
    without: Collection[DeviceName] = (),
    extra: Collection[str] = (),
) -> Iterator[Control]:
    """Start a robot up and control it; its watchdog is not armed yet.

    On the way out the wheels stop first; then the robot is shut down, and the log ends.

    Args:
        settings: The robot's settings.
        reads: The senses that are needed, of modules.SENSES.
        labels: What the ground sensor reads on each colour of the floor.
        log: The log; its first event is written by the caller, after the start-up.
        without: Devices that are not used.
        extra: Further sensors of the RVR, of samples.FIELDS, which it streams if it can.

    Raises:
        RobotStopped: if something stopped the wheels, naming it.
        RobotError: if a device cannot be used, the log cannot be written, or the stop of the RVR is not
            confirmed; other exceptions have the latter two as notes.
        Signalled: if a signal came.
    """
    raise_priority(1)
    signals = Signals()
    with signals.caught(), log or contextlib.nullcontext(), open_ports(settings.ports, without) as ports:
        robot = Mercator(settings, ports, reads, labels, extra)
        signals.guard(robot.brake)
        watchdog = Watchdog(robot.brake, settings.swarm, settings.name)
        control = Control(robot, watchdog, log)
        try:
            # Nothing interrupts what is done after `until_stopped`; a signal in an `ExitStack` could skip that.
            with watchdog, contextlib.closing(robot), signals.until_stopped():
                control.start()
                yield control
        except BaseException as error:
            if robot.stop_failure:
                error.add_note(robot.stop_failure)
            raise
        finally:
            control.note_refused()
    if wrong := "; ".join(filter(None, (log.failure if log is not None else "", robot.stop_failure))):
        raise RobotError(wrong)
