"""Networks on the command line."""

import pytest

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


def test_what_is_not_done_with_networks_is_refused(mdesign, genome):
    for verb in (["lint", genome], ["show", genome, "--format", "yaml"], ["diff", genome, genome]):
        code, _, err = mdesign("fsm", *verb)
        assert code == 3
        assert "expected a PFSM, found a network (evostick)" in err
    code, _, err = mdesign("fsm", "show", genome, "--format", "dot")
    assert code == 3
    assert "expected one of svg, genome for a network, found dot" in err
