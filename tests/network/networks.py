"""Published networks, and random ones for property tests."""

import functools
import gzip
import json
from pathlib import Path

from hypothesis import strategies as st

from mercator_design.network.network import KINDS, Gene, Network, NetworkNode, perceptron_nodes

DATA = Path(__file__).parents[1] / "data"
WEIGHT = st.floats(-10, 10, allow_subnormal=False) | st.integers(-5, 5).map(float)


def network_of(genome, flavour="evostick"):
    """The network of recorded nodes and genes."""
    nodes = tuple(NetworkNode(number, KINDS[kind]) for number, kind in genome["nodes"])
    genes = tuple(Gene(source, to, float(weight), bool(on)) for source, to, weight, on in genome["genes"])
    return Network(nodes, genes, flavour)


def load(name):
    return json.loads(gzip.decompress((DATA / name).read_bytes()))


@functools.cache
def published():
    """The published networks by their names."""
    found = load("published_networks.json.gz")["networks"]
    return {one["id"]: (network_of(one["genome"]), one) for one in found}


@st.composite
def networks(draw, max_hidden=6):
    """With hidden nodes anywhere among the outputs, loops, and links that are disabled or missing."""
    inputs, outputs = perceptron_nodes()[:15], perceptron_nodes()[15:]
    hidden = [NetworkNode(20 + k, "hidden") for k in range(draw(st.integers(0, max_hidden)))]
    neurons = draw(st.permutations([*hidden, *outputs]))
    nodes = (*inputs, *neurons)
    ends = st.tuples(st.sampled_from(nodes), st.sampled_from(neurons)).map(
        lambda pair: (pair[0].number, pair[1].number)
    )
    pairs = draw(st.lists(ends, unique=True, max_size=40))
    genes = tuple(Gene(*pair, draw(WEIGHT), draw(st.integers(0, 5)) > 0) for pair in pairs)
    return Network(nodes, genes)
