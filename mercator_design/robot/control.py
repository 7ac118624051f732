"""A robot under control: started up, watched, and stopped on every way out."""

import contextlib
import time
from collections.abc import Iterable, Iterator, Mapping

from mercator_design.colours import RGB, ColourName
from mercator_design.errors import RobotError
from mercator_design.robot.log import Log
from mercator_design.robot.mercator import Mercator
from mercator_design.robot.ports import open_ports
from mercator_design.robot.safety import Signals, Watchdog, go_first
from mercator_design.robot.settings import Settings

_FIRST_HEARTBEAT = 5.0  # [s] to wait for it


@contextlib.contextmanager
def in_control(
    settings: Settings, reads: Iterable[str], labels: Mapping[ColourName, RGB], log: Log | None
) -> Iterator[tuple[Mercator, Watchdog]]:
    """Take control of a robot: the robot, and the watchdog, which is not armed yet.

    On the way out the wheels stop first; then the log ends, and the robot is shut down.

    Args:
        settings: The robot.
        reads: The senses that are needed, of modules.SENSES.
        labels: What the ground sensor reads on each colour of the floor.
        log: Of what is done, begun once the robot is started up.

    Raises:
        Stopped: if something stopped the wheels, with what it was.
        RobotError: if a device cannot be used, or the log cannot be written.
        Signalled: if a signal came.
    """
    go_first(1)
    signals = Signals()
    with signals.caught(), open_ports(settings.ports) as ports:
        robot = Mercator(settings, ports, reads, labels)
        signals.brake = robot.brake
        watchdog = Watchdog(robot.brake, settings.swarm, settings.name)
        with watchdog, robot, log or contextlib.nullcontext(), signals.until_stopped():
            yield robot, watchdog
    if log is not None and log.failure:
        raise RobotError(log.failure)


def arm(settings: Settings, robot: Mercator, watchdog: Watchdog) -> None:
    """From now on commands to the wheels must follow each other, and heartbeats, if the settings want them.

    Raises:
        RobotError: if no first heartbeat comes, or as the robot's `attend`.
    """
    end = time.monotonic() + _FIRST_HEARTBEAT
    while settings.swarm.heartbeat is not None and watchdog.heard is None:
        if time.monotonic() > end:
            raise RobotError("swarm: no heartbeat; is `mercator-robot heartbeat` running, and can it reach this robot?")
        robot.attend(time.monotonic() + 0.1)
    watchdog.arm()
