"""mdesign race: a mission becomes a controller."""

import shlex
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from mercator_design.cli.options import JOBS, PLUGIN, SEED, SET
from mercator_design.cli.terminal import Interrupt, tell, warn_of_doubts
from mercator_design.fsm.pfsm import FLAVOURS

if TYPE_CHECKING:
    from collections.abc import Sequence
    from contextlib import AbstractContextManager

    from mercator_design.design import Design
    from mercator_design.race.executors import Executor
    from mercator_design.race.journal import Finished, Iteration
    from mercator_design.race.optuna_mirror import OptunaMirror
    from mercator_design.race.runner import OnFailure
    from mercator_design.race.testing import Testing
    from mercator_design.report.progress import RaceDisplay
    from mercator_design.run_folder import RunFolder

_MOST_TOLD = 10
"""Failures that are told one by one."""
_WHAT_IT_BEGAN_WITH = ("mission", "seed", "output", "flavour", "method", "overrides")


@click.command()
@click.argument("mission", required=False)
@click.option(
    "--budget",
    type=click.IntRange(1, 10**9),
    help="Experiments that may be run; at least 60. With --resume, a larger one to go on to.",
)
@SEED
@JOBS
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of the results, new or empty.  [default: the next free runs/MISSION-N]",
)
@click.option(
    "--resume",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIRECTORY",
    help="Go on with the race of this folder, instead of a new one.",
)
@click.option(
    "--flavour",
    type=click.Choice(FLAVOURS),
    default="watermelon",
    show_default=True,
    help="Modules to design with.",
)
@click.option(
    "--method",
    type=click.Choice(["irace", "surrogate"]),
    default="irace",
    show_default=True,
    help="What proposes controllers and decides which of them run on.",
)
@click.option(
    "--executor",
    "executor_name",
    type=click.Choice(["threads", "processes", "dask"]),
    default="threads",
    show_default=True,
    help="What runs experiments; results do not depend on it.",
)
@click.option("--scheduler", metavar="ADDRESS", help="Of Dask, such as tcp://host:8786 or a scheduler file.")
@click.option(
    "--timeout",
    type=click.FloatRange(0, min_open=True),
    metavar="SECONDS",
    help="An experiment that takes longer has failed (with --executor processes).",
)
@click.option(
    "--on-failure",
    type=click.Choice(["stop", "reject"]),
    default="stop",
    show_default=True,
    help="What an experiment that fails does: stop the race, or reject its configuration.",
)
@click.option(
    "--test-runs",
    type=click.IntRange(0, 10**6),
    metavar="N",
    help="Measure the winner on N fresh instances when the race has ended, beyond the budget.",
)
@click.option(
    "--test-elites",
    type=click.IntRange(1, 10**6),
    metavar="N",
    help="Measure so many of the elites there, the winner and the next best.  [default: 1]",
)
@click.option("--test-iterations", is_flag=True, help="Measure the best of each iteration there, too.")
@click.option(
    "--optuna",
    metavar="URL",
    help="Show the race in an Optuna storage too, e.g. sqlite:///race.db, for optuna-dashboard.",
)
@SET
@PLUGIN
@click.pass_context
def race(
    context: click.Context,
    mission: str | None,
    budget: int | None,
    seed: int,
    jobs: int | None,
    output: Path | None,
    resume: Path | None,
    flavour: str,
    method: str,
    executor_name: str,
    scheduler: str | None,
    timeout: float | None,
    on_failure: "OnFailure",
    test_runs: int | None,
    test_elites: int | None,
    test_iterations: bool,
    optuna: str | None,
    overrides: tuple[str, ...],
) -> None:
    """Design control software for MISSION by iterated F-race.

    MISSION is a YAML file or the name of a shipped mission (see `mdesign missions`). The winner is written to
    fsm.txt in the results' folder, and a summary to stdout.

    A race that was stopped, by whatever, goes on where it was with --resume; so does one that has ended, with a larger
    --budget.
    """
    _check_usage(context, resume)
    from mercator_design.report.progress import RaceDisplay
    from mercator_design.report.summary import race_summary
    from mercator_design.run_folder import RunFolder

    executor = _executor(executor_name, jobs, scheduler, timeout)
    how: dict[str, Any] = {"executor": executor_name, "jobs": executor.jobs}
    tests = {"runs": test_runs, "elites": test_elites, "iterations": test_iterations or None}
    if resume is not None:
        folder = RunFolder.reopen(resume)
    else:
        assert mission is not None  # noqa: S101 - as was checked
        assert budget is not None  # noqa: S101
        testing = _testing(None, tests)
        folder = _new_folder(
            mission, overrides, output, how, testing, budget=budget, seed=seed, flavour=flavour, method=method
        )
    with folder, Interrupt(terminable=True) as interrupt:
        for note in folder.journal.notes:
            tell(f"Note: {note}")
        if resume is not None:
            if budget is not None:
                folder.extend(budget)
            folder.test(_testing(folder.testing, tests))
            folder.designer.simulator.rehearse(announce=tell)
        folder.journal.open_session(**how)
        before, tested = len(folder.journal.experiments), len(folder.journal.tests)
        with (
            executor,
            RaceDisplay(folder.designer, folder.journal.budget) as display,
            _mirror(optuna, folder) as mirror,
        ):
            result = _run(folder, executor, on_failure, interrupt, display, mirror)
        summary = race_summary(
            result,
            folder.designer,
            folder.journal,
            new=len(result.finished) - before,
            tested=len(folder.journal.tests) - tested,
            seconds=display.seconds,
            jobs=how["jobs"],
            folder=folder.path,
        )
        try:
            folder.finish(result, seconds=round(display.seconds, 3))
        finally:
            click.echo(summary, nl=False)


