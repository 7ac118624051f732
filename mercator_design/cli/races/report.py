"""mdesign report: the report of a race as a page."""

from pathlib import Path

import click

from mercator_design.cli.options import FOLDER, JOBS, PLUGIN
from mercator_design.cli.races.reporting import PROOF_RUNS, write_report
from mercator_design.cli.terminal import Interrupt
from mercator_design.command import OUTPUT_FILE, print_result
from mercator_design.race.running.executors import ExecutorStopped
from mercator_design.report.page.page import REPORT


@click.command(short_help="Write the report of a race as a page.")
@click.argument("directory", type=FOLDER)
@click.option("-o", "--output", type=OUTPUT_FILE, help=f"The page to write.  [default: {REPORT} in DIRECTORY]")
@PROOF_RUNS
@JOBS
@PLUGIN
def report(directory: Path, output: Path | None, proof_runs: int | None, jobs: int | None) -> None:
    """Write the report of the race in DIRECTORY, which may be running, interrupted or finished.

    The report is one HTML file that needs no network. If the race has ended, its winner is compared with others on
    fresh instances; the results are kept in the folder, so these experiments run only once.
    """
    output = output or directory / REPORT
    with Interrupt() as interrupt:
        try:
            write_report(directory, output, proof_runs=proof_runs, jobs=jobs, stopped=interrupt.came)
        except ExecutorStopped:
            interrupt.check("interrupted")
            raise
    print_result(output)
