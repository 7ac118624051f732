"""mercator-robot teleop: drive with the keys of a terminal."""

import contextlib
import sys

import click

from mercator_design.command import NumberRange, OutputFile, print_message
from mercator_design.robot.cli.options import ROBOT, naming_in_the_end, new_file
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.teleop.teleop import HELD, REPEATED
from mercator_design.robot.teleop.teleop import teleop as drive

_SPEED = 0.15
"""[m/s]"""


@click.command(
    help=f"""Drive with the keys of this terminal: arrows or WASD as long as they are held, any other key stops, Q ends.

    The wheels stop {REPEATED} s after the last repetition of a held key, and {HELD} s after a single press. Everything
    that stops a run also ends the drive, and so does the loss of the terminal.
    """,
)
@ROBOT
@click.option(
    "--speed",
    type=NumberRange(0.01, 1.55),
    metavar="M/S",
    help="Speed of the treads, at most limits.speed; half of it in turns.  "
    f"[default: {_SPEED}, or limits.speed if lower]",
)
@click.option(
    "--guard",
    type=NumberRange(0.05, 2.0),
    metavar="METRES",
    help="Do not drive towards anything that a proximity sensor sees nearer than this.",
)
@click.option(
    "-o", "--output", type=OutputFile(), metavar="FILE.jsonl", help="Record sensors and wheels, as `record` does."
)
def teleop(settings: Settings, speed: float | None, guard: float | None, output: str | None) -> None:
    speed = min(_SPEED, settings.limits.speed) if speed is None else speed
    if speed > settings.limits.speed:
        raise click.BadParameter(f"{speed:g} is above limits.speed, {settings.limits.speed:g}", param_hint="--speed")
    if not sys.stdin.isatty():
        raise click.UsageError("teleop needs a terminal, as its keys drive the robot; over ssh: ssh -t")
    path = None if output is None else new_file(output, "drive", settings.name)
    with contextlib.nullcontext() if path is None else naming_in_the_end(path, "recording", print_message):
        drive(settings, speed, guard, path, print_message)
