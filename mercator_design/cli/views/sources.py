"""What `replay` and `plot` show: an experiment that is simulated now, a trace, or the logs of robots."""

import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from mercator_design.cli.inputs import (
    Given,
    check_apart,
    new_simulator,
    simulator_of,
    warn_of_mission,
    warn_of_no_effect,
)
from mercator_design.cli.options import CONTROLLER, seed_of
from mercator_design.command import FSM, print_message, read_controller, warn
from mercator_design.missions.mission import load_mission
from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.results.experiments.robot_logs import Pose, is_log, read_logs
from mercator_design.results.experiments.traces import SUFFIXES, read_trace
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.software.files import FsmFile

_ROBOT_MODEL = "mercator"  # of logs without a mission


class StartingPose(click.ParamType):  # type: ignore[type-arg]  # has no argument in click before 8.2
    """Where a robot began: X,Y,HEADING in metres and degrees."""

    name = "X,Y,DEGREES"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Pose:  # noqa: ANN401
        try:
            x, y, degrees = (float(number) for number in str(value).split(","))
        except ValueError:
            x = y = degrees = math.nan
        if not all(map(math.isfinite, (x, y, degrees))):
            self.fail(f"expected X,Y,DEGREES such as 0.5,-1,90, found '{value}'", param, ctx)
        return x, y, math.radians(degrees)


def shows_experiments(verb: Callable[..., None]) -> Callable[..., None]:
    """Give a verb the options that select experiments; it is called with `shown`, the list of experiments."""

    @click.argument("sources", nargs=-1, required=True, type=FSM, metavar="FSM|TRACE|LOG...")
    @click.option(
        "--compare",
        multiple=True,
        type=FSM,
        metavar="FSM",
        help="Show another controller on the same instance, too. May be repeated.",
    )
    @click.option("--fsm", type=FSM, help="The controller of a TRACE, to name its states.")
    @click.option(
        "--start",
        "starts",
        multiple=True,
        type=StartingPose(),
        help="Where the robot of a LOG began; once for each LOG.  [default: poses of the mission's instance]",
    )
    @click.option(
        "--mission",
        help="YAML file or name of a shipped mission.  [default: the mission in FSM's header; none for logs]",
    )
    @seed_of("Seed of the instance: one of the `seeds` that evaluate --json lists.")
    @CONTROLLER
    @functools.wraps(verb)
    def with_experiments(
        sources: tuple[Path, ...],
        compare: tuple[Path, ...],
        fsm: Path | None,
        starts: tuple[Pose, ...],
        mission: str | None,
        seed: int,
        robot_model: str | None,
        flavour: str | None,
        lenient: bool,
        overrides: tuple[str, ...],
        **others: Any,  # noqa: ANN401 - the verb's
    ) -> None:
        first = sources[0]
        kind = "TRACE" if first.suffix.lower() in SUFFIXES else "LOG" if is_log(first) else "FSM"
        for option, value, wanted in (
            ("--compare", compare, "FSM"),
            ("--fsm", fsm, "TRACE"),
            ("--start", starts, "LOG"),
        ):
            if value and kind != wanted:
                raise click.UsageError(f"{option} needs {wanted} as the first file, found {kind}: {first}")
        for path in filter(None, (others.get("output"), others.get("video"))):
            check_apart(path, (*sources, *compare, *filter(None, [fsm])))
        given: Given = {"mission": mission, "robot_model": robot_model, "overrides": overrides}
        read = functools.partial(read_controller, flavour=flavour, lenient=lenient)
        if kind == "FSM":
            if len(sources) > 1:
                raise click.UsageError(f"expected one FSM, found {len(sources)} files; to compare, give --compare")
            verb(shown=_simulated([*sources, *compare], read, given, seed), **others)
            return
        if mission is None and overrides:
            raise click.UsageError("--set needs --mission")
        simulator = None if mission is None else new_simulator(load_mission(mission, overrides), robot_model)
        if simulator is not None:
            simulator.rehearse(announce=print_message)
        if kind == "TRACE":
            if simulator is None or len(sources) > 1:
                raise click.UsageError("expected one trace, with --mission, which says where it took place")
            file = None if fsm is None else read(fsm)
            pfsm, names = (None, ()) if file is None else (file.software, file.names)
            shown = read_trace(sources[0], simulator, seed, pfsm, names=names)
        else:
            model = load_robot_model(robot_model or _ROBOT_MODEL) if simulator is None else simulator.robot_model
            shown = read_logs(sources, model, simulator=simulator, seed=seed, starts=starts, warn=warn)
        verb(shown=[shown], **others)

    return with_experiments


def _simulated(files: list[Path], read: Callable[[Path], FsmFile], given: Given, seed: int) -> list[ShownExperiment]:
    """Run controllers on one instance: the mission of the first is that of all."""
    controllers = [read(file) for file in files]
    simulator = simulator_of(files[0], controllers[0], given)
    warn_of_mission(simulator, refuse=False)
    for controller in controllers:
        warn_of_no_effect(simulator, controller.software.flavour, controller.software)
    simulator.rehearse(announce=print_message)
    shown = []
    for file, controller in zip(files, controllers, strict=True):
        title = f"{file.name} on {simulator.mission.name}, seed {seed}"
        pfsm, names = controller.software, controller.names
        shown.append(ShownExperiment.simulated(simulator, pfsm, seed, title=title, states=names))
    return shown
