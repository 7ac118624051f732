"""The state of all robots in one table: batteries, lines and clocks."""

import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from mercator_design.config.json_data import from_json
from mercator_design.errors import RobotError
from mercator_design.fleet.deploy import BE_IDLE, PROGRAM, Fleet
from mercator_design.fleet.ssh import RemoteRobot, conversing, hear
from mercator_design.robot.devices.findings import RobotFinding
from mercator_design.robot.protocols.clocks import PROBE, Clock, from_line, probe

COLUMNS = {
    "battery": ("rvr", "battery"),
    "rvr": ("rvr", "line"),
    "lidar": ("lidar", "line"),
    "hub": ("proximity", "line"),
}
"""Column -> device and quantity of the finding of `mercator-robot check` that it shows."""
_MAX_FINDINGS = 100  # on a robot, of which a Mercator has some thirty
_CHECK = f"""
{BE_IDLE}
[ -f robot.yaml ] && export MERCATOR_ROBOT=robot.yaml
exec python3 {PROGRAM} check --json "$@"
"""


@dataclass
class Checked:
    """The findings on a robot."""

    robot: RemoteRobot
    findings: list[RobotFinding] = field(default_factory=list)
    is_done: bool = False  # whether the check has ended
    clock: Clock = field(default_factory=Clock)
    failure: str = ""  # why the check could not run to its end; empty if it did

    def cell(self, column: str) -> str:
        """The text in a column of the table: one of COLUMNS, or `clock`."""
        if self.failure:
            return "?"
        if column == "clock":
            return str(self.clock.difference) if len(self.clock) else "?"
        device, quantity = COLUMNS[column]
        for shown in (quantity, "presence"):
            for found in self.findings:
                if (found.device, found.quantity) == (device, shown):
                    return found.value if found.is_fine else f"{found.value} WRONG"
        return "?"


def check(fleet: Fleet, timeout: float, options: Iterable[str] = ()) -> list[Checked]:
    """Run `mercator-robot check` on all robots at the same time, and compare their clocks with this computer's.

    Args:
        fleet: The robots; they must have the program.
        timeout: Time limit of the whole check [s].
        options: Options of `mercator-robot check`.

    Raises:
        RobotError: if there is no ssh.
    """
    checked = {robot.name: Checked(robot) for robot in fleet.robots}
    end = time.monotonic() + timeout
    with conversing(fleet.robots, _CHECK, [*options]) as robots:
        due = 0.0
        while time.monotonic() < end and not all(robot.has_ended for robot in robots.values()):
            if time.monotonic() >= due:
                due = time.monotonic() + PROBE
                for robot in robots.values():
                    robot.send(probe(time.monotonic()))
            for name, lines in hear(robots, PROBE):
                _take(checked[name], lines or ())
        for name, each in checked.items():
            if not robots[name].has_ended:
                each.failure = f"not done after {timeout:g} s"
            elif not each.is_done:
                each.failure = robots[name].words
    return [*checked.values()]


def _take(checked: Checked, lines: Sequence[bytes]) -> None:
    now = time.monotonic()
    for line in lines:
        said = from_line(line)
        if said is None:
            continue
        match said.pop("say"):
            case "finding":
                _add_finding(checked, said)
            case "done":
                checked.is_done = True
            case "clock":
                with suppress(ValueError):  # further answers will come
                    checked.clock.take(said, now)


def _add_finding(checked: Checked, said: dict[str, Any]) -> None:
    try:
        found = from_json(said, RobotFinding, error=RobotError, path="finding")
    except RobotError as error:
        checked.failure = f"its check sends what is no finding: {error}"
        return
    if len(checked.findings) < _MAX_FINDINGS:
        checked.findings.append(found)
    else:
        checked.failure = f"its check has more than {_MAX_FINDINGS} findings"


def table(checked: Sequence[Checked]) -> Iterator[str]:
    """The rows of the table: a head, and a row for each robot."""
    columns = [*COLUMNS, "clock"]
    rows = [["robot", *columns], *([each.robot.name, *map(each.cell, columns)] for each in checked)]
    widths = [max(map(len, cells)) for cells in zip(*rows, strict=True)]
    for row in rows:
        yield "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()


def wrong(checked: Sequence[Checked]) -> Iterator[str]:
    """Each fault with its remedy, a row each."""
    for each in checked:
        if each.failure:
            yield f"{each.robot.name}: {each.failure}"
        for found in each.findings:
            if not found.is_fine:
                yield f"{each.robot.name}: {found.what}: {found.words}"


def unclear(checked: Sequence[Checked]) -> Iterator[str]:
    """Each finding that a person has to judge, a row each; it prevents no start."""
    for each in checked:
        for found in each.findings:
            if found.is_fine and found.is_unclear:
                yield f"{each.robot.name}: {found.what}: {found.words}"
