"""mercator-robot record: record the sensors of the robot at rest."""

import signal
import sys

import click

from mercator_design.command import NumberRange, OutputFile, print_message
from mercator_design.errors import Signalled
from mercator_design.robot.cli.options import ROBOT, naming_in_the_end, new_file
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.teleop.recording import record as write


@click.command()
@ROBOT
@click.option(
    "--duration",
    type=NumberRange(0.1, 1e6),
    metavar="SECONDS",
    help="Duration of the recording.  [default: until Ctrl-C]",
)
@click.option(
    "-o",
    "--output",
    type=OutputFile(),
    metavar="FILE.jsonl",
    help="A new file, or a folder for it.  [default: recording-NAME-DATE-TIME.jsonl]",
)
def record(settings: Settings, duration: float | None, output: str | None) -> None:
    """Record every sample of every sensor, and every turn of the lidar, of the robot at rest.

    The wheels do not turn. `mdesign calibrate` makes the noise of a robot model from such recordings. Without
    --duration, Ctrl-C ends the recording, with exit code 0.
    """
    path = new_file(output, "recording", settings.name)
    with naming_in_the_end(path, "recording", _print) as is_made:
        try:
            write(settings, path, duration, _print, _show)
        except Signalled as signalled:
            is_wrong = hasattr(signalled, "__notes__")  # as if the stop of the RVR is not confirmed
            if is_wrong or not is_made() or duration is not None or signalled.exit_code != 128 + signal.SIGINT:
                raise


def _show(seconds: float, count: int) -> None:
    if sys.stderr.isatty():
        click.echo(f"\r{seconds:.0f} s, {count} samples and turns ", nl=False, err=True)


def _print(message: str) -> None:
    """Print a message in the place of the line of `_show`."""
    if sys.stderr.isatty():
        click.echo(f"\r{'':50}\r", nl=False, err=True)
    print_message(message)
