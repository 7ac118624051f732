"""mdesign evaluate: a controller's scores."""

from pathlib import Path

import click

from mercator_design.api import evaluate as measure
from mercator_design.api import fresh_instances
from mercator_design.cli.inputs import Given, ignore, new_simulator, simulator_of, warn_of_mission, warn_of_no_effect
from mercator_design.cli.options import JOBS, JSON, MISSION, PLUGIN, PROGRESS, ROBOT_MODEL, SEED, SET
from mercator_design.cli.terminal import Interrupt
from mercator_design.command import FILE, FLAVOUR, LENIENT, print_note, print_result, read_controller, warn
from mercator_design.fsm.pfsm import FLAVOURS, Pfsm
from mercator_design.fsm.text import parse
from mercator_design.missions.mission import load_mission
from mercator_design.report.progress import Display, Mode
from mercator_design.report.summary import evaluation_json, evaluation_summary
from mercator_design.sim.simulate import Simulator


@click.command(short_help="Measure a controller on fresh instances of a mission.")
@click.argument("fsm", type=FILE, required=False)
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
@ROBOT_MODEL
@FLAVOUR
@LENIENT
@SET
@PLUGIN
@JSON
@PROGRESS
@click.option(
    "--cost",
    "cost_alone",
    is_flag=True,
    help="Print the mean cost, which a race minimises, and no warnings: for irace.",
)
def evaluate(
    fsm: Path | None,
    fsm_config: str | None,
    mission: str | None,
    runs: int,
    seed: int,
    instances: tuple[int, ...],
    jobs: int | None,
    robot_model: str | None,
    flavour: str | None,
    lenient: bool,
    overrides: tuple[str, ...],
    as_json: bool,
    progress: Mode,
    cost_alone: bool,
) -> None:
    """Measure the controller of an fsm.txt on fresh instances of its mission, or on given ones.

    \b
    With --json: mission, direction, robots, duration, robot_model,
    runs, seed (null with --instance), scores, seeds, mean,
    standard_deviation (n - 1), quartiles [lower, median, upper],
    confidence_interval [low, high] (of the mean, 95 %, Student's t);
    the standard deviation and the interval of one run are null.
    """  # noqa: D301 - click reads the control character
    given: Given = {"mission": mission, "robot_model": robot_model, "overrides": overrides}
    pfsm, simulator = _controller(fsm, fsm_config, flavour, given, lenient=lenient, quiet=cost_alone)
    loaded = simulator.mission
    if not cost_alone:
        warn_of_mission(simulator, refuse=False)
        warn_of_no_effect(simulator, pfsm.flavour, pfsm)
    simulator.rehearse(announce=ignore if cost_alone else print_note)
    seeds = instances or fresh_instances(seed, runs)
    if cost_alone and progress == "auto":
        progress = "none"
    with Interrupt() as interrupt, Display(f"{loaded.name}: evaluating", len(seeds), progress) as display:

        def watch(done: int) -> None:
            display.show(done)
            interrupt.check(f"{done} of {len(seeds)} experiments were done")

        result = measure(loaded, pfsm, seeds=seeds, robot_model=simulator.robot_model, jobs=jobs, watch=watch)
    if cost_alone:
        print_result(repr(0.0 + loaded.cost(result.scores.mean)))
        return
    report = evaluation_json if as_json else evaluation_summary
    print_result(report(result, simulator, seed=None if instances else seed))


def _controller(
    fsm: Path | None, fsm_config: str | None, flavour: str | None, given: Given, *, lenient: bool, quiet: bool
) -> tuple[Pfsm, Simulator]:
    """The controller to measure, from a file or the command line, and its mission."""
    if (fsm is None) == (fsm_config is None):
        raise click.UsageError("expected either FSM or --fsm-config")
    if fsm is not None:
        file = read_controller(fsm, flavour, lenient=lenient)
        return file.pfsm, simulator_of(fsm, file, given, warn=ignore if quiet else warn)
    if given["mission"] is None:
        raise click.UsageError("--fsm-config needs --mission")
    tolerate = (lambda what: warn([what])) if lenient else None
    pfsm = parse(fsm_config or "", flavour or FLAVOURS[0], tolerate=tolerate)
    return pfsm, new_simulator(load_mission(given["mission"], given["overrides"]), given["robot_model"])
