"""Writes the report of a race: at the end of the race, and by `mdesign report`."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from mercator_design.cli.inputs import ignore
from mercator_design.command import print_note
from mercator_design.errors import RaceError
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.session.task import Task
from mercator_design.results.analysis.proof import Proof, default_runs, prove, read_proof
from mercator_design.results.experiments.winner import run_again
from mercator_design.results.facts import Facts
from mercator_design.results.files import JOURNAL, restored
from mercator_design.show.report.page import MAX_SIZE, REPORT, report_page
from mercator_design.show.text.progress import Display, Mode
from mercator_design.system.files import Unreadable, read_small, write_text, writing

PROOF_RUNS = click.option(
    "--proof-runs",
    type=click.IntRange(0, 10**6),
    metavar="N",
    help="In the report, compare the winner with others on N fresh instances, beyond the budget; 0: do not.  "
    "[default: about 8 % of the budget, but at least 5 and at most 50 instances each]",
)
NO_REPORT = click.option(
    "--no-report", is_flag=True, envvar="MDESIGN_NO_REPORT", help="Do not write report.html into the results' folder."
)


def write_report(
    folder: Path,
    output: Path,
    *,
    task: Task[Any] | None = None,
    proof_runs: int | None = None,
    jobs: int | None = None,
    progress: Mode = "auto",
    stopped: Callable[[], bool] = lambda: False,
) -> None:
    """Write the report of a race, and run the experiments of its proof if they have not run.

    Args:
        folder: The run folder.
        output: The page.
        task: The task, if this process has run the race.
        proof_runs: Number of fresh instances. [default: those of the proof in the folder, else `default_runs`]
        jobs: Experiments run at once. [default: the cores that it may use]
        progress: How to show the progress of experiments.
        stopped: Returns whether to stop; called before each experiment.

    Raises:
        ExecutorStopped: see `stopped`.
        MercatorError: There is no race, an experiment failed, or a file cannot be written.
    """
    announce = print_note if progress != "none" else ignore
    announce(f"Report: reading the race of {folder} ...")
    facts = Facts.read(folder, task=task)
    proof, without = _proof(facts, proof_runs, jobs, progress, stopped, announce, is_own=task is not None)
    if facts.view.is_complete and facts.designer is not None:
        announce("Report: running the winner again, for the replays ...")
    shown = run_again(facts, proof)
    announce(f"Report: finding which {facts.parts} explain the scores, and drawing the page ...")
    page = report_page(facts, shown, proof, without)
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
    return report_page(facts, run_again(facts, None))


def _proof(
    facts: Facts,
    runs: int | None,
    jobs: int | None,
    progress: Mode,
    stopped: Callable[[], bool],
    announce: Callable[[str], None],
    *,
    is_own: bool,
) -> tuple[Proof | None, str]:
    """The proof of a race that has ended, or why there is none."""
    designer, record = facts.designer, facts.record
    if designer is None or not facts.record.is_complete:
        return None, ""
    if runs == 0:
        return None, "The winner was not compared with others on fresh instances; --proof-runs N does that."
    known = read_proof(facts.folder, record)
    if known is not None and runs in {None, len(known.seeds)}:
        return known, ""
    try:
        if not is_own:
            restored(facts.folder)
    except RaceError as error:
        return known, f"The winner was not compared with others on fresh instances: {error.messages[0]}"
    designer.prepare(print_note)
    runs = runs or default_runs(designer, record)
    announce(f"Report: running the winner and others on {runs} fresh instance{'s' * (runs != 1)} ...")
    display = Display("report: comparing the winner", 0, progress)
    with ThreadExecutor(jobs) as executor, display:

        def watch(done: int, total: int) -> None:
            display.show(done, total=total)

        return prove(facts.folder, designer, record, executor, runs=runs, watch=watch, stopped=stopped), ""
