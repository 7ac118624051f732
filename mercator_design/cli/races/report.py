"""mdesign report: the report of a race as a page."""

from pathlib import Path

import click

from mercator_design.cli.options import FOLDER, JOBS, PLUGIN
from mercator_design.cli.races.reporting import NO_COMPARISON, latest_report, write_report
from mercator_design.cli.terminal import Interrupt
from mercator_design.command import OUTPUT_FILE, print_message, print_result
from mercator_design.show.report.page import REPORT


@click.command()
@click.argument("directory", type=FOLDER)
@click.option("-o", "--output", type=OUTPUT_FILE, help=f"The page to write.  [default: {REPORT} in DIRECTORY]")
@NO_COMPARISON
@JOBS
@click.option("--follow", is_flag=True, help="Serve the page of a running race on this computer, until the race ends.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port for --follow.  [default: a free one]")
@PLUGIN
def report(
    directory: Path, output: Path | None, no_comparison: bool, jobs: int | None, follow: bool, port: int
) -> None:
    """Write the report of the race in DIRECTORY, which may be running, interrupted or finished.

    The report is one HTML file that needs no network. If the race has ended, its winner is compared with others on the
    fresh instances on which it was tested; the results are kept in the folder, so these experiments run only once.

    With --follow, the page is served at an address of this computer alone, and shows the race while it runs. The
    command ends with the race (exit code 0), or by Ctrl-C (130), which does not end the race.
    """
    if port and not follow:
        raise click.UsageError("--port needs --follow")
    if follow:
        if output is not None or no_comparison:
            raise click.UsageError("--follow writes nothing: it cannot be given with --output or --no-comparison")
        _follow(directory, port)
        return
    output = output or directory / REPORT
    with Interrupt() as interrupt:
        write_report(directory, output, compares=not no_comparison, jobs=jobs, stopped=interrupt.came)
    print_result(output)


def _follow(directory: Path, port: int) -> None:
    from mercator_design.show.report.follow import FollowServer

    with FollowServer(directory, lambda: latest_report(directory), port) as server:
        print_result(server.address)
        server.serve()
    print_message(f"The race of {directory} does not run any more; `mdesign report {directory}` writes its report")
