"""mdesign study run: runs a study, or what is new in it."""

import gc
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click

from mercator_design.cli.inputs import warn_of_mission, warn_of_no_effect
from mercator_design.cli.options import FOLDER, PLUGIN, PROGRESS
from mercator_design.cli.races.common import NOTICE, ON_FAILURE, report_kept
from mercator_design.cli.races.executors import EXECUTOR, executor_of
from mercator_design.cli.races.reporting import NO_REPORT
from mercator_design.cli.study.report import write_results
from mercator_design.cli.study.texts import StudyDisplay, estimate_text, status_text
from mercator_design.cli.terminal import Interrupt, command_line
from mercator_design.command import FILE, print_note, print_result, warn
from mercator_design.race.executors.executor import Executor, ExecutorLost, ExecutorStopped, WorkerUnfit
from mercator_design.race.session.outcome import OnFailure
from mercator_design.show.text.progress import Mode
from mercator_design.studies.estimate import estimated
from mercator_design.studies.folder import FACTS, Part, StudyFolder
from mercator_design.studies.plan import StudyPlan, load_plan
from mercator_design.studies.reading import read_status
from mercator_design.studies.resolving import Study, resolve
from mercator_design.studies.running import StudyRun
from mercator_design.studies.statistics.comparison import MIN_DESIGNS


class PartOf(click.ParamType):  # type: ignore[type-arg]  # has no argument in click before 8.2
    """A part of a study: its number and the number of parts, as 3/20."""

    name = "K/N"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Part:  # noqa: ANN401
        if isinstance(value, Part):
            return value
        number, _, n_parts = str(value).partition("/")
        if number.isdecimal() and n_parts.isdecimal() and 1 <= int(number) <= int(n_parts):
            return Part(int(number), int(n_parts))
        raise click.BadParameter(f"expected K/N with K from 1 to N, as 3/20, found '{value}'", ctx, param)


@click.command()
@click.argument("study", type=FILE)
@click.option("-o", "--output", type=FOLDER, help="Folder of the study.  [default: studies/NAME]")
@click.option(
    "--part",
    type=PartOf(),
    metavar="K/N",
    help="Run only the K-th of N parts of the cells: each array task of a cluster has its own. The last one that ends "
    "writes the page.",
)
@click.option(
    "--dry-run",
    is_flag=True,
    help="Run nothing: say what would run, and how long, by a few experiments of each mission.",
)
@click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Override a key of the study, e.g. budgets=[500] or repetitions=3. May be repeated.",
)
@EXECUTOR
@ON_FAILURE
@PLUGIN
@NO_REPORT
@PROGRESS
def run(
    study: Path,
    output: Path | None,
    part: Part | None,
    dry_run: bool,
    overrides: tuple[str, ...],
    jobs: int | None,
    executor_name: str,
    scheduler: str | None,
    timeout: float | None,
    on_failure: OnFailure,
    no_report: bool,
    progress: Mode,
) -> None:
    """Run the races of STUDY, and assess their designs; then write the page, tables and figures.

    STUDY is a YAML file, or the name of a shipped study.

    Each design is a race in a run folder of its own, below cells/ in the study's folder. The same command resumes a
    study that was interrupted, whatever interrupted it, and runs what is new in its file: repetitions, methods,
    missions, budgets, realities, instances.
    """
    plan = load_plan(study, overrides)
    resolved = checked_study(plan)
    executor = executor_of(executor_name, jobs, scheduler, timeout)
    folder = output or Path("studies") / plan.name
    if dry_run:
        with ExitStack() as closing:
            closing.push(executor)  # not entered, as its workers need not begin
            print_result(_dry_run(resolved, folder, part, executor.jobs))
        return
    run_study(
        resolved,
        folder,
        executor,
        part=part,
        executor_name=executor_name,
        on_failure=on_failure,
        reports=not no_report,
        progress=progress,
        again=command_line(),
    )


def checked_study(plan: StudyPlan) -> Study:
    """Read what a plan names, and warn of what is probably a mistake.

    Raises:
        StudyError: see `resolve`.
    """
    study = resolve(plan)
    for mission in study.missions.values():
        warn_of_mission(mission.simulator, refuse=False)
        for flavour in {method.flavour: None for method in study.methods.values() if not method.made}:
            warn_of_no_effect(mission.simulator, flavour)
    if 0 < study.layout.repetitions < MIN_DESIGNS:
        warn(
            f"{plan.where('repetitions')}: one design of each method on a mission gives no statistics: there is no "
            "spread between designs; expected 2 or more, in publications 10 or 20"
        )
    for name, method in study.methods.items():
        if 0 < len(method.made) < MIN_DESIGNS and len(study.methods) > 1:
            warn(
                f"{plan.where(f'methods.{name}')}: one design is drawn, but not tested, as the unit is the design; "
                "expected 2 files or more for a comparison"
            )
    return study


def run_study(
    study: Study,
    path: Path,
    executor: Executor,
    *,
    part: Part | None,
    executor_name: str,
    on_failure: OnFailure,
    reports: bool,
    progress: Mode,
    again: str,
) -> None:
    """Run the cells of a study, or a part of them, and write its results if all are done; `again` resumes it."""
    layout = study.layout
    cells = layout.cells if part is None else layout.part(part.number, part.n_parts)
    with StudyFolder.open(path, study, part) as folder, Interrupt(then=executor.stop, notice=NOTICE) as interrupt:
        gc.freeze()  # what was imported stays: else a full collection looks through it while all workers wait
        try:
            with executor, StudyDisplay(study.plan.name, 0, progress) as display:
                StudyRun(
                    study,
                    folder,
                    executor,
                    cells=cells,
                    executor_name=executor_name,
                    on_failure=on_failure,
                    announce=print_note,
                    watch=display.note,
                    stopped=interrupt.came,
                ).run()
        except (ExecutorStopped, ExecutorLost, WorkerUnfit) as error:
            report_kept(error, interrupt, path, f"{read_status(path).done} experiments", again)
            raise
        status = read_status(path)
        print_result(status_text(status, layout))
        if status.is_done and reports:
            write_results(path)
        elif not status.is_done:
            print_note("Note: the page and the tables are written when the other parts have ended")


def _dry_run(study: Study, path: Path, part: Part | None, jobs: int) -> str:
    layout = study.layout
    cells = layout.cells if part is None else layout.part(part.number, part.n_parts)
    known = read_status(path, layout).cells if (path / FACTS).exists() else ()
    left = {cell: layout.n_experiments(cell) for cell in cells}
    left |= {one.cell: one.total - one.done for one in known if one.cell in left}
    return estimate_text(study.plan.name, layout, estimated(study, left, jobs, announce=print_note), len(cells))
