"""Options that several verbs have."""

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import click
from click.core import ParameterSource

from mercator_design.command import FILE, NumberRange, naming
from mercator_design.errors import SettingsError
from mercator_design.robot.devices.ports import OPTIONAL_DEVICES
from mercator_design.robot.devices.settings import Settings, read_settings

_VARIABLE = "MERCATOR_ROBOT"
_SETTINGS, _FILE = "settings", "robot"
"""Parameters of verbs that the option --robot becomes."""
DURATION, SEED = NumberRange(0.1, 1e6), click.IntRange(0, 2**63 - 1)
"""Of a run: seconds; of its random draws."""
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
    """The settings in the robot.yaml that a verb was given, or as usual without one."""
    try:
        return Settings() if path is None else read_settings(path)
    except SettingsError as error:
        source = click.get_current_context().get_parameter_source
        if ParameterSource.ENVIRONMENT in map(source, (_SETTINGS, _FILE)):
            raise SettingsError(*(f"{_VARIABLE}: {message}" for message in error.messages)) from None
        raise


def new_file(given: str | None, kind: str, robot: str) -> Path:
    """Where a log is to be: a file, or in a folder, which is made if it ends in a slash, a file of its own.

    Args:
        given: What the user has named; None: this folder.
        kind: Of the log, for its name.
        robot: Whose it is: robots that begin in the same second in the same folder have a file each.
    """
    path = Path(given or "")
    if given is not None and given.endswith("/"):
        with naming(path):
            path.mkdir(parents=True, exist_ok=True)
    name = "-".join([kind, *robot.split(), time.strftime("%Y%m%d-%H%M%S.jsonl")])
    return path / name if path.is_dir() else path


@contextlib.contextmanager
def naming_in_the_end(path: Path, what: str, report: Callable[[str], None]) -> Iterator[Callable[[], bool]]:
    """Say where a file is that was made in this context, whatever ended it; gives whether there is one."""
    existed = path.exists()

    def is_made() -> bool:
        return path.exists() and not existed

    try:
        yield is_made
    finally:
        if is_made():
            report(f"The {what} is {path}")


def _robot(name: str, read: Callable[[Path | None], Any]) -> Callable[[FC], FC]:
    return click.option(
        "--robot",
        name,
        type=FILE,
        envvar=_VARIABLE,
        metavar="ROBOT.yaml",
        callback=lambda _context, _parameter, path: read(path),
        help=f"What is particular to this robot.  [default: ${_VARIABLE}, or a Mercator as usual]",
    )


ROBOT = _robot(_SETTINGS, settings_of)
ROBOT_FILE = _robot(_FILE, lambda path: path)
"""The option of verbs that change the file."""
