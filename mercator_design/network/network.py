"""The neural network: its nodes and genes, what makes it valid, and its tables for the kernels."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Never

from mercator_design.errors import FsmError
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.perception import Row
from mercator_design.modules.reference import senses_bits
from mercator_design.network.inputs import INPUTS, N_INPUTS, Input

DEFAULT_FLAVOUR = "evostick"

KINDS = ("hidden", "input", "output", "bias")
"""The kinds of nodes, by their numbers in genome files."""

OUTPUTS = ("left", "right")
"""The wheels, in the order of the output nodes."""

MAX_NODES = 200
MAX_GENES = 2000
MAX_NUMBER = 10**9
MAX_WEIGHT = 1e6
"""Limits of what is read; published networks have up to 30 nodes, 60 genes, and weights within -8 to 8."""


class NetworkNode(NamedTuple):
    """A node, with its number in genomes."""

    number: int
    kind: str  # one of KINDS


class Gene(NamedTuple):
    """A link from one node to another, by their numbers; one that is not enabled has no effect."""

    source: int
    target: int
    weight: float
    enabled: bool = True


FIRST = 3
"""Place in a network's memory from which on there are the inputs, then three rows of the neurons (control.py)."""


class NetworkProgram(NamedTuple):
    """A network as tables of numbers: tuples here, numpy arrays of the same length in compiled code.

    Inputs are numbered in their order, the neurons (hidden and output nodes) behind them in that of the genome.
    """

    starts: Row  # of each neuron's links; and the end of the last
    sources: Row  # of each link, number of an input or neuron
    parameters: Row  # of each link, its weight
    inputs: Row  # (1,) how many there are
    outputs: Row  # numbers of the neurons of the left and right wheel, counted among neurons
    reads: Row  # for the only part, the senses that the network reads, as bits (modules.SENSES)

    @property
    def memory(self) -> int:
        """Count of the numbers that it keeps from cycle to cycle (control.py)."""
        return FIRST + int(self.inputs[0]) + 3 * (len(self.starts) - 1)


@dataclass(frozen=True, slots=True)
class Network:
    """A valid neural network: nodes in the order in which they are computed, and genes.

    Raises:
        FsmError: on a flavour that does not exist; two nodes of a number; other inputs than those of a version of the
            reference model, with the bias as the last one; not two outputs; a gene from or to a node that does not
            exist, to an input, or the same as another; a weight that is not finite or huge; more than 200 nodes or 2000
            genes.
    """

    all_nodes: tuple[NetworkNode, ...]
    genes: tuple[Gene, ...]
    flavour: str = DEFAULT_FLAVOUR

    def __post_init__(self) -> None:
        flavour_of(self.flavour, "network")
        for problem in problems(self.all_nodes, self.genes):
            raise FsmError(problem.message)

    def __repr__(self) -> str:
        return f"<Network: {self.summary}>"

    @property
    def summary(self) -> str:
        """Flavour, numbers of inputs, hidden nodes and weights in a line."""
        n_hidden = len(self.hidden)
        hidden = f"{n_hidden or 'no'} hidden node{'s' * (n_hidden != 1)}"
        n = sum(gene.enabled for gene in self.genes)
        off = f" ({len(self.genes) - n} disabled)" * (n < len(self.genes))
        return f"{self.flavour}, network of {len(self.inputs)} inputs, {hidden}, {n} weight{'s' * (n != 1)}{off}"

    @property
    def reference_model(self) -> str:
        """The version of the reference model that its inputs are of."""
        n = sum(node.kind in {"input", "bias"} for node in self.all_nodes)
        return next(name for name, inputs in INPUTS.items() if len(inputs) == n)

    @property
    def inputs(self) -> dict[int, Input]:
        """The inputs by the numbers of their nodes."""
        numbers = [node.number for node in self.all_nodes if node.kind in {"input", "bias"}]
        return dict(zip(numbers, INPUTS[self.reference_model], strict=True))

    @property
    def outputs(self) -> dict[int, str]:
        """The wheels by the numbers of the output nodes."""
        numbers = [node.number for node in self.all_nodes if node.kind == "output"]
        return dict(zip(numbers, OUTPUTS, strict=True))

    @property
    def order(self) -> tuple[int, ...]:
        """The numbers of all nodes as in the tables: inputs, then neurons in the order of the genome."""
        inputs = self.inputs
        return (*inputs, *(node.number for node in self.all_nodes if node.number not in inputs))

    @property
    def hidden(self) -> tuple[int, ...]:
        """The numbers of the hidden nodes."""
        return tuple(node.number for node in self.all_nodes if node.kind == "hidden")

    @property
    def names(self) -> dict[int, str]:
        """Names of the nodes, by their numbers."""
        inputs = {number: one.name for number, one in self.inputs.items()}
        outputs = {number: f"{wheel} wheel" for number, wheel in self.outputs.items()}
        return {**inputs, **outputs, **{number: f"hidden node {number}" for number in self.hidden}}

    @property
    def nodes(self) -> Iterator[tuple[str, Never]]:
        """Its modules: a network has none."""
        return iter(())

    @property
    def enabled(self) -> Iterator[Gene]:
        """The genes that have an effect."""
        return (gene for gene in self.genes if gene.enabled)

    @property
    def reads(self) -> frozenset[str]:
        """The senses that a robot must have to run this network.

        Light is not one of them: to a robot without light sensors it is always dark, as EvoStick's authors ran it.
        """
        return self._read - {"light"}

    @property
    def _read(self) -> frozenset[str]:
        inputs = self.inputs
        return frozenset(inputs[gene.source].sense for gene in self.enabled if gene.source in inputs) - {""}

    @property
    def draws(self) -> int:
        """Uniform draws of a cycle: one for what each floor input is on gray floor."""
        return sum("floor" in one.name for one in self.inputs.values())

    def program(self) -> NetworkProgram:
        """The tables that `network_cycle` runs on."""
        neurons = self.order[len(self.inputs) :]
        number = {node: k for k, node in enumerate(self.order)}
        links = {neuron: [gene for gene in self.enabled if gene.target == neuron] for neuron in neurons}
        starts = [0]
        for neuron in neurons:
            starts.append(starts[-1] + len(links[neuron]))
        genes = [gene for neuron in neurons for gene in links[neuron]]
        return NetworkProgram(
            starts=tuple(starts),
            sources=tuple(number[gene.source] for gene in genes),
            parameters=tuple(float(gene.weight) for gene in genes),
            inputs=(len(self.inputs),),
            outputs=tuple(neurons.index(node) for node in self.outputs),
            reads=(senses_bits(self._read),),
        )


