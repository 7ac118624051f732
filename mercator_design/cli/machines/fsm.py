"""mdesign fsm: reads, draws, checks and simplifies control software."""

from collections.abc import Mapping
from typing import Final

import click

from mercator_design.command import LazyGroup, LazyVerb

VERBS: Final[Mapping[str, LazyVerb]] = {
    "diff": LazyVerb("mercator_design.cli.machines.diff", "Say how control software differs.", is_light=True),
    "explain": LazyVerb(
        "mercator_design.cli.machines.explain", "Say in plain sentences what control software does.", is_light=True
    ),
    "lint": LazyVerb("mercator_design.cli.machines.lint", "Find what is wrong or superfluous in a PFSM or tree."),
    "show": LazyVerb("mercator_design.cli.machines.show", "Draw it, or write it in another form.", is_light=True),
    "simplify": LazyVerb("mercator_design.cli.machines.simplify", "Remove states and transitions that do not matter."),
}


@click.group(cls=LazyGroup, lazy=VERBS)
def fsm() -> None:
    """Draw, explain, check, simplify and compare PFSMs, behaviour trees and networks.

    Each verb reads an fsm.txt, an fsm.yaml (PFSMs) or a file of a genome (networks). What cannot be done with trees or
    networks is refused.
    """
