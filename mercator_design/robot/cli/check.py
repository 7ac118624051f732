"""mercator-robot check: what is wrong with the robot, and what to do."""

import click

from mercator_design.robot.check import check as findings
from mercator_design.robot.cli.options import ROBOT
from mercator_design.robot.cli.rows import show
from mercator_design.robot.settings import Settings


@click.command(short_help="Look for what is wrong with this robot.")
@ROBOT
def check(settings: Settings) -> None:
    """Look at the clock, the console, and each device by itself, and say what is wrong and what to do.

    The wheels are not touched; the lidar turns for some seconds. Exit code 1 if something is wrong.
    """
    show(findings(settings))
