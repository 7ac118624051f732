"""mdesign watch: follows the race of another process."""

from pathlib import Path

import click

from mercator_design.cli.options import FOLDER, PROGRESS
from mercator_design.cli.terminal import terminal_width
from mercator_design.command import print_message, print_result
from mercator_design.show.text.columns import with_notes_wrapped
from mercator_design.show.text.progress import Mode
from mercator_design.show.text.runs import run_summary
from mercator_design.show.text.watching import follow


@click.command()
@click.argument("directory", type=FOLDER)
@PROGRESS
def watch(directory: Path, progress: Mode) -> None:
    """Follow the race of DIRECTORY, which another process runs, and show its page when it has ended.

    It waits for a race that has not begun, and for one that was interrupted to be resumed. Ctrl-C ends this command
    only, not the race.
    """
    follow(directory, progress, announce=print_message)
    print_result(with_notes_wrapped(run_summary(directory), terminal_width()))
