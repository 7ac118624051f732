"""A network as one line."""

import contextlib
import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.errors import FsmError
from mercator_design.network.network import Gene, Network, NetworkNode, perceptron_nodes
from mercator_design.network.text import is_perceptron, parse, to_text
from tests.network.networks import networks, published

WEIGHTS = " ".join(f"--left{k} 0.5 --right{k} -1" for k in range(1, 16))
NODES = "--nodes " + " ".join(f"{k}:{'bias' if k == 15 else 'input'}" for k in range(1, 16)) + " 16:output 17:output"


def test_weights():
    network = parse(WEIGHTS)
    assert is_perceptron(network)
    assert network.genes[:3] == (Gene(1, 16, 0.5), Gene(1, 17, -1.0), Gene(2, 16, 0.5))
    assert to_text(network) == WEIGHTS
    assert network.summary == "evostick, network of 15 inputs, no hidden nodes, 30 weights"


def test_any_order_of_weights_is_kept():
    """CMA-ES and xNES write those of the left wheel first."""
    text = " ".join(f"--{side}{k} {k}" for side in ("left", "right") for k in range(1, 16))
    assert to_text(parse(text)) == text


def test_hidden_nodes():
    text = f"{NODES} 18:hidden --genes 1:16:0.5 1:18:-2 18:16:1:off"
    network = parse(text)
    assert network.all_nodes[-1] == NetworkNode(18, "hidden")
    assert network.genes == (Gene(1, 16, 0.5), Gene(1, 18, -2.0), Gene(18, 16, 1.0, enabled=False))
    assert to_text(network) == text


@given(networks())
def test_written_without_loss(network):
    assert parse(to_text(network)) == network
    assert hash(pickle.loads(pickle.dumps(network))) == hash(network)  # noqa: S301 - our own


def test_published_networks_are_written_without_loss():
    for network, one in published().values():
        text = to_text(network)
        assert parse(text) == network
        assert text.startswith("--left1 ") == (one["method"] != "neat" and one["reference_model"] == "1.2")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("--left1 0.5", "--left1 0,5", "--left1: expected a weight, found '0,5'"),
        ("--left1 0.5", "--left1 inf", "--left1: expected a weight, found 'inf'"),
        ("--left1 0.5", "--left0 0.5", "expected --nodes, or weights from --left1 to --right15, found '--left0'"),
        ("--left1 0.5", "--left16 0.5", "expected --nodes, or weights from --left1 to --right15, found '--left16'"),
        ("--left1 0.5", "--left01 0.5", "expected --nodes, or weights from --left1 to --right15, found '--left01'"),
        ("--left1 0.5", "--left2 0.5", "--left2 is given twice"),
        ("--left1 0.5 ", "", "expected 30 weights, found 29: --left1 missing"),
        ("--left1 0.5 --right1 -1 ", "", "expected 30 weights, found 28: --left1 and 1 more missing"),
        ("--right15 -1", "--right15", "--right15: expected a weight, found 'the end of the text'"),
        ("--left1 0.5", "--nstates 1", "expected --nodes, or weights from --left1 to --right15, found '--nstates'"),
        ("--left1", "--left1\x1b", "expected a flag or a number"),
    ],
)
def test_mistakes_in_weights(old, new, message):
    with pytest.raises(FsmError, match=f"^{message}"):
        parse(WEIGHTS.replace(old, new, 1))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected 30 weights, found 0"),
        (NODES, "expected --genes behind the nodes, found the end of the text"),
        (
            f"{NODES} 18:secret --genes",
            "--nodes, node 18: expected its number and kind, such as 16:output, found '18:secret'",
        ),
        (f"{NODES} --genes 1:16", "--genes, gene 1 \\(1:16\\): expected a weight"),
        (f"{NODES} --genes 1:16:1 2:16:x", "--genes, gene 2 \\(2:16:x\\): expected a weight, found 'x'"),
        (f"{NODES} --genes 1:16:1:on", "--genes, gene 1: expected two nodes and a weight"),
        (f"{NODES} --genes 1:16:1:off:off", "--genes, gene 1: expected two nodes and a weight"),
        (f"{NODES} --genes 1:18:1", "gene 1 \\(from 1 to 18\\): expected the number of a node, found 18"),
        ("--nodes --genes", "expected 15 .* inputs, with the bias, found 0"),
    ],
)
def test_mistakes_in_nodes_and_genes(text, message):
    with pytest.raises(FsmError, match=f"^{message}"):
        parse(text)


def test_limits():
    nodes = perceptron_nodes()
    with pytest.raises(FsmError, match="expected at most 200 nodes, found 217"):
        Network((*nodes, *(NetworkNode(100 + k, "hidden") for k in range(200))), ())
    with pytest.raises(FsmError, match="expected at most 2000 genes, found 2001"):
        Network(nodes, (Gene(1, 16, 1.0),) * 2001)
    with pytest.raises(FsmError, match="flavour: expected"):
        parse(WEIGHTS, "nothing")


@given(st.text(st.sampled_from("-lefrightnodsn 0123456789.:e"), max_size=60))
def test_no_text_is_a_traceback(text):
    for line in (text, f"--nodes {text}", f"{NODES} --genes {text}", f"{WEIGHTS} {text}"):
        with contextlib.suppress(FsmError):
            parse(line)
