"""mdesign fsm: reads, draws, checks and simplifies PFSMs."""

from collections.abc import Mapping
from typing import Final

import click

from mercator_design.command import LazyGroup, LazyVerb

VERBS: Final[Mapping[str, LazyVerb]] = {
    "diff": LazyVerb("mercator_design.cli.machines.diff", "Say how two PFSMs differ.", is_light=True),
    "explain": LazyVerb(
        "mercator_design.cli.machines.explain", "Say in plain sentences what a PFSM does.", is_light=True
    ),
    "lint": LazyVerb("mercator_design.cli.machines.lint", "Find what is wrong or superfluous in a PFSM."),
    "show": LazyVerb("mercator_design.cli.machines.show", "Draw a PFSM, or write it in another form.", is_light=True),
    "simplify": LazyVerb("mercator_design.cli.machines.simplify", "Remove states and transitions that do not matter."),
}


@click.group(cls=LazyGroup, lazy=VERBS)
def fsm() -> None:
    """Draw, explain, check, simplify and compare PFSMs.

    Each verb reads an fsm.txt or an fsm.yaml.
    """
