"""The architectures, and the control cycle of all of them."""

from collections.abc import Mapping

from mercator_design.config.colours import STATE_COLOURS
from mercator_design.fsm.architecture import PFSM
from mercator_design.jit import type_dispatcher
from mercator_design.modules.architecture import Architecture, Software
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.grammar import Value
from mercator_design.network.architecture import NETWORK
from mercator_design.tree.architecture import TREE

ARCHITECTURES: Mapping[str, Architecture] = {one.name: one for one in (PFSM, TREE, NETWORK)}

control = type_dispatcher({one.program: one.cycle for one in ARCHITECTURES.values()}, argument=1)
"""`control(model, program, readings, memory, draws, actions)`: one control cycle of any control software."""


DARK = -1
"""Stands for no colour: lamps are off."""


def architecture_of(flavour: str) -> Architecture:
    """The architecture of a flavour.

    Raises:
        FsmError: There is no such flavour.
    """
    return ARCHITECTURES[flavour_of(flavour).architecture]


def decoded(configuration: Mapping[str, Value], flavour: str) -> Software:
    """The control software of a configuration of a flavour's grammar."""
    software: Software = architecture_of(flavour).decode(configuration, flavour)
    return software


def part_names(software: Software) -> tuple[str, ...]:
    """The usual names of the parts, of which some can be active."""
    return architecture_of(software.flavour).names(software)


def part_colours(software: Software) -> tuple[int, ...]:
    """The colour of each part, by its number in STATE_COLOURS; DARK of a part that is never active.

    Trees begin with such a part, the root, which stands for no action.
    """
    architecture = architecture_of(software.flavour)
    colours = {part: k % len(STATE_COLOURS) for k, part in enumerate(architecture.active(software))}
    return tuple(colours.get(part, DARK) for part in range(len(architecture.names(software))))


def text_of(software: Software) -> str:
    """The canonical text of control software."""
    return architecture_of(software.flavour).text(software)
