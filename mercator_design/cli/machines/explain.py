"""mdesign fsm explain: a PFSM in plain sentences."""

from pathlib import Path

import click

from mercator_design.cli.machines.swarm import swarm_of
from mercator_design.cli.terminal import terminal_width, wrapped
from mercator_design.command import FLAVOUR, FSM, LENIENT, print_result, read_controller
from mercator_design.software.architectures import architecture_of


@click.command()
@click.argument("fsm", type=FSM)
@click.option(
    "--mission",
    help="Mission of the robots. YAML file or shipped name.  [default: the mission in FSM's header, if there is one]",
)
@FLAVOUR
@LENIENT
def explain(fsm: Path, mission: str | None, flavour: str | None, lenient: bool) -> None:
    """Say in plain sentences what robots do, state by state of a PFSM, node by node of a behaviour tree.

    The number of robots and the control period are those of the mission. If none is known, the number of robots is not
    mentioned, and the control period is 0.1 s.
    """
    file = read_controller(fsm, flavour, lenient=lenient)
    architecture = architecture_of(file.software.flavour)
    words = architecture.explanation(file.software, file.names, swarm_of(fsm, file, mission))
    print_result(wrapped(words, terminal_width()), nl=False)
