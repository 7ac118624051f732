"""mdesign validate: checks files."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from mercator_design.cli.contents import content_of, is_study, kind_of_name
from mercator_design.cli.inputs import new_simulator, warn_of_mission
from mercator_design.cli.options import FLAVOUR
from mercator_design.command import FILE, LENIENT, print_error, print_note, print_result, read_controller, warn
from mercator_design.config import spelling
from mercator_design.config.schema import Kind, fields_of
from mercator_design.errors import FsmError, MissionError, StudyError, printable
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.missions.mission import Mission, load_mission
from mercator_design.modules.flavour import DEFAULT_FLAVOUR
from mercator_design.plugins.registries import is_ours
from mercator_design.robot.devices.settings import Settings
from mercator_design.sim.checks.impossible import angle_warnings
from mercator_design.sim.checks.no_effect import dead_conditions, floor_warnings, model_warnings, swarm_warnings
from mercator_design.sim.robot_model import RobotModel, load_robot_model
from mercator_design.software.architectures import architecture_of

_TRIED = 100  # cycles in which functions of plugins are tried


@click.command()
@click.argument("files", nargs=-1, required=True, type=FILE)
@FLAVOUR
@LENIENT
def validate(files: tuple[Path, ...], flavour: str | None, lenient: bool) -> None:
    """Check missions, robot models, FSM files and studies.

    Missions, robot models, fsm.yaml and studies are *.yaml, *.yml and names of shipped ones; all others are
    fsm.txt. A mission is valid only if its robots find places to start from, and its score can differ. An objective
    or floor dynamic of a plugin is tried on the first 100 cycles of an experiment with robots that stand still.
    Prints a line for each file. The exit code is 3 if any file is invalid.
    """
    invalid = False
    for file in files:
        try:
            print_result(printable(f"{file}: {_validated(file, flavour, lenient)}"))
        except (MissionError, FsmError, StudyError) as error:
            invalid = True
            print_error(error)
    if invalid:
        raise click.exceptions.Exit(MissionError.exit_code)


def _validated(file: Path, flavour: str | None, lenient: bool) -> str:
    """Describe a valid file in a few words."""
    kind = "" if file.exists() else kind_of_name(str(file))
    if file.suffix.lower() in {".yaml", ".yml"} or kind:
        content = content_of(file)
        if kind == "study" or is_study(content):
            from mercator_design.cli.study.run import checked_study  # pandas comes with these
            from mercator_design.studies.plan import load_plan

            layout = checked_study(load_plan(file)).layout
            experiments = sum(map(layout.n_experiments, layout.cells))
            return f"valid study, {_count(len(layout.cells), 'design')}, {_count(experiments, 'experiment')}"
        keys = set(map(spelling.folded, content))
        if keys & _only_of(Settings, Mission, RobotModel):
            raise MissionError(
                f"{file}: these are the settings of one robot, robot.yaml: mercator-robot check --robot {file}"
            )
        if "robots" in content and isinstance(content["robots"].content, list):
            raise MissionError(f"{file}: these are addresses of robots, robots.yaml: mdesign deploy --robots {file}")
        if "states" in content:
            return _described(file, flavour, lenient)
        # Keys of both and misspelt ones do not count.
        of_models, of_missions = {"base", *_only_of(RobotModel, Mission)}, _only_of(Mission, RobotModel)
        if kind == "robot-model" or len(keys & of_models) > len(keys & of_missions):
            model = load_robot_model(str(file))
            warn(*model_warnings(model), *(warning.message for warning in angle_warnings(model)))
            return f"valid robot model {model.name}"
        mission = load_mission(str(file))
        simulator = new_simulator(mission, None)
        simulator.check_placement()
        warn_of_mission(simulator, refuse=True)
        model = simulator.robot_model
        warn(*model_warnings(model), *swarm_warnings(mission, model), *floor_warnings(mission, model))
        if not all(map(is_ours, _functions(mission))):
            simulator.rehearse(print_note, min(mission.cycles, _TRIED))
        dead = ", ".join(dead_conditions(mission, model, flavour or DEFAULT_FLAVOUR))
        never = f"; never fires there: {dead}" if dead else ""
        return f"valid mission, {_count(mission.robots, 'robot')}, {mission.duration:g} s{never}"
    return _described(file, flavour, lenient)


def _functions(mission: Mission) -> list[Callable[..., Any]]:
    """The functions of its objectives and dynamics."""
    return [one.function for one in (*mission.all_objectives, *mission.floor.dynamics)]


def _described(file: Path, flavour: str | None, lenient: bool) -> str:
    """Describe the control software of a file in a few words."""
    found = read_controller(file, flavour, lenient=lenient)
    if not isinstance(found.software, Pfsm):
        return f"valid {architecture_of(found.software.flavour).noun}: {found.software.summary}"
    pfsm = found.software
    transitions = sum(len(state.transitions) for state in pfsm.states)
    return f"valid {pfsm.flavour} FSM, {_count(len(pfsm.states), 'state')}, {_count(transitions, 'transition')}"


def _only_of(kind: Kind, *others: Kind) -> set[str]:
    """The keys of a kind of file that others do not have."""
    own, *theirs = (map(spelling.folded, fields_of(each)) for each in (kind, *others))
    return set(own).difference(*theirs)


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"