def _run(
    folder: "RunFolder",
    executor: "Executor",
    on_failure: "OnFailure",
    interrupt: Interrupt,
    display: "RaceDisplay",
    mirror: "OptunaMirror | None",
) -> "Design":
    from mercator_design.race.runner import ExperimentFailed, Stopped

    known = {number for number, one in folder.journal.experiments.items() if one.failure}
    done = failed = 0

    def watch(finished: "Sequence[Finished]") -> None:
        nonlocal done, failed
        done += len(finished)
        display.update(done)
        if mirror is not None:
            mirror.note(finished)
        for one in finished:
            if one.failure and one.experiment not in known:
                command = folder.keep_failed(one)
                failed += 1
                if failed <= _MOST_TOLD:
                    tell(f"Warning: configuration {one.configuration} is rejected: {one.failure}; see {command}")

    resume = f"mdesign race --resume {shlex.quote(str(folder.path))}"
    try:
        result = folder.designer.run(
            executor,
            folder.journal,
            on_failure=on_failure,
            watch=watch,
            watch_iterations=_tell_note,
            testing=folder.testing,
            watch_tests=display.update_tests,
            stopped=interrupt.came,
        )
    except Stopped:
        n, tests = len(folder.journal.experiments), len(folder.journal.tests)
        what = f"{n} experiments and {tests} tests" if tests else f"{n} experiments"
        interrupt.check(f"{folder.path}: the {what} so far are in journal.jsonl; to go on: {resume}")
        raise
    except ExperimentFailed as error:
        tell(f"To run what failed alone: {folder.keep_failed(error.finished)}")
        tell(f"To go on without it:      {resume} --on-failure reject")
        raise
    if mirror is not None:
        mirror.finish(result.configuration)
    return result


def _tell_note(ended: "Iteration") -> None:
    if ended.note:
        tell(f"Note: iteration {ended.iteration}: {ended.note}")


