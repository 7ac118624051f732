"""mdesign evaluate: a controller's scores."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Unpack

import click

from mercator_design.api import evaluate as measure
from mercator_design.api import fresh_instances
from mercator_design.cli.inputs import Given, ignore, new_simulator, simulator_of, warn_of_mission
from mercator_design.cli.options import CONTROLLER, CSV, JOBS, JSON, MISSION, PROGRESS, SEED
from mercator_design.cli.terminal import Interrupt
from mercator_design.command import FSM, print_note, print_result, read_controllers, warn
from mercator_design.config.writing import digest_of
from mercator_design.missions.mission import load_mission
from mercator_design.modules.architecture import Software
from mercator_design.modules.flavour import DEFAULT_FLAVOUR
from mercator_design.results.analysis.swarm import evaluate_with_stats
from mercator_design.show.text.evaluations import (
    Comparison,
    Evaluated,
    comparison_csv,
    comparison_data,
    comparison_text,
    evaluation_data,
    evaluation_summary,
)
from mercator_design.show.text.progress import Display, Mode
from mercator_design.sim.checks.no_effect import no_effect_warnings
from mercator_design.sim.simulate import Simulator
from mercator_design.software.files import parse_software


@click.command()
@click.argument("fsm", type=FSM, nargs=-1, metavar="[FSM]...")
@click.option(
    "--fsm-config", metavar="TEXT", help="The controller as text, instead of FSM: --nstates ..., as in AutoMoDe."
)
@MISSION
@click.option("-n", "--runs", type=click.IntRange(1, 10**6), default=100, show_default=True, help="Experiments to run.")
@SEED
@click.option(
    "--instance",
    "instances",
    type=click.IntRange(0, 2**63 - 1),
    multiple=True,
    metavar="SEED",
    help="Run on the instance of this seed instead of fresh instances. May be repeated.",
)
@JOBS
@CONTROLLER
@click.option(
    "--stats",
    is_flag=True,
    help="Also measure what the swarm did: time in each state and on each colour, transitions, "
    "neighbours, obstacles, speed.",
)
@JSON
@CSV
@PROGRESS
@click.option(
    "--cost",
    "cost_alone",
    is_flag=True,
    help="Print the mean cost, which a race minimises, and no warnings: for irace.",
)
def evaluate(
    fsm: tuple[Path, ...],
    fsm_config: str | None,
    runs: int,
    seed: int,
    instances: tuple[int, ...],
    jobs: int | None,
    flavour: str | None,
    lenient: bool,
    stats: bool,
    as_json: bool,
    as_csv: bool,
    progress: Mode,
    cost_alone: bool,
    **given: Unpack[Given],
) -> None:
    """Measure the controller of an fsm.txt on fresh instances of its mission, or on given ones.

    FSM may also be a run folder, whose winner is measured.

    Several controllers, as files or as lines of a file, run on the same instances: a table with paired tests shows
    which is best.

    \b
    With --json: mission, direction, robots, duration, robot_model,
    runs, seed (null with --instance), scores, seeds, mean,
    standard_deviation (n - 1), quartiles [lower, median, upper],
    confidence_interval [low, high] (of the mean, 95 %, Student's t);
    the standard deviation and the interval of one run are null.
    With --stats also stats: states (share of time in each),
    transitions [1/s], ground (share of time on each colour),
    neighbours (mean number), obstacles (share of time with one near
    enough to be avoided), speed [m/s]; null where the robot has no such sensor.
    Of several controllers: best (its name), fsms (name, fsm and the
    figures of each), pairs (first, second, mean_difference,
    confidence_interval, p_value of the paired t-test, with Holm's
    correction for all pairs).
    """  # noqa: D301 - click reads the control character
    if as_json + as_csv + cost_alone > 1:
        raise click.UsageError("--json, --csv and --cost exclude each other")
    pfsms, simulator = controllers(fsm, fsm_config, flavour, given, lenient=lenient, quiet=cost_alone)
    if cost_alone and len(pfsms) > 1:
        raise click.UsageError(f"--cost is of one controller, found {len(pfsms)}")
    loaded, model = simulator.mission, simulator.robot_model
    if cost_alone and loaded.is_ranked_by_all:
        raise click.UsageError(f"--cost is one figure, but {loaded.name} has several objectives; give them weights")
    if not cost_alone:
        warn_of_mission(simulator, refuse=False)
        warn(*_without_effect(pfsms, simulator))
    simulator.rehearse(announce=ignore if cost_alone else print_note)
    seeds = instances or fresh_instances(seed, runs)
    if cost_alone and progress == "auto":
        progress = "none"
    evaluated = measured(pfsms, simulator, seeds, jobs=jobs, stats=stats, progress=progress)
    if cost_alone:
        print_result(repr(0.0 + loaded.cost(evaluated[0].scores.mean)))
        return
    master = None if instances else seed
    if as_csv:
        print_result(comparison_csv(Comparison(evaluated, loaded, model)), nl=False)
        return
    found: object
    if len(evaluated) == 1:
        found = (evaluation_data if as_json else evaluation_summary)(evaluated[0], loaded, model, seed=master)
    else:
        compared = Comparison(evaluated, loaded, model)
        found = (comparison_data if as_json else comparison_text)(compared, seed=master)
    print_result(json.dumps(found, allow_nan=False) if as_json else found)


def measured(
    pfsms: Mapping[str, Software],
    simulator: Simulator,
    seeds: Sequence[int],
    *,
    jobs: int | None,
    progress: Mode,
    stats: bool = False,
) -> list[Evaluated]:
    """Run controllers on the same instances, and show the progress; Ctrl-C stops."""
    mission, model = simulator.mission, simulator.robot_model
    total, evaluated = len(seeds) * len(pfsms), list[Evaluated]()
    with Interrupt() as interrupt, Display(f"{mission.name}: evaluating", total, progress) as display:

        def watch(done: int) -> None:
            done += len(seeds) * len(evaluated)
            display.show(done)
            interrupt.check(f"{done} of {total} experiments were done")

        for name, pfsm in pfsms.items():
            if stats:
                result, did = evaluate_with_stats(simulator, pfsm, seeds, jobs=jobs, watch=watch)
            else:
                did = None
                result = measure(mission, pfsm, seeds=seeds, robot_model=model, jobs=jobs, watch=watch)
            evaluated.append(Evaluated(name, pfsm, result, did))
    return evaluated


def _without_effect(pfsms: Mapping[str, Software], simulator: Simulator) -> list[str]:
    """Warnings of parts without effect; each names its controller, unless it is about all of them."""
    mission, model = simulator.mission, simulator.robot_model
    found = {name: [*no_effect_warnings(mission, model, pfsm.flavour, pfsm)] for name, pfsm in pfsms.items()}
    first, *others = found.values()
    of_all = [warning for warning in first if all(warning in other for other in others)]
    return of_all + [f"{name}: {what}" for name, warnings in found.items() for what in warnings if what not in of_all]


def controllers(
    files: Sequence[Path], fsm_config: str | None, flavour: str | None, given: Given, *, lenient: bool, quiet: bool
) -> tuple[dict[str, Software], Simulator]:
    """The controllers to measure by their names, from files or the command line, and their mission."""
    if bool(files) == (fsm_config is not None):
        raise click.UsageError("expected either FSM or --fsm-config")
    if fsm_config is not None:
        if given["mission"] is None:
            raise click.UsageError("--fsm-config needs --mission")
        software = parse_software(fsm_config, flavour or DEFAULT_FLAVOUR, tolerate=warn if lenient else None)
        return {"fsm": software}, new_simulator(
            load_mission(given["mission"], given["overrides"]), given["robot_model"]
        )
    pfsms: dict[str, Software] = {}
    simulator: Simulator | None = None
    for path in dict.fromkeys(files):
        found = read_controllers(path, flavour, lenient=lenient)
        pfsms |= {name: file.software for name, file in found.items()}
        own = simulator_of(path, next(iter(found.values())), given, warn=ignore if quiet else warn)
        simulator = simulator or own
        if _digests(own) != _digests(simulator):
            raise click.UsageError(
                f"{path}: was designed for another mission or robot model than {files[0]}; give --mission"
            )
    assert simulator is not None  # noqa: S101 - there is a file
    return pfsms, simulator


def _digests(simulator: Simulator) -> tuple[str, str]:
    return simulator.mission.digest, digest_of(simulator.robot_model)
