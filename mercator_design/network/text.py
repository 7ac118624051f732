"""A network as one line.

    --left1 0.5 --right1 -1.25 --left2 0 ... --left15 1 --right15 3.5

is one without hidden nodes: a weight of each input for each wheel. It is the command line of the parameters of a race.
Any network is

    --nodes 1:input 2:input ... 15:bias 16:output 17:output 18:hidden --genes 1:16:0.5 1:18:-2 18:16:1:off ...

The order of weights, nodes and genes is that in which they are computed. Reading is strict.
"""

import math
import re
from collections.abc import Iterable, Iterator, Sequence

from mercator_design.errors import FsmError, excerpt
from mercator_design.modules.architecture import Warn
from mercator_design.modules.tokens import NUMBER, number_text, tokens_of
from mercator_design.network.inputs import N_INPUTS
from mercator_design.network.network import (
    DEFAULT_FLAVOUR,
    KINDS,
    OUTPUTS,
    Gene,
    Network,
    NetworkNode,
    perceptron_nodes,
)

_WEIGHT = re.compile(rf"--({'|'.join(OUTPUTS)})([1-9][0-9]*)")
_NODE_NUMBER = re.compile(r"0|[1-9][0-9]{0,9}")
_MAX_TOKEN = 60

WEIGHTS = tuple((side, k) for k in range(1, N_INPUTS + 1) for side in range(len(OUTPUTS)))
"""Wheel and number of the input of each weight of a network without hidden nodes, in the order of genomes."""


def name_of(side: int, k: int) -> str:
    """The name of the weight of input k, from 1 on, for a wheel."""
    return f"{OUTPUTS[side]}{k}"


def parse(line: str, flavour: str = DEFAULT_FLAVOUR, *, tolerate: Warn | None = None) -> Network:  # noqa: ARG001
    """The network that a line describes.

    Args:
        line: The text.
        flavour: Of the network.
        tolerate: For nothing: the line is no form of the original programs.

    Raises:
        FsmError: naming the token, or node and gene.
    """
    tokens = tokens_of(line, longest=_MAX_TOKEN)
    if tokens[:1] == ["--nodes"]:
        return _any_network(tokens, flavour)
    return _perceptron(tokens, flavour)


def to_text(network: Network) -> str:
    """The line of a network; `parse` reads it back to an equal one."""
    if is_perceptron(network):
        names = {(side, k): name_of(side, k) for side, k in WEIGHTS}
        ends = {(k, N_INPUTS + 1 + side): name for (side, k), name in names.items()}
        return " ".join(f"--{ends[gene[:2]]} {number_text(gene.weight)}" for gene in network.genes)
    nodes = " ".join(f"{node.number}:{node.kind}" for node in network.all_nodes)
    genes = "".join(
        f" {gene.source}:{gene.target}:{number_text(gene.weight)}{':off' * (not gene.enabled)}"
        for gene in network.genes
    )
    return f"--nodes {nodes} --genes{genes}"


def is_perceptron(network: Network) -> bool:
    """Whether a network has the usual nodes, no hidden ones, and all of their weights."""
    return network.all_nodes == perceptron_nodes() and sum(gene.enabled for gene in network.genes) == len(WEIGHTS)


def _perceptron(tokens: Sequence[str], flavour: str) -> Network:
    weights: dict[tuple[int, int], float] = {}
    for flag, value in zip(tokens[::2], [*tokens[1::2], ""], strict=False):
        found = _WEIGHT.fullmatch(flag)
        key = (OUTPUTS.index(found[1]), int(found[2])) if found else None
        if key not in WEIGHTS:
            first, last = name_of(*WEIGHTS[0]), name_of(*WEIGHTS[-1])
            raise FsmError(f"expected --nodes, or weights from --{first} to --{last}, found {flag!r}")
        if key in weights:
            raise FsmError(f"{flag} is given twice")
        weights[key] = _weight(flag, value)
    if missing := [name_of(*key) for key in WEIGHTS if key not in weights]:
        more = f" and {len(missing) - 1} more" * (len(missing) > 1)
        raise FsmError(f"expected {len(WEIGHTS)} weights, found {len(weights)}: --{missing[0]}{more} missing")
    genes = tuple(Gene(k, N_INPUTS + 1 + side, weight) for (side, k), weight in weights.items())
    return Network(perceptron_nodes(), genes, flavour)


def _any_network(tokens: Sequence[str], flavour: str) -> Network:
    if "--genes" not in tokens:
        raise FsmError("expected --genes behind the nodes, found the end of the text")
    end = tokens.index("--genes")
    nodes = tuple(_nodes(tokens[1:end]))
    return Network(nodes, tuple(_genes(tokens[end + 1 :])), flavour)


def _nodes(tokens: Iterable[str]) -> Iterator[NetworkNode]:
    for k, token in enumerate(tokens, start=1):
        number, _, kind = token.partition(":")
        if not _NODE_NUMBER.fullmatch(number) or kind not in KINDS:
            raise FsmError(f"--nodes, node {k}: expected its number and kind, such as 16:output, found {token!r}")
        yield NetworkNode(int(number), kind)


def _genes(tokens: Iterable[str]) -> Iterator[Gene]:
    for k, token in enumerate(tokens, start=1):
        place = f"--genes, gene {k}"
        source, target, weight, *switch = [*token.split(":"), "", ""][: max(3, token.count(":") + 1)]
        if not (_NODE_NUMBER.fullmatch(source) and _NODE_NUMBER.fullmatch(target)) or switch not in ([], ["off"]):
            raise FsmError(
                f"{place}: expected two nodes and a weight, such as 1:16:0.5 or 1:16:0.5:off, found {token!r}"
            )
        yield Gene(int(source), int(target), _weight(f"{place} ({token})", weight), not switch)


def _weight(place: str, text: str) -> float:
    if not NUMBER.fullmatch(text) or not math.isfinite(float(text)):
        raise FsmError(f"{place}: expected a weight, found {excerpt(text) or 'the end of the text'!r}")
    return float(text)
