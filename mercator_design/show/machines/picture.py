"""Control software of any architecture as a picture, and in the notations of other programs."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from mercator_design.errors import FsmError
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.modules.architecture import Software
from mercator_design.network.genome import Genome, genome_text
from mercator_design.network.network import Network
from mercator_design.show.machines.diagram import diagram_svg
from mercator_design.show.machines.network_diagram import network_svg
from mercator_design.show.machines.notations import to_dot, to_mermaid, to_tikz
from mercator_design.show.machines.tree_diagram import tree_svg
from mercator_design.show.machines.tree_notations import tree_to_dot, tree_to_mermaid, tree_to_tikz
from mercator_design.software.architectures import architecture_of
from mercator_design.tree.tree import Tree

DIAGRAMS: Mapping[type, Callable[..., Any]] = {Pfsm: diagram_svg, Tree: tree_svg, Network: network_svg}
"""`diagram(software, names=(), caption=(), narrow=False)`: an SVG picture, by the class of control software."""

NOTATIONS: Mapping[type, Mapping[str, Callable[[Any, tuple[str, ...]], str]]] = {
    Pfsm: {"dot": lambda pfsm, _: to_dot(pfsm), "mermaid": to_mermaid, "tikz": to_tikz},
    Tree: {
        "dot": lambda tree, _: tree_to_dot(tree),
        "mermaid": lambda tree, _: tree_to_mermaid(tree),
        "tikz": lambda tree, _: tree_to_tikz(tree),
    },
    Network: {"genome": lambda network, _: genome_text(Genome(network=network))},
}
"""`notation(software, names)`: a text for another program, by the class of control software and the notation's name."""


def software_svg(
    software: Software, names: Sequence[str] = (), *, caption: Sequence[str] = (), narrow: bool = False
) -> Any:  # noqa: ANN401 - as diagram_svg returns
    """Control software as an SVG picture; arguments as for `diagram_svg`."""
    return DIAGRAMS[type(software)](software, names, caption=caption, narrow=narrow)


def notation_text(notation: str, software: Software, names: tuple[str, ...]) -> str:
    """Control software in the notation of another program.

    Raises:
        FsmError: Its architecture has no such notation.
    """
    known = NOTATIONS.get(type(software), {})
    if notation not in known:
        forms = ", ".join(["svg", *known])
        raise FsmError(f"expected one of {forms} for a {architecture_of(software.flavour).noun}, found {notation}")
    return known[notation](software, names)
