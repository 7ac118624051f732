"""mdesign tune: finds parameters of any program by irace's scenario."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Unpack

import click

from mercator_design.cli.options import PROGRESS
from mercator_design.cli.races.common import (
    JSON_LINES,
    NOTICE,
    ON_FAILURE,
    OPTUNA,
    OUTPUT,
    RESUME,
    RunOptions,
    check_usage,
    method_option,
    new_folder,
    reopen,
    run,
)
from mercator_design.cli.races.reporting import NO_REPORT
from mercator_design.cli.terminal import Interrupt
from mercator_design.command import FILE, print_note, print_result
from mercator_design.errors import MercatorError, printable
from mercator_design.race.executors.executor import Failed, Rejected
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.irace.configurations import read_configurations
from mercator_design.race.irace.scenario import read_scenario
from mercator_design.race.irace.scenario_text import Assignment
from mercator_design.race.irace.tuner import Tuner
from mercator_design.race.session.evaluation import Testing
from mercator_design.race.session.events import Measurement
from mercator_design.race.session.outcome import OnFailure
from mercator_design.results.provenance import Request
from mercator_design.show.text.columns import aligned
from mercator_design.system.csv_text import csv_text
from mercator_design.system.files import write_text, writing

_FIXED = (
    "scenario",
    "scenario_option",
    "seed",
    "output",
    "method",
    "exec_dir",
    "target_runner",
    "check",
    "only_test",
)


@click.command()
@click.argument("scenario", type=FILE, required=False)
@click.option("-s", "--scenario", "scenario_option", type=FILE, help="SCENARIO as an option, as in irace.")
@click.option(
    "--max-experiments",
    type=click.IntRange(1, 10**9),
    help="Maximum number of experiments; with --resume, a larger one to continue with.  [default: the scenario's]",
)
@click.option(
    "--seed", type=click.IntRange(0, 2**31 - 1), help="Master seed of all randomness.  [default: the scenario's]"
)
@click.option(
    "-j",
    "--parallel",
    type=click.IntRange(1, 256),
    help="Number of experiments that run at the same time.  [default: the scenario's]",
)
@click.option(
    "--exec-dir", type=click.Path(path_type=Path), help="Folder in which experiments run.  [default: the scenario's]"
)
@click.option("--target-runner", type=FILE, help="Program that runs experiments.  [default: the scenario's]")
@method_option("irace")
@click.option(
    "--speculate", is_flag=True, help="Let idle workers run speculative experiments: more runs than the budget."
)
@click.option("--check", is_flag=True, help="Run a few configurations on one instance instead of a race.")
@click.option(
    "--only-test",
    type=FILE,
    help="Run the configurations of this file on the scenario's test instances instead of a race.",
)
@OUTPUT
@RESUME
@ON_FAILURE
@NO_REPORT
@OPTUNA
@PROGRESS
@JSON_LINES
def tune(
    scenario: Path | None,
    scenario_option: Path | None,
    max_experiments: int | None,
    seed: int | None,
    parallel: int | None,
    exec_dir: Path | None,
    target_runner: Path | None,
    method: str,
    speculate: bool,
    check: bool,
    only_test: Path | None,
    output: Path | None,
    resume: Path | None,
    **given: Unpack[RunOptions],
) -> None:
    """Find parameters of the program of SCENARIO, irace's scenario.txt.

    The best configurations are written to best.txt in the results' folder, in the format of irace's configurationsFile,
    and a summary to stdout. Options of a scenario that are not supported are refused.

    An interrupted race resumes where it stopped: give --resume. A race that has ended continues with --resume and a
    larger --max-experiments.
    """
    if scenario is not None and scenario_option is not None:
        raise click.UsageError("SCENARIO and --scenario exclude each other")
    needed = () if scenario_option is not None else ("scenario",)
    check_usage(resumed=resume is not None, fixed=_FIXED, needed=needed)
    scenario = scenario or scenario_option
    if (check or only_test is not None) and (given["optuna"] is not None or speculate):
        raise click.UsageError("--optuna and --speculate need a race: --check and --only-test run none")
    if check and (only_test is not None or output is not None):
        raise click.UsageError("--check takes neither --only-test nor --output")
    if resume is not None:
        folder = reopen(resume, "scenario")
    else:
        assert scenario is not None  # noqa: S101 - `check_usage` has checked
        settings = _settings(
            maxExperiments=max_experiments, seed=seed, parallel=parallel, execDir=exec_dir, targetRunner=target_runner
        )
        tuner = Tuner(read_scenario(scenario, settings), method)
        for note in tuner.optimizer.notes:
            print_note(f"Note: {note}")
        if check:
            _check(tuner)
            return
        if only_test is not None:
            _only_test(tuner, only_test, output, parallel or tuner.scenario.jobs, given["on_failure"])
            return
        of, testing = tuner.scenario, None
        if of.test_instances and of.test_elites:
            testing = Testing(runs=len(of.test_instances), elites=of.test_elites, iterations=of.test_iterations)
        request = Request(scenario=str(scenario.absolute()), method=method)
        folder = new_folder(output, tuner, request=request, testing=testing)
    assert isinstance(folder.task, Tuner)  # noqa: S101 - `reopen` has checked
    folder.task.speculates = speculate
    executor = ThreadExecutor(parallel or folder.task.scenario.jobs)
    with folder, Interrupt(then=folder.task.stop, notice=NOTICE) as interrupt:
        if resume is not None and max_experiments is not None:
            folder.extend(max_experiments)
        run(folder, executor, "threads", interrupt, **given)


def _settings(**options: Path | int | None) -> list[Assignment]:
    """The settings of the command line, by irace's names; paths are relative to the current folder."""
    return [
        Assignment(name, str(value.absolute()) if isinstance(value, Path) else value, "the command line")
        for name, value in options.items()
        if value is not None
    ]


