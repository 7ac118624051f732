"""mdesign race: designs a controller for a mission."""

from dataclasses import replace
from pathlib import Path
from typing import Any, Unpack

import click

from mercator_design.cli.inputs import warn_of_mission, warn_of_no_effect
from mercator_design.cli.options import PLUGIN, PROGRESS, SEED, SET, design_flavour
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
from mercator_design.cli.races.executors import EXECUTOR, executor_of
from mercator_design.cli.races.reporting import NO_COMPARISON, NO_REPORT
from mercator_design.cli.study.seeds import SEEDS, Seeds, run_seeds
from mercator_design.cli.terminal import Interrupt
from mercator_design.command import print_note
from mercator_design.designer import Designer
from mercator_design.missions.mission import load_mission
from mercator_design.race.methods.table import DEFAULT_METHOD
from mercator_design.race.session.evaluation import Testing
from mercator_design.results.analysis.comparison import TEST_RUNS
from mercator_design.results.provenance import Request
from mercator_design.sim.simulate import Simulator

_FIXED = ("mission", "seed", "seeds", "output", "flavour", "method", "overrides", "stop_when_stagnant")


@click.command()
@click.argument("mission", required=False)
@click.option(
    "--budget",
    type=click.IntRange(1, 10**9),
    help="Maximum number of experiments; at least 20 for halving, random and evostick, 60 for irace, 40 for "
    "tpe and cma-es. With --resume, a larger budget to continue with.",
)
@SEED
@SEEDS
@OUTPUT
@RESUME
@design_flavour
@method_option(DEFAULT_METHOD)
@EXECUTOR
@ON_FAILURE
@click.option(
    "--stop-when-stagnant",
    is_flag=True,
    help="End the race when it has gained nothing for two fifths of the budget, and confirm the winner (with --method "
    "halving).",
)
@click.option(
    "--test-runs",
    type=click.IntRange(0, 10**6),
    metavar="N",
    help="When the race has ended, run the winner on N fresh instances, beyond the budget: their mean is its score. "
    f"0: do not.  [default: {TEST_RUNS}]",
)
@click.option("--test-elites", type=click.IntRange(1, 10**6), metavar="N", help="Test the N best elites.  [default: 1]")
@click.option("--test-iterations", is_flag=True, help="Test as many elites of each iteration, too.")
@NO_REPORT
@NO_COMPARISON
@OPTUNA
@PROGRESS
@JSON_LINES
@SET
@PLUGIN
def race(
    mission: str | None,
    budget: int | None,
    seed: int,
    seeds: Seeds | None,
    jobs: int | None,
    output: Path | None,
    resume: Path | None,
    flavour: str,
    method: str,
    executor_name: str,
    scheduler: str | None,
    timeout: float | None,
    stop_when_stagnant: bool,
    test_runs: int | None,
    test_elites: int | None,
    test_iterations: bool,
    no_comparison: bool,
    overrides: tuple[str, ...],
    **given: Unpack[RunOptions],
) -> None:
    """Design control software for MISSION, by a race of many designs in simulation.

    MISSION is a YAML file or the name of a shipped mission (see `mdesign missions`). The winner is written to
    fsm.txt in the results' folder, a page on the race to report.html there, and a summary to stdout.

    An interrupted race resumes where it stopped: give --resume. A race that has ended continues with --resume and a
    larger --budget. With --seeds, several races are a study (`mdesign study`).
    """
    check_usage(resumed=resume is not None, fixed=_FIXED, needed=("mission", "budget"))
    if stop_when_stagnant and (method != "halving" or seeds is not None):
        raise click.UsageError("--stop-when-stagnant needs --method halving, and no --seeds")
    executor = executor_of(executor_name, jobs, scheduler, timeout)
    tests = {"runs": test_runs, "elites": test_elites, "iterations": test_iterations or None}
    if resume is not None:
        folder = reopen(resume, "mission")
    else:
        assert mission is not None  # noqa: S101 - `check_usage` has checked
        assert budget is not None  # noqa: S101
        if seeds is not None:
            run_seeds(
                mission,
                seeds,
                executor,
                budget=budget,
                overrides=overrides,
                method=method,
                flavour=flavour,
                test_runs=test_runs,
                output=output,
                executor_name=executor_name,
                on_failure=given["on_failure"],
                reports=not given["no_report"],
                progress=given["progress"],
            )
            return
        testing = _testing(None, {**tests, "runs": TEST_RUNS if test_runs is None else test_runs})
        simulator = Simulator(load_mission(mission, overrides))
        warn_of_mission(simulator, refuse=True)
        options = {"stop_when_stagnant": True} if stop_when_stagnant else None
        designer = Designer(simulator, budget=budget, seed=seed, flavour=flavour, method=method, options=options)
        warn_of_no_effect(simulator, flavour)
        designer.prepare(print_note)
        request = Request(
            mission=mission, set=overrides, flavour=flavour, method=method, executor=executor_name, jobs=executor.jobs
        )
        folder = new_folder(output, designer, request=request, testing=testing)
    with folder, Interrupt(then=executor.stop, notice=NOTICE) as interrupt:
        if resume is not None:
            if budget is not None:
                folder.extend(budget)
            folder.test(_testing(folder.testing, tests))
            folder.task.prepare(print_note)
        run(folder, executor, executor_name, interrupt, compares=not no_comparison, **given)


def _testing(before: Testing | None, given: dict[str, Any]) -> Testing | None:
    """The tests: as before, unless options change them."""
    changes = {name: value for name, value in given.items() if value is not None}
    if before is None and "runs" not in changes and changes:
        raise click.UsageError("--test-elites and --test-iterations need --test-runs N")
    if given["runs"] == 0 or (before is None and not changes):
        return None
    return Testing(**changes) if before is None else replace(before, **changes)
