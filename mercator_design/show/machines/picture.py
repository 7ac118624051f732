"""The diagram of control software of any architecture."""

from collections.abc import Callable, Mapping
from typing import Any

from mercator_design.fsm.pfsm import Pfsm
from mercator_design.modules.architecture import Software
from mercator_design.network.network import Network
from mercator_design.show.machines.diagram import diagram_svg
from mercator_design.show.machines.network_diagram import network_svg

DIAGRAMS: Mapping[type, Callable[..., Any]] = {Pfsm: diagram_svg, Network: network_svg}
"""`diagram(software, narrow=False)`: an SVG picture, by the class of control software."""


def software_svg(software: Software, *, narrow: bool = False) -> Any:  # noqa: ANN401 - as diagram_svg returns
    """Control software as an SVG picture; `narrow` as for `diagram_svg`."""
    return DIAGRAMS[type(software)](software, narrow=narrow)