def _check(tuner: Tuner) -> None:
    """Run the first experiments of a race: the initial configurations and two more.

    They run in a thread, so that a signal in the main thread can end a running program.
    """
    failed = False

    def show(command: list[str], run: Callable[[], Measurement], *, is_cost: bool) -> bool:
        """Show a command and its result; return whether it succeeded."""
        nonlocal failed
        print_result(tuner.shell_command(command))
        ((_, result),) = executor.run(lambda _: run(), [0])
        interrupt.check("Not all of these experiments have run")
        if isinstance(result, Failed):
            failed = failed or not isinstance(result.error, Rejected)
            print_result(printable(f"  {result.reason}"))
        elif is_cost:
            print_result(f"  cost {result.score:g}")
        return not isinstance(result, Failed)

    evaluate, target = tuner.evaluate, tuner.scenario.target
    ran = []
    with Interrupt(then=tuner.stop) as interrupt, ThreadExecutor(1) as executor:
        for experiment in tuner.optimizer.ask()[: len(tuner.scenario.initial) + 2]:
            call = tuner.item(experiment, tuner.optimizer.configurations[experiment.configuration])
            if show(target.command(call), partial(tuner.function, call), is_cost=evaluate is None):
                ran.append(call)
        if evaluate is not None:
            alive = [call.configuration for call in ran]
            for call in ran:
                show(target.evaluation(call, alive), partial(evaluate, call, alive), is_cost=True)
    if failed:
        raise MercatorError("expected a cost from each of these, found failures")


def _only_test(tuner: Tuner, file: Path, output: Path | None, jobs: int, on_failure: OnFailure) -> None:
    """Test configurations and show their costs as a table; write it as tests.csv if there is an output folder."""
    instances = tuner.scenario.test_instances
    if not instances:
        expected = "testInstances, testInstancesDir or testInstancesFile"
        raise MercatorError(f"{tuner.scenario.path}: expected test instances for --only-test ({expected}), found none")
    configurations, notes = read_configurations(file, tuner.scenario.space)
    for note in notes:
        print_note(f"Note: {note}")
    if not configurations:
        raise MercatorError(f"{file}: expected configurations, found none")
    with Interrupt(then=tuner.stop, stopped="Tests are not saved") as interrupt, ThreadExecutor(jobs) as executor:
        costs = tuner.test(configurations, executor, on_failure=on_failure, stopped=interrupt.came)
    rows: list[list[object]] = [["test instance", "seed", *range(1, len(configurations) + 1)]]
    for number, instance in enumerate(instances):
        rows.append([instance, tuner.test_seed(number), *(f"{of[number]:.15g}" for of in costs)])
    means = [f"{sum(of) / len(of):.6g}" for of in costs]
    print_result("\n".join(aligned([*rows, ["mean", None, *means]])))
    if output is not None:
        with writing(output):
            output.mkdir(parents=True, exist_ok=True)
            write_text(output / "tests.csv", csv_text(rows))
