"""Files of genomes: read, written, and refused with the place."""

import pytest
from hypothesis import given

from mercator_design.errors import FsmError
from mercator_design.network.genome import Genome, genome_text, genomes_of, is_genome, read_genomes
from tests.network.networks import networks, published

NODES = "".join(f"node {k} 0 1 {3 if k == 15 else 1}\n" for k in range(1, 16)) + "node 16 0 0 2\nnode 17 0 0 2\n"
NEAT = (
    "/* Organism #3 Fitness: 13850.280000 Time: 0 */\n"
    "genomestart 3\ntrait 1 0.1 0 0 0 0 0 0 0\n"
    f"{NODES}node 75 0 0 0\n"
    "gene 1 1 16 -0.0868447 0 1 -0.0868447 1\ngene 1 1 17 1e-05 0 2 0 0\ngene 1 75 17 2 1 40 1.5 1\ngenomeend 3\n"
)
PAGMO = f"/*Fitness: 14337.3*/\ngenomestart 1\n{NODES}gene 1 1 16 -5 0 1 0 1\ngene 1 2 16 0.25 0 2 0 1\ngenomeend 1\n"


@pytest.mark.parametrize(
    ("text", "fitness"), [(NEAT, 13850.28), (PAGMO, 14337.3), ("genomestart 1" + PAGMO.split("genomestart 1")[1], None)]
)
def test_both_forms(text, fitness, tmp_path):
    assert is_genome(text)
    file = tmp_path / "gen_3"
    file.write_text(text)
    (genome,) = read_genomes(file)
    assert genome.fitness == fitness
    assert genome_text(genome) == text


def test_what_is_in_it():
    (genome,) = genomes_of(NEAT, "gen_3", "evostick-epuck")
    assert genome.number == 3
    assert genome.network.flavour == "evostick-epuck"
    assert genome.network.all_nodes[-1] == (75, "hidden")
    assert [tuple(gene) for gene in genome.network.genes] == [
        (1, 16, -0.0868447, True),
        (1, 17, 1e-05, False),
        (75, 17, 2.0, True),
    ]
    assert genome.network.summary == "evostick-epuck, network of 15 inputs, 1 hidden node, 2 weights (1 disabled)"


def test_several_in_a_file():
    both = genomes_of(NEAT + "\n" + PAGMO, "population")
    assert [one.number for one in both] == [3, 1]
    assert "\n".join(map(genome_text, both)) == NEAT + "\n" + PAGMO


@given(networks())
def test_written_without_loss(network):
    text = genome_text(Genome(network=network))
    (genome,) = genomes_of(text, "x")
    assert genome.network == network
    assert genome_text(genome) == text


def test_published_networks_are_written_without_loss():
    for network, _ in published().values():
        (genome,) = genomes_of(genome_text(Genome(network=network)), "x")
        assert genome.network == network


LINES = NEAT.splitlines()


@pytest.mark.parametrize(
    ("line", "instead", "message"),
    [
        (1, "/* no end", r"g:1: expected a comment that ends with \*/"),
        (1, "*/", r"g:1: expected genomestart and the number of a genome, found '\*/'"),
        (2, "genomestart", r"g:2: expected 1 value \(the number of the genome\), found 0"),
        (2, "genomestart x", "g:2: the number of the genome: expected a whole number, found 'x'"),
        (3, "trait 1 nan", "g:3: trait: expected numbers"),
        (4, "node 1 0 1", r"g:4: expected 4 values \(the number of the node, .*, its place\), found 3"),
        (4, "node 1 0 0 1", r"g:4: node 1: its type: expected 1, as its place is 1 \(input\), found 0"),
        (4, "node 1 0 1 4", "g:4: node 1: its place: expected one of 0 hidden, 1 input, 2 output, 3 bias, found 4"),
        (4, "node 1.5 0 1 1", "g:4: the number of the node: expected a whole number, found '1.5'"),
        (4, "node -1 0 1 1", r"g:4: node -1 \(the 1st\): expected a number from 0"),
        (4, "node 2 0 1 1", r"g:5: node 2 \(the 2nd\): another node has this number"),
        (4, "node 1 0 1 3", r"g:4: node 1 \(the 1st\): expected the bias as the last .*, found bias"),
        (18, "node 15 0 1 1", r"g:18: node 15 \(the 15th\): expected the bias as the last .*, found input"),
        (4, "", r"g:25: expected 15 \(reference model 1.2\) or 25 .* inputs, with the bias, found 14"),
        (20, "node 17 0 0 0", "g:25: expected 2 output nodes, of the left and right wheel, found 1"),
        (22, "gene 1 1 16 0,5 0 1 0 1", "g:22: its weight: expected a number, found '0,5'"),
        (22, "gene 1 1 16 nan 0 1 0 1", "g:22: its weight: expected a number, found 'nan'"),
        (22, "gene 1 1 16 1e999 0 1 0 1", "g:22: its weight: expected a number, found '1e999'"),
        (22, "gene 1 1 16 2e6 0 1 0 1", r"g:22: gene 1 \(from 1 to 16\): expected a weight from -1e\+06 to 1e\+06"),
        (22, "gene 1 1 16 1 0 1 0 2", "g:22: gene from 1 to 16: whether it is enabled: expected 0 or 1, found 2"),
        (22, "gene 1 1 16 1 7 1 0 1", "g:22: gene from 1 to 16: whether it is recurrent: expected 0 or 1, found 7"),
        (22, "gene 1 1 16 1 0 1 0", "g:22: expected 8 values"),
        (22, "gene 1 99 16 1 0 1 0 1", r"g:22: gene 1 \(from 99 to 16\): expected the number of a node, found 99"),
        (22, "gene 1 16 1 1 0 1 0 1", r"g:22: gene 1 \(from 16 to 1\): expected a hidden or output node as its end"),
        (23, "gene 1 1 16 1 0 1 0 1", r"g:23: gene 2 \(from 1 to 16\): gene 1 joins the same nodes"),
        (24, "node 80 0 0 0", "g:24: node 80: expected all nodes before the first gene"),
        (24, "gnee 1", "g:24: expected trait, node, gene or genomeend, found 'gnee'"),
        (25, "genomeend 4", "g:25: expected genomeend 3, as it began, found genomeend 4"),
        (25, "", "g:2: expected genomeend 3 after this genome, found the end of the file"),
        (25, "genomestart 4", "g:25: expected genomeend 3 before the next genome"),
    ],
)  # fmt: skip
def test_mistakes(line, instead, message):
    lines = [*LINES]
    lines[line - 1] = instead
    with pytest.raises(FsmError, match=message):
        genomes_of("\n".join(lines), "g")


def test_no_genome():
    with pytest.raises(FsmError, match="g: expected a genome, which begins with genomestart, found none"):
        genomes_of("\n/* nothing */\n", "g")
    assert not is_genome("--nstates 1 --s0 1")
