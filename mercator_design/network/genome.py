"""Files of genomes, as NEAT's programs write them: EvoStick's and NEAT's, and those of CMA-ES and xNES without traits.

    /* Organism #3 Fitness: 13850.280000 Time: 0 */
    genomestart 3
    trait 1 0.1 0 0 0 0 0 0 0
    node 1 0 1 1            its number, trait, type (1 sensor, 0 neuron), place (1 input, 3 bias, 2 output, 0 hidden)
    gene 1 1 16 -0.5 0 1 -0.5 1     trait, from, to, weight, is it recurrent, innovation, mutation, is it enabled
    genomeend 3

A file may have several genomes. What has no effect (comments, traits, innovations) is kept. Reading is strict.
"""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from mercator_design.errors import FsmError, excerpt
from mercator_design.modules.tokens import NUMBER, number_text
from mercator_design.network.network import DEFAULT_FLAVOUR, KINDS, MAX_NUMBER, Gene, Network, NetworkNode, problems
from mercator_design.system.files import small_text

_MAX_SIZE = 16 * 1024 * 1024
_INTEGER = re.compile(r"[+-]?[0-9]{1,10}")
_FITNESS = re.compile(rf"Fitness:\s*({NUMBER.pattern})")
_BEGINS = re.compile(r"\s*(?:/\*|genomestart\b)")
_TRAIT = "1 0.1 0 0 0 0 0 0 0"
_OF_NODE = ("the number of the node", "its trait", "its type", "its place")
_OF_GENE = (
    "the trait of the gene",
    "where it comes from",
    "where it leads to",
    "its weight",
    "whether it is recurrent",
    "its innovation",
    "its mutation",
    "whether it is enabled",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Genome:
    """A network with what else a file of genomes says of it.

    network: The network.
    number: Of the genome.
    comments: The comment lines before it.
    traits: The words of each trait.
    node_traits: Of each node, the word for its trait; by default 0.
    marks: Of each gene, the words for its trait, recurrence, innovation and mutation; by default made up.
    """

    network: Network
    number: int = 1
    comments: tuple[str, ...] = ()
    traits: tuple[str, ...] = (_TRAIT,)
    node_traits: tuple[str, ...] = ()
    marks: tuple[tuple[str, str, str, str], ...] = ()

    @property
    def fitness(self) -> float | None:
        """The fitness in its comments; None if it is not there."""
        found = [one for comment in self.comments if (one := _FITNESS.search(comment))]
        return float(found[-1][1]) if found else None


def is_genome(text: str) -> bool:
    """Whether a text begins as a file of genomes."""
    return _BEGINS.match(text) is not None


def read_genomes(path: Path, flavour: str = DEFAULT_FLAVOUR) -> tuple[Genome, ...]:
    """The genomes of a file, one or more.

    Raises:
        FsmError: naming file and line.
    """
    return genomes_of(small_text(path, _MAX_SIZE, FsmError), str(path), flavour)


def genomes_of(text: str, label: str, flavour: str = DEFAULT_FLAVOUR) -> tuple[Genome, ...]:
    """As `read_genomes`, of the text of a file; `label` names it in errors."""
    found: list[Genome] = []
    reader = _Reader(label, flavour)
    for number, line in enumerate(text.splitlines(), start=1):
        if words := line.split():
            found += reader.take(number, line.strip(), words)
    reader.end(bool(found))
    return tuple(found)


class _Reader:
    """Takes the lines of a file one by one, and yields each genome at its end."""

    def __init__(self, label: str, flavour: str) -> None:
        self._label, self._flavour = label, flavour
        self._comments: list[str] = []
        self._line = 0  # of which an error is
        self._started: tuple[int, int] | None = None  # line and number of the genome
        self._clear()

    def _clear(self) -> None:
        self._traits: list[str] = []
        self._nodes: dict[int, tuple[NetworkNode, str]] = {}  # by line, with the trait
        self._genes: dict[int, tuple[Gene, tuple[str, str, str, str]]] = {}

    def take(self, line: int, text: str, words: Sequence[str]) -> Iterator[Genome]:
        self._line = line
        try:
            yield from self._take(line, text, words)
        except FsmError as error:
            raise FsmError(f"{self._label}:{self._line}: {error}") from None

    def end(self, any_found: bool) -> None:
        if self._started:
            line, number = self._started
            raise FsmError(
                f"{self._label}:{line}: expected genomeend {number} after this genome, found the end of the file"
            )
        if not any_found:
            raise FsmError(f"{self._label}: expected a genome, which begins with genomestart, found none")

    def _take(self, line: int, text: str, words: Sequence[str]) -> Iterator[Genome]:
        keyword, *values = words
        if text.startswith("/*"):
            if not text.endswith("*/") or text.find("*/") < len(text) - 2 or len(text) < 4:
                raise FsmError(f"expected a comment that ends with */ at the end of its line, found {excerpt(text)!r}")
            self._comments.append(text)
        elif keyword == "genomestart":
            if self._started:
                raise FsmError(f"expected genomeend {self._started[1]} before the next genome")
            (number,) = _checked(values, ("the number of the genome",), "i")
            self._started = line, int(number)
        elif self._started is None:
            raise FsmError(f"expected genomestart and the number of a genome, found {excerpt(text)!r}")
        elif keyword == "genomeend":
            (number,) = _checked(values, ("the number of the genome",), "i")
            if int(number) != self._started[1]:
                raise FsmError(f"expected genomeend {self._started[1]}, as it began, found genomeend {number}")
            yield self._genome(int(number))
        elif keyword == "trait":
            if not values or not all(map(NUMBER.fullmatch, values)):
                raise FsmError(f"trait: expected numbers, found {excerpt(' '.join(values))!r}")
            self._traits.append(" ".join(values))
        elif keyword == "node":
            self._take_node(line, values)
        elif keyword == "gene":
            self._take_gene(line, values)
        else:
            raise FsmError(f"expected trait, node, gene or genomeend, found {excerpt(keyword)!r}")

    def _take_node(self, line: int, values: Sequence[str]) -> None:
        number, trait, of_type, place = _checked(values, _OF_NODE, "iiii")
        if int(place) not in range(len(KINDS)):
            known = ", ".join(f"{k} {kind}" for k, kind in enumerate(KINDS))
            raise FsmError(f"node {number}: its place: expected one of {known}, found {place}")
        kind = KINDS[int(place)]
        expected = 1 if kind in {"input", "bias"} else 0
        if int(of_type) != expected:
            raise FsmError(
                f"node {number}: its type: expected {expected}, as its place is {place} ({kind}), found {of_type}"
            )
        if self._genes:
            raise FsmError(f"node {number}: expected all nodes before the first gene")
        self._nodes[line] = NetworkNode(int(number), kind), trait

    def _take_gene(self, line: int, values: Sequence[str]) -> None:
        trait, source, target, weight, recurrent, innovation, mutation, enabled = _checked(values, _OF_GENE, "iiininni")
        for name, value in (("whether it is recurrent", recurrent), ("whether it is enabled", enabled)):
            if int(value) not in {0, 1}:
                raise FsmError(f"gene from {source} to {target}: {name}: expected 0 or 1, found {value}")
        gene = Gene(int(source), int(target), float(weight), bool(int(enabled)))
        self._genes[line] = gene, (trait, recurrent, innovation, mutation)

    def _genome(self, number: int) -> Genome:
        nodes, node_traits = [*zip(*self._nodes.values(), strict=True)] or [(), ()]
        genes, marks = [*zip(*self._genes.values(), strict=True)] or [(), ()]
        for problem in problems(nodes, genes):
            if problem.number:
                self._line = [*(self._nodes if problem.part == "nodes" else self._genes)][problem.number - 1]
            raise FsmError(problem.message)
        genome = Genome(
            network=Network(tuple(nodes), tuple(genes), self._flavour),
            number=number,
            comments=tuple(self._comments),
            traits=tuple(self._traits),
            node_traits=tuple(node_traits),
            marks=tuple(marks),
        )
        self._started, self._comments = None, []
        self._clear()
        return genome


def _checked(values: Sequence[str], names: Sequence[str], kinds: str) -> Sequence[str]:
    """The values of a line, if they are as many numbers as it should have: whole ones (i), or finite ones (n)."""
    if len(values) != len(names):
        expected = f"{len(names)} value{'s' * (len(names) != 1)} ({', '.join(names)})"
        raise FsmError(f"expected {expected}, found {len(values)}")
    for name, value, kind in zip(names, values, kinds, strict=True):
        if kind == "i":
            if not _INTEGER.fullmatch(value) or abs(int(value)) > MAX_NUMBER:
                raise FsmError(f"{name}: expected a whole number, found {excerpt(value)!r}")
        elif not NUMBER.fullmatch(value) or not math.isfinite(float(value)):
            raise FsmError(f"{name}: expected a number, found {excerpt(value)!r}")
    return values


def genome_text(genome: Genome) -> str:
    """The text of a file of this genome, without loss, in the form with traits unless it was read without them."""
    network, number = genome.network, genome.number
    node_traits = genome.node_traits or ("0",) * len(network.all_nodes)
    marks = genome.marks or tuple(
        ("1", "0", str(k), number_text(gene.weight)) for k, gene in enumerate(network.genes, start=1)
    )
    lines = [*genome.comments, f"genomestart {number}", *(f"trait {trait}" for trait in genome.traits)]
    for node, trait in zip(network.all_nodes, node_traits, strict=True):
        place = KINDS.index(node.kind)
        lines.append(f"node {node.number} {trait} {int(node.kind in {'input', 'bias'})} {place}")
    for gene, (trait, recurrent, innovation, mutation) in zip(network.genes, marks, strict=True):
        weight = number_text(gene.weight)
        ends = f"{gene.source} {gene.target} {weight} {recurrent} {innovation} {mutation} {int(gene.enabled)}"
        lines.append(f"gene {trait} {ends}")
    return "\n".join([*lines, f"genomeend {number}", ""])
