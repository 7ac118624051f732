"""mercator-robot record: what the robot's sensors measure while it stands."""

import signal
import sys
import time
from pathlib import Path

import click

from mercator_design.command import FILE, Signalled, tell
from mercator_design.robot.cli.options import ROBOT
from mercator_design.robot.recording import record as write
from mercator_design.robot.settings import Settings


@click.command()
@ROBOT
@click.option("--duration", type=click.FloatRange(0.1, 1e6), metavar="SECONDS", help="[default: until Ctrl-C]")
@click.option(
    "-o", "--output", "path", type=FILE, metavar="FILE.jsonl", help="A new file.  [default: recording-DATE-TIME.jsonl]"
)
def record(settings: Settings, duration: float | None, path: Path | None) -> None:
    """Record every sample of every sensor, and every turn of the lidar, of the robot at rest.

    The wheels are not turned. `mdesign calibrate` makes a robot model's noise of such recordings. Without --duration
    Ctrl-C is the end to be expected, with exit code 0.
    """
    path = path or Path(time.strftime("recording-%Y%m%d-%H%M%S.jsonl"))
    existed = path.exists()
    try:
        write(settings, path, duration, _tell, _show)
    except Signalled as signalled:
        is_recorded = path.exists() and not existed
        if not is_recorded or duration is not None or signalled.exit_code != 128 + signal.SIGINT:
            raise
    _tell(f"The recording is {path}")


def _show(seconds: float, count: int) -> None:
    if sys.stderr.isatty():
        click.echo(f"\r{seconds:.0f} s, {count} samples and turns ", nl=False, err=True)


def _tell(message: str) -> None:
    """Say something in the place of what `_show` has written."""
    if sys.stderr.isatty():
        click.echo(f"\r{'':50}\r", nl=False, err=True)
    tell(message)
