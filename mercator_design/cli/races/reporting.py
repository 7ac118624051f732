"""Writes the report of a race: at the end of the race, and by `mdesign report`."""

import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from mercator_design.cli.inputs import ignore
from mercator_design.command import print_note
from mercator_design.errors import RaceError
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.session.record import Record
from mercator_design.race.session.task import Task
from mercator_design.results.analysis.comparison import (
    MAX_OTHERS,
    TEST_RUNS,
    WinnerComparison,
    compare_winner,
    read_comparison,
    winner_tests,
)
from mercator_design.results.experiments.winner import run_again
from mercator_design.results.facts import Facts
from mercator_design.results.files import JOURNAL, restored
from mercator_design.show.report.page import MAX_SIZE, REPORT, report_page
from mercator_design.show.text.progress import Display, Mode
from mercator_design.system.files import Unreadable, read_small, write_text, writing

NO_COMPARISON = click.option(
    "--no-comparison",
    is_flag=True,
    help="In the report, do not compare the winner with others: experiments on its test instances, beyond the budget.",
)
NO_REPORT = click.option(
    "--no-report/--report",
    envvar="MDESIGN_NO_REPORT",
    help="Do not write report.html into the results' folder; or write it, whatever MDESIGN_NO_REPORT says.",
)


def write_report(
    folder: Path,
    output: Path,
    *,
    task: Task[Any] | None = None,
    record: Record | None = None,
    compares: bool = True,
    jobs: int | None = None,
    progress: Mode = "auto",
    stopped: Callable[[], bool] = lambda: False,
) -> None:
    """Write the report of a race, and run the experiments of its comparison if they have not run.

    Args:
        folder: The run folder.
        output: The page.
        task: The task, if this process has run the race.
        record: The record, in the same case; else the journal is read.
        compares: Whether to compare the winner with others on the fresh instances of its tests.
        jobs: Experiments run at once. [default: the cores that it may use]
        progress: How to show the progress of experiments.
        stopped: Returns whether to stop; called before each experiment.

    Raises:
        ExecutorStopped: see `stopped`.
        MercatorError: There is no race, an experiment failed, or a file cannot be written.
    """
    announce = print_note if progress != "none" else ignore
    if record is None:
        announce(f"Report: reading the race of {folder} ...")
    facts = Facts.read(folder, task=task, record=record)
    comparison, without = _comparison(facts, compares, jobs, progress, stopped, announce, is_own=task is not None)
    if facts.view.is_complete and facts.designer is not None:
        announce("Report: running the winner again, for the replays ...")
    shown = run_again(facts)
    announce(f"Report: finding which {facts.parts} explain the scores, and drawing the page ...")
    page = report_page(facts, shown, comparison, without)
    with writing(output):
        write_text(output, page)


def latest_report(folder: Path) -> str:
    """The report that the race has written; if there is none, a new one, for which no experiments run.

    Raises:
        MercatorError: There is no race.
    """
    written = folder / REPORT
    try:
        if written.stat().st_mtime >= (folder / JOURNAL).stat().st_mtime:
            return read_small(written, MAX_SIZE).decode()
    except (OSError, Unreadable, UnicodeDecodeError):  # then it is made anew
        pass
    facts = Facts.read(folder)
    return report_page(facts, run_again(facts))


def _comparison(
    facts: Facts,
    compares: bool,
    jobs: int | None,
    progress: Mode,
    stopped: Callable[[], bool],
    announce: Callable[[str], None],
    *,
    is_own: bool,
) -> tuple[WinnerComparison | None, str]:
    """The comparison of a race that has ended, or why there is none."""
    designer, record = facts.designer, facts.record
    if designer is None or not record.is_complete:
        return None, ""
    without = "The winner was not compared with others on fresh instances"
    if not (tests := winner_tests(record)):
        again = shlex.join(["mdesign", "race", "--resume", str(facts.named), "--test-runs", str(TEST_RUNS)])
        return None, f"{without}, because it was not tested on any: {again}"
    if not compares:
        return None, f"{without}: {facts.command()} does that."
    if (known := read_comparison(facts.folder, record)) is not None:
        return known, ""
    try:
        if not is_own:
            restored(facts.folder)
    except RaceError as error:
        return None, f"{without}: {error.messages[0]}"
    designer.prepare(print_note)
    n = min(len(tests), MAX_OTHERS)
    announce(f"Report: comparing the winner with others on {n} fresh instance{'s' * (n != 1)} ...")
    display = Display("report: comparing the winner", 0, progress)
    with ThreadExecutor(jobs) as executor, display:

        def watch(done: int, total: int) -> None:
            display.show(done, total=total)

        return compare_winner(facts.folder, designer, record, executor, watch=watch, stopped=stopped), ""