def _mirror(storage: str | None, folder: "RunFolder") -> "AbstractContextManager[OptunaMirror | None]":
    """What copies the race into an Optuna storage, if there is to be one."""
    if storage is None:
        return nullcontext()
    from mercator_design.race.optuna_mirror import OptunaMirror

    start, objective = folder.journal.start, folder.designer.simulator.mission.objective
    return OptunaMirror(
        storage,
        f"{start['mission']}, seed {start['seed']}, budget {folder.journal.budget}, {folder.path.resolve()}",
        folder.designer.race,
        maximise=objective.direction == "maximise",
        complain=lambda what: tell(f"Warning: {what}"),
    )


def _check_usage(context: click.Context, resume: Path | None) -> None:
    given = {
        parameter.name: parameter
        for parameter in context.command.params
        if parameter.name and context.get_parameter_source(parameter.name) is not ParameterSource.DEFAULT
    }
    if resume is not None:
        for name in _WHAT_IT_BEGAN_WITH:
            if name in given and context.params[name]:
                hint = given[name].human_readable_name if name == "mission" else given[name].opts[-1]
                raise click.UsageError(f"{hint} is what the race began with: it cannot be given with --resume")
        return
    for name, hint in (("mission", "argument 'MISSION'"), ("budget", "option '--budget'")):
        if context.params[name] is None:
            raise click.UsageError(f"Missing {hint}.")


def _testing(before: "Testing | None", given: dict[str, Any]) -> "Testing | None":
    """What is tested, as it was before unless something else is asked for."""
    from mercator_design.race.testing import Testing

    asked = {name: value for name, value in given.items() if value is not None}
    if before is None and "runs" not in asked and asked:
        raise click.UsageError("--test-elites and --test-iterations need --test-runs N")
    if before is None and not asked:
        return None
    testing = Testing(**asked) if before is None else replace(before, **asked)
    return testing if testing.runs else None


def _executor(name: str, jobs: int | None, scheduler: str | None, timeout: float | None) -> "Executor":
    from mercator_design.race.executors import ProcessExecutor, ThreadExecutor, available_jobs

    if (scheduler is not None) != (name == "dask"):
        raise click.UsageError("--executor dask and --scheduler ADDRESS go together")
    if timeout is not None and name != "processes":
        raise click.UsageError("--timeout needs --executor processes: only a process can be stopped from outside")
    if scheduler is not None:
        from mercator_design.race.dask_executor import DaskExecutor

        return DaskExecutor(scheduler, jobs)
    if name == "processes":
        return ProcessExecutor(jobs or available_jobs(), timeout=timeout)
    return ThreadExecutor(jobs or available_jobs())


def _new_folder(
    mission: str,
    overrides: tuple[str, ...],
    output: Path | None,
    how: dict[str, Any],
    testing: "Testing | None",
    *,
    budget: int,
    seed: int,
    flavour: str,
    method: str,
) -> "RunFolder":
    from mercator_design.design import Designer
    from mercator_design.fsm.conditions import CONDITIONS
    from mercator_design.fsm.modules import numbered
    from mercator_design.missions.mission import load_mission
    from mercator_design.run_folder import RunFolder
    from mercator_design.sim.simulate import Simulator

    simulator = Simulator(load_mission(mission, overrides))
    designer = Designer(simulator, budget=budget, seed=seed, flavour=flavour, method=method)
    warn_of_doubts(simulator, flavour, ((flavour, module) for module in numbered(CONDITIONS, flavour).values()))
    simulator.rehearse(announce=tell)
    request = {"mission": mission, "set": list(overrides), "flavour": flavour, "method": method, **how}
    return RunFolder.create(output or _free_folder(simulator.mission.name), designer, request=request, testing=testing)


def _free_folder(mission: str) -> Path:
    """The first of runs/MISSION-1, -2, ... that did not exist; it does now."""
    number = 1
    while True:
        folder = Path("runs") / f"{mission}-{number}"
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            number += 1
        else:
            return folder