def perceptron_nodes() -> tuple[NetworkNode, ...]:
    """The nodes of a network without hidden ones, of reference model 1.2."""
    inputs = [NetworkNode(k, "bias" if k == N_INPUTS else "input") for k in range(1, N_INPUTS + 1)]
    return (*inputs, NetworkNode(N_INPUTS + 1, "output"), NetworkNode(N_INPUTS + 2, "output"))


class NetworkProblem(NamedTuple):
    """A mistake in a network: the list, the place in it from 1 on (0: of the whole network), the message."""

    part: str  # nodes or genes
    number: int
    message: str


def problems(nodes: Sequence[NetworkNode], genes: Sequence[Gene]) -> Iterator[NetworkProblem]:
    """The mistakes in a network of these nodes and genes."""
    if len(nodes) > MAX_NODES:
        yield NetworkProblem("nodes", 0, f"expected at most {MAX_NODES} nodes, found {len(nodes)}")
    if len(genes) > MAX_GENES:
        yield NetworkProblem("genes", 0, f"expected at most {MAX_GENES} genes, found {len(genes)}")
    for number, message in _of_nodes(nodes):
        place = f"node {nodes[number - 1].number} (the {_ordinal(number)}): " if number else ""
        yield NetworkProblem("nodes", number, f"{place}{message}")
    for number, message in _of_genes(nodes, genes):
        gene = genes[number - 1]
        yield NetworkProblem("genes", number, f"gene {number} (from {gene.source} to {gene.target}): {message}")


def _of_nodes(nodes: Sequence[NetworkNode]) -> Iterator[tuple[int, str]]:
    seen: set[int] = set()
    for k, (number, kind) in enumerate(nodes, start=1):
        if not 0 <= number <= MAX_NUMBER:
            yield k, f"expected a number from 0 to {MAX_NUMBER}"
        if number in seen:
            yield k, "another node has this number"
        if kind not in KINDS:
            yield k, f"expected one of {', '.join(KINDS)}, found {kind!r}"
        seen.add(number)
    inputs = [k for k, node in enumerate(nodes, start=1) if node.kind in {"input", "bias"}]
    if len(inputs) not in {len(known) for known in INPUTS.values()}:
        expected = " or ".join(f"{len(known)} (reference model {name})" for name, known in INPUTS.items())
        yield 0, f"expected {expected} inputs, with the bias, found {len(inputs)}"
    for k in inputs:
        if (nodes[k - 1].kind == "bias") != (k == inputs[-1]):
            found = nodes[k - 1].kind
            yield k, f"expected the bias as the last of the inputs, and only there, found {found} as one of them"
    n_outputs = sum(node.kind == "output" for node in nodes)
    if n_outputs != len(OUTPUTS):
        yield 0, f"expected 2 output nodes, of the left and right wheel, found {n_outputs}"


def _of_genes(nodes: Sequence[NetworkNode], genes: Sequence[Gene]) -> Iterator[tuple[int, str]]:
    kinds = {node.number: node.kind for node in nodes}
    first: dict[tuple[int, int], int] = {}
    for k, gene in enumerate(genes, start=1):
        for end in gene[:2]:
            if end not in kinds:
                yield k, f"expected the number of a node, found {end}"
        if kinds.get(gene.target) in {"input", "bias"}:
            yield k, f"expected a hidden or output node as its end, found {gene.target}, an input"
        if (other := first.setdefault(gene[:2], k)) != k:
            yield k, f"gene {other} joins the same nodes"
        if not (math.isfinite(gene.weight) and abs(gene.weight) <= MAX_WEIGHT):
            yield k, f"expected a weight from {-MAX_WEIGHT:g} to {MAX_WEIGHT:g}, found {gene.weight:g}"


def _ordinal(k: int) -> str:
    """A number as "1st"."""
    ending = "th" if k % 100 in {11, 12, 13} else {1: "st", 2: "nd", 3: "rd"}.get(k % 10, "th")
    return f"{k}{ending}"
