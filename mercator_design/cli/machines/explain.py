"""mdesign fsm explain: a PFSM in plain sentences."""

from pathlib import Path

import click

from mercator_design.command import FILE, FLAVOUR, LENIENT, print_result, read_controller
from mercator_design.config.loading import parse
from mercator_design.config.schema import Positive
from mercator_design.errors import FsmError
from mercator_design.fsm.words.explain import explanation
from mercator_design.robot.devices.settings import CONTROL_PERIOD


@click.command()
@click.argument("fsm", type=FILE)
@FLAVOUR
@LENIENT
def explain(fsm: Path, flavour: str | None, lenient: bool) -> None:
    """Say in plain sentences what robots with a PFSM do, state by state.

    Times are of the control period in FSM's header, or of 0.1 s.
    """
    file = read_controller(fsm, flavour, lenient=lenient)
    cycle = parse(
        file.header.get("control period", str(CONTROL_PERIOD)),
        Positive,
        error=FsmError,
        label=f"{fsm}: control period in the header",
        lines=False,
    )
    print_result(explanation(file.pfsm, file.names, cycle), nl=False)
