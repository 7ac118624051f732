"""The networks that are designed: the weights of a network without hidden nodes, as a space of parameters."""

from collections.abc import Iterator, Mapping

from mercator_design.errors import FsmError
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.grammar import GrammarParameter, Value
from mercator_design.network.inputs import N_INPUTS
from mercator_design.network.network import Gene, Network, perceptron_nodes
from mercator_design.network.text import WEIGHTS, name_of

_DIGITS = 4
"""Decimals of designed weights."""


def parameters_of(flavour: str) -> Iterator[GrammarParameter]:
    """The weights of a flavour, 30, in the order of EvoStick's genomes."""
    highest = float(flavour_of(flavour).limit("weight"))
    for side, k in WEIGHTS:
        name = name_of(side, k)
        yield GrammarParameter(name, f"--{name} ", low=-highest, high=highest, digits=_DIGITS)


def to_network(configuration: Mapping[str, Value], flavour: str) -> Network:
    """The network of a configuration."""
    genes = [Gene(k, N_INPUTS + 1 + side, float(configuration[name_of(side, k)])) for side, k in WEIGHTS]
    return Network(perceptron_nodes(), tuple(genes), flavour)


def from_network(network: Network) -> dict[str, Value]:
    """The configuration of a network; a weight is 0 where there is no link.

    Raises:
        FsmError: No configuration has this meaning: the network has hidden nodes, links between wheels, other inputs,
            or a wheel that no input can reach.
    """
    inputs = {number: k for k, number in enumerate(network.inputs, start=1)}
    sides = {number: side for side, number in enumerate(network.outputs)}
    weights: dict[tuple[int, int], float] = {}
    for gene in network.enabled:
        if gene.source not in inputs or gene.target not in sides:
            raise FsmError(
                f"races design networks without hidden nodes and without links between wheels; found a gene from "
                f"{gene.source} to {gene.target}"
            )
        weights[sides[gene.target], inputs[gene.source]] = gene.weight
    if network.reference_model != "1.2" or {side for side, _ in weights} != {*sides.values()}:
        raise FsmError(
            f"races design networks of {N_INPUTS} inputs with a link to each wheel; found {len(inputs)} inputs and "
            f"links to {len({side for side, _ in weights})} of 2 wheels"
        )
    return {name_of(side, k): weights.get((side, k), 0.0) for side, k in WEIGHTS}
