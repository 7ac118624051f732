"""A robot under control: started up, watched, and stopped on every way out."""

import contextlib
from collections.abc import Iterable, Iterator, Mapping

from mercator_design.colours import RGB, ColourName
from mercator_design.errors import RobotError
from mercator_design.robot.log import Log
from mercator_design.robot.mercator import Mercator
from mercator_design.robot.ports import open_ports
from mercator_design.robot.safety import Signals, Watchdog, go_first
from mercator_design.robot.settings import Settings


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
