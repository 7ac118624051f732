"""Networks in words and pictures."""

import xml.etree.ElementTree as ET

from hypothesis import given

from mercator_design.network.network import Gene, Network, NetworkNode, perceptron_nodes
from mercator_design.network.words import explanation, motion, responses
from mercator_design.show.machines.network_diagram import network_svg
from tests.network.networks import networks, published

SVG = "{http://www.w3.org/2000/svg}"
AVOIDING = Network(  # drives on; an obstacle on the left stops its right wheel, one on the right its left wheel
    perceptron_nodes(),
    (Gene(15, 16, 1.0), Gene(15, 17, 1.0), Gene(1, 17, -2.0), Gene(4, 16, -2.0), Gene(9, 16, 9.0, enabled=False)),
)


def test_explanation():
    words = explanation(AVOIDING)
    assert "Left wheel: forwards by bias (+1.00); backwards by obstacle front right (-2.00).\n" in words
    assert "It perceives nothing, on black floor: it drives straight on (left 0.99, right 0.99).\n" in words
    assert "  obstacle front left: it turns right on the spot (left 0.99, right -0.99)\n" in words
    assert "It does not read: obstacle rear left, obstacle rear right, light front left," in words
    assert "floor, number of neighbours" in words


def test_a_hidden_node_passes_its_signal_on():
    nodes = (*perceptron_nodes(), NetworkNode(18, "hidden"))
    network = Network(nodes, (Gene(9, 18, 1.0), Gene(18, 16, -3.0), Gene(15, 16, 2.0), Gene(15, 17, 2.0)))
    rest, driven = responses(network)
    assert rest[0] > 0.5 > -0.9 > dict(driven)["floor"][0]
    assert "backwards by hidden node 18 (-3.00)" in explanation(network)


def test_motions():
    assert motion(0.0, 0.04) == "stands still (left 0.00, right 0.04)"
    assert motion(1.0, 0.95).startswith("drives straight on (")
    assert motion(-1.0, -0.95).startswith("drives straight backwards (")
    assert motion(-0.5, 0.52).startswith("turns left on the spot (")
    assert motion(0.9, 0.2).startswith("drives forwards and turns right (")
    assert motion(-0.9, 0.2).startswith("drives backwards and turns left (")


def lines_of(network):
    root = ET.fromstring(network_svg(network))  # noqa: S314 - our own text
    return {path.find(f"{SVG}title").text: path for path in root.iter(f"{SVG}path")}, root


def test_diagram():
    lines, root = lines_of(AVOIDING)
    assert {*lines} == {
        "bias to left wheel: 1",
        "bias to right wheel: 1",
        "obstacle front left to right wheel: -2",
        "obstacle front right to left wheel: -2",
    }
    strong, weak = lines["obstacle front left to right wheel: -2"], lines["bias to left wheel: 1"]
    assert float(strong.get("stroke-width")) == 2 * float(weak.get("stroke-width"))
    assert (strong.get("class"), weak.get("class")) == ("minus", "plus")
    assert ".network .minus{stroke:#c07c00;stroke-dasharray:7 4}" in root.find(f"{SVG}style").text
    place = {circle.find(f"{SVG}title").text: float(circle.get("cx")) for circle in root.iter(f"{SVG}circle")}
    assert place["obstacle front left"] == place["bias"] < place["left wheel"] == place["right wheel"]


@given(networks())
def test_any_network_is_drawn_and_explained(network):
    lines, root = lines_of(network)
    assert len(lines) == len({gene[:2] for gene in network.enabled})
    width, height = float(root.get("width")), float(root.get("height"))
    for circle in root.iter(f"{SVG}circle"):
        assert 0 < float(circle.get("cx")) < width
        assert 0 < float(circle.get("cy")) < height
    assert explanation(network).startswith("A network: ")


def test_published_networks_are_drawn_and_explained():
    for network, one in published().values():
        assert len(lines_of(network)[0]) == sum(gene.enabled for gene in network.genes)
        words = explanation(network)
        assert ("reference model 1.1: each sensor of an e-puck" in words) == (one["reference_model"] == "1.1")
