"""A recording: all measurements of a robot's devices, with the time since its start [s].

It is written and read as the log of a run (log.py):

    start   the robot, facts on its devices, the settings of its sensors
    sample  time and values of a sensor, by its name in samples.py; a distance, without correction by offsets, is null
            where nothing is in sight, and 0 where something is too near
    turn    a turn of the lidar: the time when its last packet had come, and its readings, angle [rad, from the robot's
            front] and range [m] of each, 0 where nothing came back; and its packets, as in a run (turns.py)
    wheels  in a drive: the speeds that were sent to the treads, left and right [m/s]
    note    a note on a device, a sensor that has fallen silent, or a delay of the program
    end     why the recording ended
"""

import math
import time
from collections.abc import Callable
from pathlib import Path

from mercator_design.robot.devices.link import Heard
from mercator_design.robot.devices.samples import SERVICE_OF, converted
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.logs.events import RecordingStarted, SampleTaken, TurnTaken, WheelsDriven
from mercator_design.robot.logs.log import Log, plain
from mercator_design.robot.logs.turns import readings, times_and_angles
from mercator_design.robot.protocols.ydlidar import Packet, PacketTurns
from mercator_design.robot.run.control import held_up, in_control
from mercator_design.robot.run.mercator import Mercator
from mercator_design.robot.run.safety import STALL
from mercator_design.robot.run.senses import DEVICE_OF

_CHECK_EVERY = 0.1  # [s] between checks of the devices


class Recorder:
    """Writes a robot's measurements to a log.

    count: Number of samples and turns.
    """

    def __init__(self, log: Log, robot: Mercator, settings: Settings) -> None:
        self._log, self._turns, self._front = log, PacketTurns(), settings.lidar_angle
        self.count = 0
        start = RecordingStarted(
            robot=settings.name,
            facts=dict(robot.facts),
            proximity_angles=settings.proximity_angles,
            proximity_offsets=settings.proximity_offsets,
            lidar_angle=settings.lidar_angle,
        )
        log.begin(start)

    def note_wheels(self, now: float, left: float, right: float) -> None:
        """Write the speeds [m/s] that were sent to the wheels at a time [s, of time.monotonic()]."""
        self._log.note(WheelsDriven(time=self._since_start(now), left=left, right=right))

    def _since_start(self, now: float) -> float:
        return round(now - self._log.began, 4)

    def note_heard(self, heard: list[Heard]) -> None:
        """Take events of devices out of a list, and write their measurements."""
        while heard:
            event, now = heard.pop(0)
            if now < self._log.began:
                continue
            for name, values in converted(event):
                self.count += 1
                sample = SampleTaken(time=self._since_start(now), sensor=name, values=tuple(map(plain, values)))
                self._log.note(sample)
            if isinstance(event, Packet) and (turn := self._turns.receive(event, self._since_start(now))):
                self.count += 1
                found = readings((packet for packet, _ in turn), self._front)
                _, end = turn[-1]
                self._log.note(TurnTaken(time=end, readings=found, packets=times_and_angles(turn)))


def record(
    settings: Settings,
    path: Path,
    duration: float | None,
    report: Callable[[str], None],
    show: Callable[[float, int], None],
) -> None:
    """Record a robot at rest.

    Args:
        settings: The robot's settings.
        path: The recording, a new file.
        duration: Duration [s]; None: until something stops it.
        report: Called with messages for people.
        show: Called regularly with the time [s] and the number of samples and turns so far.

    Raises:
        RobotError, RobotStopped, Signalled: as `in_control`.
    """
    log = Log(path)
    with in_control(settings, DEVICE_OF, {}, log, extra=SERVICE_OF) as control:
        robot = control.robot
        recorder = Recorder(log, robot, settings)
        robot.notes.send_to(log.remark, report)
        begin = now = time.monotonic()
        robot.introduce(report)
        end = math.inf if duration is None else begin + duration
        silent: dict[str, str] = {}
        while now < end:
            due = min(now + _CHECK_EVERY, end)
            try:
                now = control.wait(due)
            finally:
                recorder.note_heard(control.heard)
            before, silent = silent, robot.stale(now)
            warnings = [silent[name] for name in silent.keys() - before.keys()]
            if now - due > STALL:  # for example suspended: events of that time have the present time, or are lost
                warnings.append(held_up(now - due))
            for warning in warnings:
                report(f"Warning: {warning}")
                log.remark(warning)
            robot.query()
            show(now - begin, recorder.count)
