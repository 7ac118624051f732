"""How two networks differ, in words: links are matched by the nodes that they join."""

from collections.abc import Iterator, Sequence
from typing import Literal

from mercator_design.modules.architecture import Difference
from mercator_design.modules.flavour import same_constants
from mercator_design.network.network import Gene, Network

_Ends = tuple[str, str]


def difference(one: Network, other: Network, *_: Sequence[str]) -> Difference:
    """How a network differs from one other: the largest changes of weights first.

    They are equivalent if their tables are the same: they differ in links that are disabled, and in numbers of nodes.
    """
    if (one.flavour, one.all_nodes, one.genes) == (other.flavour, other.all_nodes, other.genes):
        return Difference("same", ())
    changes = tuple(_changes(one, other))
    alike = same_constants(one.flavour, other.flavour) and one.reference_model == other.reference_model
    kind: Literal["equivalent", "different"] = (
        "equivalent" if alike and one.program() == other.program() else "different"
    )
    return Difference(kind, changes)


def _changes(one: Network, other: Network) -> Iterator[str]:
    if one.flavour != other.flavour:
        yield f"the flavour is {other.flavour}, was {one.flavour}"
    if one.reference_model != other.reference_model:
        yield f"the inputs are of reference model {other.reference_model}, were of {one.reference_model}"
    old, new = _links(one), _links(other)
    for ends in sorted(old.keys() & new.keys(), key=lambda ends: -abs(new[ends].weight - old[ends].weight)):
        before, after = old[ends], new[ends]
        if before.weight != after.weight:
            yield f"{_named(ends)}: weight {before.weight:.6g} -> {after.weight:.6g}"
        if before.enabled != after.enabled:
            yield f"{_named(ends)}: {'enabled' if after.enabled else 'disabled'}"
    for ends in old:
        if ends not in new:
            yield f"{_named(ends)} is gone: weight {old[ends].weight:.6g}{_off(old[ends])}"
    for ends in new:
        if ends not in old:
            yield f"new link {_named(ends)}: weight {new[ends].weight:.6g}{_off(new[ends])}"
    for number in sorted({*one.hidden} ^ {*other.hidden}):
        yield f"hidden node {number} is gone" if number in one.hidden else f"new hidden node {number}"


def _links(network: Network) -> dict[_Ends, Gene]:
    names = network.names
    return {(names[gene.source], names[gene.target]): gene for gene in network.genes}


def _named(ends: _Ends) -> str:
    return f"{ends[0]} to {ends[1]}"


def _off(gene: Gene) -> str:
    return "" if gene.enabled else ", disabled"
