"""Networks on the command line."""

from dataclasses import replace

import pytest

from mercator_design.modules.architecture import Difference
from mercator_design.network.difference import difference
from mercator_design.network.genome import Genome, genome_text
from mercator_design.software.files import read_fsm
from tests.network.test_genome import NEAT


@pytest.fixture
def genome(tmp_path):
    file = tmp_path / "gen_3"
    file.write_text(NEAT)
    return file


def test_a_genome_is_checked_shown_and_explained(mdesign, genome):
    summary = "evostick, network of 15 inputs, 1 hidden node, 2 weights (1 disabled)"
    assert f"valid network: {summary}" in mdesign("validate", genome)[1]
    assert 'class="network"' in mdesign("fsm", "show", genome)[1]
    assert "It perceives nothing, on black floor: it" in mdesign("fsm", "explain", genome)[1]
    text = mdesign("fsm", "show", genome, "--format", "text")[1]
    assert "# flavour: evostick\n# genome: 3\n# fitness: 13850.3\n--nodes 1:input" in text


def test_a_genome_becomes_an_fsm_txt_and_a_genome_again(mdesign, genome, tmp_path):
    line, again = tmp_path / "fsm.txt", tmp_path / "again.genome"
    assert mdesign("fsm", "show", genome, "-o", line)[0] == 0
    assert mdesign("fsm", "show", line, "-o", again)[0] == 0
    ours = [one for one in again.read_text().splitlines() if one.startswith("node")]
    assert ours == [one for one in NEAT.splitlines() if one.startswith("node")]
    assert mdesign("fsm", "show", again, "--format", "text")[1].splitlines()[-1] == line.read_text().splitlines()[-1]


def test_what_is_not_done_with_networks_is_refused(mdesign, genome, tmp_path):
    refused = {
        (
            "lint",
            genome,
        ): "expected a PFSM or a behaviour tree, which have conditions to check, found a network",
        ("show", genome, "--format", "yaml"): "fsm.yaml is a form of PFSMs, found a network (evostick)",
        ("show", genome, "--mission", "aggregation"): "expected a PFSM, found a network (evostick)",
        ("simplify", genome, "-o", tmp_path / "simpler.txt"): "found a network, which has no states to remove",
    }
    for verb, words in refused.items():
        code, _, err = mdesign("fsm", *verb)
        assert code == 3
        assert words in err
    code, _, err = mdesign("fsm", "show", genome, "--format", "dot")
    assert code == 3
    assert "expected one of svg, genome for a network, found dot" in err


def test_differences_of_networks(mdesign, genome, tmp_path):
    assert mdesign("fsm", "diff", genome, genome)[:2] == (0, "the same network\n")
    other = tmp_path / "other"
    network = read_fsm(genome).software
    heavier = replace(network, genes=(network.genes[0]._replace(weight=3.5), *network.genes[1:]))
    other.write_text(genome_text(Genome(network=heavier)))
    code, out, _ = mdesign("fsm", "diff", genome, other)
    names = network.names
    gene = network.genes[0]
    assert (code, out) == (
        0, f"these differ\n  {names[gene.source]} to {names[gene.target]}: weight {gene.weight:g} -> 3.5\n"
    )  # fmt: skip
    pfsm = tmp_path / "pfsm.txt"
    pfsm.write_text("--nstates 1 --s0 1")
    code, _, err = mdesign("fsm", "diff", genome, pfsm)
    assert code == 3
    assert "expected two files of one kind, found a network and a PFSM" in err


def test_disabled_links_make_no_difference(genome):
    network = read_fsm(genome).software
    without = replace(network, genes=tuple(gene for gene in network.genes if gene.enabled))
    found = difference(network, without)
    (gone,) = (gene for gene in network.genes if not gene.enabled)
    ends = f"{network.names[gone.source]} to {network.names[gone.target]}"
    assert found == Difference("equivalent", (f"{ends} is gone: weight {gone.weight:.6g}, disabled",))
    assert difference(without, network).changes == (f"new link {ends}: weight {gone.weight:.6g}, disabled",)
    other = replace(network, flavour="evostick-epuck")
    assert difference(network, other).changes == ("the flavour is evostick-epuck, was evostick",)
