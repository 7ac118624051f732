"""mdesign fsm diff: how two PFSMs differ."""

from pathlib import Path

import click

from mercator_design.command import FILE, LENIENT, PLUGIN_OPTION, beginning, load_given, print_result, read_controller
from mercator_design.fsm.words.difference import difference

_WORDS = {
    "same": "the same PFSM",
    "renumbered": "the same PFSM, but for the order of states and transitions",
    "equivalent": "these do the same, as they differ only in states that cannot be reached",
    "different": "these differ",
}


@click.command()
@click.argument("one", type=FILE)
@click.argument("other", type=FILE)
@click.option(
    "--flavour",
    metavar="NAME|FILE.yaml",
    help="Flavour of the module numbers.  [default: that of each file's header, else watermelon]",
)
@PLUGIN_OPTION
@LENIENT
@beginning(load_given)
def diff(one: Path, other: Path, flavour: str | None, lenient: bool) -> None:
    """Say how the PFSM of OTHER differs from that of ONE: in states, transitions and parameters.

    States are matched so that there are fewest changes, and called by their names in ONE.
    """
    old, new = (read_controller(file, flavour, lenient=lenient) for file in (one, other))
    found = difference(old.pfsm, new.pfsm, old.names, new.names)
    print_result("\n".join([_WORDS[found.kind], *(f"  {change}" for change in found.changes)]))
