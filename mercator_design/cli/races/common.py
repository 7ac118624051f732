"""Shared by the verbs race and tune: new and resumed races, their folders, failures, signals."""

import gc
import json
import shlex
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from itertools import chain, count
from pathlib import Path
from typing import Any, TypedDict, Unpack

import click
from click.core import ParameterSource

from mercator_design.cli.options import FOLDER
from mercator_design.cli.races.reporting import write_report
from mercator_design.cli.terminal import Interrupt, terminal_width
from mercator_design.command import print_message, print_note, print_result, warn
from mercator_design.errors import described
from mercator_design.race.executors.executor import (
    Executor,
    ExecutorLost,
    ExecutorStopped,
    WorkerUnfit,
    available_jobs,
)
from mercator_design.race.methods.table import METHODS
from mercator_design.race.session.evaluation import Testing
from mercator_design.race.session.events import (
    Event,
    ExperimentDone,
    IterationEnded,
    ScoreRevised,
    TestDone,
    to_json,
)
from mercator_design.race.session.optuna_mirror import OptunaMirror
from mercator_design.race.session.outcome import ExperimentFailed, OnFailure
from mercator_design.race.session.runner import RaceRun
from mercator_design.race.session.task import Task
from mercator_design.results.files import read_provenance, resume_command
from mercator_design.results.folder import RunFolder
from mercator_design.results.provenance import Request
from mercator_design.show.report.page import REPORT
from mercator_design.show.text.columns import with_notes_wrapped
from mercator_design.show.text.progress import Mode, RaceDisplay
from mercator_design.show.text.summary import race_summary, written

_NOT_KEPT = ("executor_name", "jobs", "scheduler", "timeout", "on_failure")
"""Parameters of a race that its folder does not keep: they are given again to resume it in the same way."""
_MAX_WARNINGS = 10
"""Number of failures that are reported one by one."""
NOTICE = "Stopping when the running experiments have ended; Ctrl-C again stops at once"
"""Printed after a signal."""

RESUME = click.option(
    "--resume", type=FOLDER, metavar="DIRECTORY", help="Resume the race of this folder instead of starting a new one."
)
OUTPUT = click.option(
    "-o",
    "--output",
    type=FOLDER,
    help="Folder of the results, new or empty.  [default: the next free runs/NAME-N]",
)
ON_FAILURE = click.option(
    "--on-failure",
    type=click.Choice(["stop", "reject"]),
    default="stop",
    show_default=True,
    help="Effect of an experiment that fails: stop the race, or reject its configuration.",
)
JSON_LINES = click.option(
    "--json-lines",
    is_flag=True,
    help="Print each event of the race on stdout as a line of JSON, and the summary on stderr.",
)
OPTUNA = click.option(
    "--optuna",
    metavar="URL",
    help="Copy the race into an Optuna storage, e.g. sqlite:///race.db, for optuna-dashboard.",
)


class RunOptions(TypedDict):
    """How a race runs: the options that race and tune share."""

    on_failure: OnFailure
    no_report: bool
    optuna: str | None
    progress: Mode
    json_lines: bool


