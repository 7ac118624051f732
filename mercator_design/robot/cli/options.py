"""Options of several verbs, and their output."""

import contextlib
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import click
from click.core import ParameterSource

from mercator_design.command import FILE, NumberRange, print_result
from mercator_design.errors import RobotError, SettingsError, printable
from mercator_design.robot.devices.findings import RobotFinding
from mercator_design.robot.devices.ports import OPTIONAL_DEVICES
from mercator_design.robot.devices.settings import Settings, read_settings
from mercator_design.system.files import writing

_VARIABLE = "MERCATOR_ROBOT"
_SETTINGS, _FILE = "settings", "robot"
"""Parameters of verbs for the option --robot."""
DURATION, SEED = NumberRange(0.1, 1e6), click.IntRange(0, 2**63 - 1)
"""Types of a run's duration [s], and of the seed of its random draws."""
FC = TypeVar("FC", bound=Callable[..., Any])

WITHOUT = click.option(
    "--without",
    type=click.Choice(OPTIONAL_DEVICES),
    multiple=True,
    callback=lambda _context, _parameter, devices: tuple(dict.fromkeys(devices)),
    help="Do not use this device, for example because it is broken. A run refuses if its PFSM needs the device. "
    "May be repeated.",
)


def settings_of(path: Path | None) -> Settings:
    """The settings in a robot.yaml, or the usual ones without it."""
    try:
        return Settings() if path is None else read_settings(path)
    except SettingsError as error:
        source = click.get_current_context().get_parameter_source
        if ParameterSource.ENVIRONMENT in map(source, (_SETTINGS, _FILE)):
            raise SettingsError(*(f"{_VARIABLE}: {message}" for message in error.messages)) from None
        raise


def new_file(given: str | None, kind: str, robot: str) -> Path:
    """The path of a new log: a file, or a file with a name of its own in a folder, which is made if it ends in a slash.

    Args:
        given: The path that the user has given; None: this folder.
        kind: Kind of the log, for its name.
        robot: Name of the robot: robots that begin in the same second in the same folder have a file each.
    """
    path = Path(given or "")
    if given is not None and given.endswith("/"):
        with writing(path):
            path.mkdir(parents=True, exist_ok=True)
    name = "-".join([kind, *robot.split(), time.strftime("%Y%m%d-%H%M%S.jsonl")])
    return path / name if path.is_dir() else path


@contextlib.contextmanager
def naming_in_the_end(path: Path, what: str, report: Callable[[str], None]) -> Iterator[Callable[[], bool]]:
    """Report the path of a file made in this context, however it ends; yield a function that says if there is one."""
    existed = path.exists()

    def is_made() -> bool:
        return path.exists() and not existed

    try:
        yield is_made
    finally:
        if is_made():
            report(f"The {what} is {path}")


def _robot(name: str, read: Callable[[Path | None], Any], what: str = "Settings of this robot.") -> Callable[[FC], FC]:
    return click.option(
        "--robot",
        name,
        type=FILE,
        envvar=_VARIABLE,
        metavar="ROBOT.yaml",
        callback=lambda _context, _parameter, path: read(path),
        help=f"{what}  [default: ${_VARIABLE}, or default settings]",
    )


ROBOT = _robot(_SETTINGS, settings_of)
ROBOT_OF_SENDER = _robot(_SETTINGS, settings_of, "File with the port and key of the heartbeats.")
ROBOT_FILE = _robot(_FILE, lambda path: path)
"""The option of verbs that change the file."""


def show(findings: Iterable[RobotFinding]) -> None:
    """Print a row for each finding as it comes; go on if a row cannot be written.

    Raises:
        OSError: in the end, if a row was not written.
        RobotError: in the end, if there is a fault.
    """
    wrong, unwritten = 0, None
    for finding in findings:
        wrong += not finding.is_fine
        mark = ("look " if finding.is_unclear else "ok   ") if finding.is_fine else "WRONG"
        row = f"{mark}  {finding.what:<26} {finding.words}"
        try:
            print_result(printable(row))
        except OSError as error:
            unwritten = error
    if unwritten is not None:
        raise unwritten
    if wrong:
        raise RobotError(f"{wrong} wrong")
