"""mercator-robot check: find faults of the robot, and what to do."""

import contextlib
from collections.abc import Iterable

import click

from mercator_design.errors import RobotError
from mercator_design.robot.cli.options import ROBOT, WITHOUT, show
from mercator_design.robot.devices.findings import RobotFinding
from mercator_design.robot.devices.ports import DeviceName
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.protocols.clocks import answer, day_of, from_line, to_line
from mercator_design.robot.run.channel import Channel
from mercator_design.robot.run.safety import Signals
from mercator_design.robot.setup.check import check as findings


@click.command()
@ROBOT
@click.option(
    "--json",
    "as_json",
    is_flag=True,
    help="Print a line of JSON for each finding and one at the end, and answer requests on stdin that compare the "
    "clocks; for `mdesign deploy --check`.",
)
@WITHOUT
def check(settings: Settings, as_json: bool, without: tuple[DeviceName, ...]) -> None:
    """Check the clock, the console, and each device by itself; print faults and what to do.

    The wheels do not turn; the lidar turns for some seconds. Exit code 1 if there is a fault.
    """
    with Signals().caught(), contextlib.closing(findings(settings, without)) as found:
        (_print if as_json else show)(found)


def _print(found: Iterable[RobotFinding]) -> None:
    def receive(lines: Iterable[bytes] | None, now: float) -> None:
        for line in lines or ():
            said = from_line(line)
            if said is not None and said["say"] == "probe":
                channel.write(answer(said, now, day_of(now)) or "")

    channel = Channel(receive)
    wrong = 0
    with channel:
        for finding in found:
            wrong += not finding.is_fine
            if not channel.write(to_line("finding", **finding._asdict())):
                raise RobotError("the output is closed")
        channel.write(to_line("done"))
    if wrong:
        raise RobotError(f"{wrong} wrong")
