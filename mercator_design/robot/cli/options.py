"""Options that several verbs have."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from mercator_design.command import FILE
from mercator_design.robot.settings import Settings, read_settings

FC = TypeVar("FC", bound=Callable[..., Any])


def settings_of(path: Path | None) -> Settings:
    """The settings in a robot.yaml, or as usual without one."""
    return Settings() if path is None else read_settings(path)


def _robot(name: str, read: Callable[[Path | None], Any]) -> Callable[[FC], FC]:
    return click.option(
        "--robot",
        name,
        type=FILE,
        envvar="MERCATOR_ROBOT",
        metavar="ROBOT.yaml",
        callback=lambda _context, _parameter, path: read(path),
        help="What is particular to this robot.  [default: $MERCATOR_ROBOT, or a Mercator as usual]",
    )


ROBOT = _robot("settings", settings_of)
ROBOT_FILE = _robot("robot", lambda path: path)
"""The option of verbs that change the file."""