def method_option(default: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """The option --method of a verb."""
    return click.option(
        "--method",
        type=click.Choice(list(METHODS)),
        default=default,
        show_default=True,
        help="The method that proposes and eliminates configurations.",
    )


def check_usage(*, resumed: bool, fixed: Sequence[str], needed: Sequence[str]) -> None:
    """Refuse parameters that are `fixed` when a race is resumed, and a new race without those that are `needed`."""
    context = click.get_current_context()
    parameters = {one.name: one for one in context.command.params if one.name}
    for name in fixed if resumed else ():
        if context.get_parameter_source(name) is not ParameterSource.DEFAULT:
            hint = _hint(parameters[name])
            raise click.UsageError(f"{hint} is fixed when a race begins: it cannot be given with --resume")
    for name in () if resumed else needed:
        if context.params[name] is None:
            kind = parameters[name].param_type_name
            raise click.UsageError(f"Missing {kind} '{_hint(parameters[name])}'.")


def _hint(parameter: click.Parameter) -> str:
    return parameter.human_readable_name if isinstance(parameter, click.Argument) else parameter.opts[-1]


def reopen(path: Path, task: str) -> RunFolder:
    """Open the folder of a race to resume, of the given task."""
    found = str(read_provenance(path).race["task"])
    if found != task:
        raise click.UsageError(f"{path} is the race of a {found}: resume it with {resume_command(path, found)}")
    return RunFolder.reopen(path)


def _options_to_repeat() -> list[str]:
    """The options of this command that a folder does not keep."""
    context = click.get_current_context()
    given = [one for one in context.command.params if one.name in _NOT_KEPT]
    changed = [one for one in given if context.get_parameter_source(one.name) is not ParameterSource.DEFAULT]
    return [text for one in changed for text in (_hint(one), str(context.params[one.name]))]


def new_folder(output: Path | None, task: Task[Any], *, request: Request, testing: Testing | None) -> RunFolder:
    """Create the folder of a new race: as `output` says, or the first of runs/NAME-1, -2, ... that does not exist."""
    if output is not None:
        return RunFolder.create(output, task, request=request, testing=testing)
    for number in count(1):
        folder = Path("runs") / f"{task.name}-{number}"
        with suppress(FileExistsError):
            folder.mkdir(parents=True)
            break
    try:
        return RunFolder.create(folder, task, request=request, testing=testing)
    except BaseException:
        with suppress(OSError):  # it has files
            folder.rmdir()
        raise


def run(
    folder: RunFolder,
    executor: Executor,
    executor_name: str,
    interrupt: Interrupt,
    *,
    compares: bool = True,
    **given: Unpack[RunOptions],
) -> None:
    """Run the race of a folder to its end, print its summary, and write its report."""
    progress, json_lines = given["progress"], given["json_lines"]
    record, jobs, optimizer = folder.journal.record, executor.jobs, folder.task.optimizer
    for note in folder.journal.notes:
        print_note(f"Note: {note}")
    folder.journal.open_session(executor_name, jobs)
    experiments, tests = len(record.experiments), len(record.tests)
    resume = resume_command(folder.path, record.start["task"])
    race = RaceRun(
        folder.task,
        executor,
        folder.journal,
        on_failure=given["on_failure"],
        testing=folder.testing,
        stopped=interrupt.came,
    )
    messages = _Messages(folder)
    if not gc.get_freeze_count():
        gc.freeze()  # what was imported stays: else a full collection looks through it while all workers wait
    try:
        with (
            executor,
            RaceDisplay(folder.task, race.view, folder.testing, progress, plan=optimizer.progress) as display,
            _mirror(given["optuna"], folder) as mirror,
        ):
            display.known = experiments
            if json_lines:
                print_result(json.dumps({"event": "start", **record.start}))
            for event in race:
                if json_lines:
                    print_result(json.dumps(to_json(event)))
                display.note(event)
                if mirror is not None:
                    mirror.note(event)
                messages.note(event)
            if mirror is not None:
                mirror.finish(race.result.configuration)
    except (ExecutorStopped, ExecutorLost, WorkerUnfit) as error:
        what = f"{len(record.experiments)} experiments" + (f" and {len(record.tests)} tests" if record.tests else "")
        again = resume_command(folder.path, record.start["task"], *_options_to_repeat())
        report_kept(error, interrupt, folder.path, what, again)
        raise
    except ExperimentFailed as error:
        print_message(f"To run only the failed experiment: {folder.keep_failed(error.finished)}")
        print_message(f"To continue without it:            {resume} --on-failure reject")
        raise
    summary = race_summary(
        race.result,
        folder,
        new=len(race.result.finished) - experiments,
        tested=len(record.tests) - tests,
        seconds=display.seconds,
        jobs=jobs,
    )
    try:
        folder.finish(race.result, seconds=round(display.seconds, 3))
    finally:
        print_result(with_notes_wrapped(summary, terminal_width()), nl=False, err=json_lines)
    print_result(written(folder), err=json_lines)
    if not given["no_report"]:
        _report(folder, compares, jobs, progress, interrupt, err=json_lines)


def report_kept(error: Exception, interrupt: Interrupt, path: Path, what: str, again: str) -> None:
    """Say what a folder keeps of a run that an error or a signal has ended, and the command that resumes it."""
    message = f"{path}: the {what} so far are kept; to resume: {again}"
    if isinstance(error, ExecutorStopped):
        interrupt.check(message)
    else:
        print_message(message)


def _report(folder: RunFolder, compares: bool, jobs: int, progress: Mode, interrupt: Interrupt, *, err: bool) -> None:
    """Write the report of a race that has ended; if that is not possible, the race's results stay."""
    output, later = folder.path / REPORT, f"to write it: {shlex.join(['mdesign', 'report', str(folder.path)])}"
    try:
        write_report(
            folder.path,
            output,
            task=folder.task,
            record=folder.journal.record,
            compares=compares,
            jobs=min(jobs, available_jobs()),
            progress=progress,
            stopped=interrupt.came,
        )
    except ExecutorStopped:
        interrupt.check(f"{folder.path}: the race has ended, its report is not written; {later}")
        raise
    except Exception as error:  # noqa: BLE001 - whatever is wrong with the report, the race is right
        warn(f"the report is not written: {described(error)}; {later}")
    else:
        print_result(f"Report     {output}", err=err)


class _Messages:
    """Prints messages on new failures and notes of a race."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        record = folder.journal.record
        revised = chain.from_iterable(few.values() for few in record.revised.values())
        known: Iterator[ExperimentDone | ScoreRevised | TestDone] = chain(
            record.experiments.values(), record.tests.values(), revised
        )
        self._known_failures = {one for one in known if one.failure}
        self._known_iterations = set(record.iterations)
        self._n_failed = 0

    def note(self, event: Event) -> None:
        match event:
            case ExperimentDone() | TestDone() | ScoreRevised() if event.failure and event not in self._known_failures:
                what = f"configuration {event.configuration} is rejected: {event.failure}"
                if isinstance(event, TestDone):
                    what = f"configuration {event.configuration}: test {event.instance} failed: {event.failure}"
                if not isinstance(event, ScoreRevised):  # whose experiment has not failed
                    what += f"; see {self._folder.keep_failed(event)}"
                self._n_failed += 1
                if self._n_failed <= _MAX_WARNINGS:
                    warn(what)
            case IterationEnded() if event.note and event.iteration not in self._known_iterations:
                print_note(f"Note: iteration {event.iteration}: {event.note}")


def _mirror(storage: str | None, folder: RunFolder) -> AbstractContextManager[OptunaMirror | None]:
    """The mirror that copies the race into an Optuna storage, if one is given."""
    if storage is None:
        return nullcontext()
    task = folder.task
    task.need_one_cost("--optuna")
    return OptunaMirror(
        storage,
        f"{task.name}, seed {task.optimizer.seed}, budget {folder.journal.record.budget}, {folder.path.resolve()}",
        task.optimizer,
        folder.journal.record.view,
        maximise=task.maximise,
        warn=warn,
    )
