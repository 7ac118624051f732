"""Options that several verbs have."""

from pathlib import Path

import click

from mercator_design.command import FILE
from mercator_design.robot.settings import Settings, read_settings


def _read(_context: click.Context, _: click.Parameter, path: Path | None) -> Settings:
    return Settings() if path is None else read_settings(path)


ROBOT = click.option(
    "--robot",
    "settings",
    type=FILE,
    envvar="MERCATOR_ROBOT",
    metavar="ROBOT.yaml",
    callback=_read,
    help="What is particular to this robot.  [default: $MERCATOR_ROBOT, or a Mercator as usual]",
)
