"""mdesign schema: the JSON Schema of missions, robot models, PFSMs and studies, for editors."""

import json
from typing import Any

import click

from mercator_design.cli.contents import kind_of_name
from mercator_design.cli.options import PLUGIN
from mercator_design.command import print_result
from mercator_design.config.json_schema import json_schema
from mercator_design.fsm.yaml_form import NamedPfsm
from mercator_design.missions.mission import Mission
from mercator_design.sim.robot_model import RobotModel
from mercator_design.studies.plan import StudyPlan


class _Kind(click.Choice):  # type: ignore[type-arg]  # has no argument in click before 8.2
    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:  # noqa: ANN401
        return str(super().convert(kind_of_name(str(value)) or value, param, ctx))


@click.command()
@click.argument("kind", type=_Kind(["mission", "robot-model", "fsm", "study"]), default="mission")
@PLUGIN
def schema(kind: str) -> None:
    """Print the JSON Schema of a mission, a robot model, an fsm.yaml or a study, for an editor to check it.

    The name of a shipped file stands for its kind.

    \b
    mdesign schema > mission.schema.json
    and, as the first line of a mission beside it:
    # yaml-language-server: $schema=mission.schema.json
    """  # noqa: D301 - click reads the control character
    if kind == "mission":
        found = json_schema(Mission, title="A mission", given=("name",))
    elif kind == "study":
        found = json_schema(StudyPlan, title="A study", given=("name",))
    elif kind == "fsm":
        found = json_schema(NamedPfsm, title="A PFSM")
    else:
        found = json_schema(RobotModel, title="A robot model", given=("name",), based=True)
    print_result(json.dumps(found, indent=2))
