"""Networks as an architecture of control software."""

from collections.abc import Sequence

from mercator_design.modules.architecture import Architecture
from mercator_design.modules.module import KnownSwarm
from mercator_design.modules.perception import MutableRow
from mercator_design.network import words
from mercator_design.network.control import network_cycle
from mercator_design.network.difference import difference
from mercator_design.network.grammar import from_network, parameters_of, to_network
from mercator_design.network.network import FIRST, Network, NetworkProgram
from mercator_design.network.text import parse, to_text


def _simplest(flavour: str) -> Network:
    """A network that stands still."""
    return to_network({one.name: 0.0 for one in parameters_of(flavour)}, flavour)


def _explanation(network: Network, names: Sequence[str], swarm: KnownSwarm) -> str:  # noqa: ARG001 - one part
    return words.explanation(network)


def _activations(network: Network, memory: MutableRow) -> list[int]:
    """Inputs, then neurons in the order of the genome, in hundredths; an input above 1 is 1."""
    n = len(network.all_nodes)
    return [round(100.0 * min(max(memory[FIRST + k], 0.0), 1.0)) for k in range(n)]


NETWORK = Architecture(
    name="network",
    noun="network",
    kind=Network,
    program=NetworkProgram,
    cycle=network_cycle,
    parse=parse,
    text=to_text,
    parameters=parameters_of,
    decode=to_network,
    encode=from_network,
    structure=lambda *_: None,
    simplest=_simplest,
    names=lambda _: ("network",),
    active=lambda _: (0,),
    activity=_activations,
    explanation=_explanation,
    difference=difference,
    reason=lambda *_: "",
)
