"""mdesign draw: a controller's diagram."""

from pathlib import Path

import click

from mercator_design.command import FILE, FLAVOUR, LENIENT, print_result, read_controller
from mercator_design.report.pictures.fsm_diagram import to_dot


@click.command(short_help="Print the diagram of an fsm.txt as Graphviz text.")
@click.argument("fsm", type=FILE)
@FLAVOUR
@LENIENT
def draw(fsm: Path, flavour: str | None, lenient: bool) -> None:
    """Print the diagram of an fsm.txt as Graphviz text, e.g. for `| dot -Tsvg > fsm.svg`."""
    print_result(to_dot(read_controller(fsm, flavour, lenient=lenient).pfsm), nl=False)
