"""mdesign fsm: reads, draws, checks and simplifies PFSMs."""

from collections.abc import Mapping
from typing import Final

import click

from mercator_design.command import LazyGroup, LazyVerb

VERBS: Final[Mapping[str, LazyVerb]] = {
    "show": LazyVerb("mercator_design.cli.machines.show", "Draw a PFSM, or write it in another form.", is_light=True),
}


@click.group(cls=LazyGroup, lazy=VERBS, short_help="Draw, explain, check, simplify and compare PFSMs.")
def fsm() -> None:
    """Draw, explain, check, simplify and compare PFSMs.

    Each verb reads an fsm.txt or an fsm.yaml.
    """
