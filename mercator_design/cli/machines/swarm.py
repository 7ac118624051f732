"""The facts on robots that the explanation and the picture of a controller need."""

from pathlib import Path
from typing import Annotated, Any

import click

from mercator_design.command import lack_of_designer, print_note
from mercator_design.config.loading import parse
from mercator_design.config.schema import Kind, Positive, Range
from mercator_design.errors import FsmError, MercatorError
from mercator_design.modules.module import KnownSwarm
from mercator_design.robot.devices.settings import CONTROL_PERIOD
from mercator_design.software.files import FsmFile


def swarm_of(fsm: Path, file: FsmFile, mission: str | None = None) -> KnownSwarm:
    """The robots of a mission, or of the mission in the header of a controller's file.

    The header itself has what is needed, unless it was written by hand or by an earlier version.

    Raises:
        MercatorError: The mission that is given, or an entry of the header, is not valid.
    """
    if mission is not None or ("mission" in file.header and "robots" not in file.header):
        try:
            from mercator_design.cli.inputs import ignore, simulator_of

            given = simulator_of(
                fsm, file, {"mission": mission, "robot_model": None, "overrides": ()}, warn=ignore
            ).mission
        except ModuleNotFoundError as error:
            if mission is not None:
                raise lack_of_designer("--mission", error) from None
        except (MercatorError, click.UsageError) as error:
            if mission is not None:
                raise
            print_note(f"Note: the number of robots is not known: {error}")
        else:
            return KnownSwarm(given.control_period, given.robots)
    cycle = _entry(fsm, file, "control period", Positive)
    robots = _entry(fsm, file, "robots", Annotated[int, Range(1, 1000)])
    return KnownSwarm(CONTROL_PERIOD if cycle is None else cycle, robots)


def _entry(fsm: Path, file: FsmFile, key: str, kind: Kind) -> Any:  # noqa: ANN401 - what `kind` says
    """An entry of a header; None if it is not there."""
    if key not in file.header:
        return None
    return parse(file.header[key], kind, error=FsmError, label=f"{fsm}: {key} in the header", lines=False)
