"""mdesign fsm diff: how two PFSMs, behaviour trees or networks differ."""

from pathlib import Path

import click

from mercator_design.command import FSM, LENIENT, PLUGIN_OPTION, beginning, load_given, print_result, read_controller
from mercator_design.errors import FsmError
from mercator_design.software.architectures import architecture_of

_NO_EFFECT = {
    "pfsm": "states that cannot be reached",
    "tree": "the order of conditions and in what is never reached",
    "network": "disabled links and the numbers of nodes",
}


@click.command()
@click.argument("one", type=FSM)
@click.argument("other", type=FSM)
@click.option(
    "--flavour",
    metavar="NAME|FILE.yaml",
    help="Flavour of the module numbers.  [default: that of each file's header, else watermelon]",
)
@PLUGIN_OPTION
@LENIENT
@beginning(load_given)
def diff(one: Path, other: Path, flavour: str | None, lenient: bool) -> None:
    """Say how the PFSM, tree or network of OTHER differs from that of ONE: in parts, parameters and weights.

    States of PFSMs are matched so that there are fewest changes, and called by their names in ONE; nodes of trees from
    the root down; links of networks by the nodes that they join, the largest changes first.
    """
    old, new = (read_controller(file, flavour, lenient=lenient) for file in (one, other))
    architecture, other_architecture = (architecture_of(file.software.flavour) for file in (old, new))
    if architecture is not other_architecture:
        found_nouns = f"a {architecture.noun} and a {other_architecture.noun}"
        raise FsmError(f"{one}, {other}: expected two files of one kind, found {found_nouns}")
    found = architecture.difference(old.software, new.software, old.names, new.names)
    words = {
        "same": f"the same {architecture.noun}",
        "renumbered": f"the same {architecture.noun}, but for the order of states and transitions",
        "equivalent": f"these do the same, as they differ only in {_NO_EFFECT[architecture.name]}",
        "different": "these differ",
    }
    print_result("\n".join([words[found.kind], *(f"  {change}" for change in found.changes)]))
