"""Networks as a space of weights, as files, and in races."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.designer import flavour_space
from mercator_design.errors import FsmError
from mercator_design.missions.mission import load_mission
from mercator_design.modules.flavour import flavour_from, flavour_names, flavour_of
from mercator_design.modules.reference import Readings, ReferenceModel
from mercator_design.network.grammar import from_network, parameters_of, to_network
from mercator_design.network.network import Gene, Network, NetworkNode, perceptron_nodes
from mercator_design.network.text import parse, to_text
from mercator_design.sim.simulate import Simulator
from mercator_design.software.controller import Controller
from mercator_design.software.files import fsm_file_text, fsm_of, parse_software, read_fsms
from tests.network.networks import published
from tests.network.test_genome import NEAT, PAGMO

NAMES = [one.name for one in parameters_of("evostick")]
SMALL = ["robots=3", "duration=5"]


def test_thirty_weights_in_the_order_of_genomes():
    assert [f"{side}{k}" for k in range(1, 16) for side in ("left", "right")] == NAMES
    assert {(one.low, one.high, one.digits, one.condition) for one in parameters_of("evostick")} == {(-5, 5, 4, None)}


@given(st.lists(st.floats(-5, 5), min_size=30, max_size=30))
def test_decoded_and_encoded(weights):
    configuration = dict(zip(NAMES, weights, strict=True))
    network = to_network(configuration, "evostick")
    assert from_network(network) == configuration
    assert parse(to_text(network)) == network


def test_the_command_line_of_a_configuration_is_its_text():
    """So a target runner's line can be read."""
    configuration = {name: round(0.1 * k - 1.5, 4) for k, name in enumerate(NAMES)}
    network = to_network(configuration, "evostick")
    assert parse(flavour_space("evostick").command_line(configuration)) == network


def test_links_that_are_missing_are_weights_of_0():
    nodes = perceptron_nodes()
    few = Network(nodes, (Gene(15, 17, 1.0), Gene(3, 16, 2.0), Gene(4, 16, 9.0, enabled=False)))
    found = from_network(few)
    assert {name: weight for name, weight in found.items() if weight} == {"left3": 2.0, "right15": 1.0}
    for genes in ((Gene(15, 17, 1.0),), (Gene(15, 17, 1.0), Gene(17, 16, 1.0))):
        with pytest.raises(FsmError, match="races design networks"):
            from_network(Network(nodes, genes))
    with pytest.raises(FsmError, match=r"without hidden nodes .* found a gene from 1 to 18"):
        from_network(Network((*nodes, NetworkNode(18, "hidden")), (Gene(1, 18, 1.0),)))


def test_published_networks_are_encoded_if_they_have_no_hidden_nodes():
    for network, one in published().values():
        if one["method"] in {"evostick", "cma-es", "xnes"} and one["reference_model"] == "1.2":
            flavour_space("evostick").check(from_network(network))


def test_flavours():
    assert flavour_names("network") == ("evostick", "evostick-epuck")
    model = flavour_of("evostick").reference_model(ReferenceModel())
    assert (model.network_black_highest, model.network_white_lowest) == (0.1, 0.95)
    own = "architecture: network\nschema: 1\nlimits: {weight: 2}\n"
    assert flavour_from(own, "mine.yaml").limit("weight") == 2
    with pytest.raises(FsmError, match="behaviours: expected none, as a network has no modules, found stop"):
        flavour_from(f"{own}behaviours: {{stop: 0}}\n", "mine.yaml")
    with pytest.raises(FsmError, match=r"limits\.states: expected one of weight"):
        flavour_from("architecture: network\nschema: 1\nlimits: {states: 2}\n", "mine.yaml")
    with pytest.raises(FsmError, match=r"flavour: expected one of networks \(evostick, evostick-epuck\)"):
        Network(perceptron_nodes(), (), "watermelon")


def test_files():
    network = to_network(dict.fromkeys(NAMES, 0.5), "evostick-epuck")
    file = fsm_of(fsm_file_text(network, {"mission": "m"}), "fsm.txt")
    assert (file.software, file.header, file.names) == (network, {"mission": "m"}, ("network",))
    with pytest.raises(FsmError, match="this is a network of evostick or evostick-epuck; use --flavour evostick"):
        parse_software(to_text(network), "watermelon")
    with pytest.raises(FsmError, match="this is a PFSM of watermelon or chocolate; use --flavour watermelon"):
        parse_software("--nstates 1 --s0 1", "evostick")


def test_genomes_are_files_of_control_software(tmp_path):
    file = fsm_of(NEAT, "gen_3")
    assert file.software.flavour == "evostick"
    assert file.header == {"genome": "3", "fitness": "13850.3"}
    assert fsm_of(NEAT, "gen_3", "evostick-epuck").software.flavour == "evostick-epuck"
    with pytest.raises(FsmError, match="gens: expected one genome, found 2"):
        fsm_of(NEAT + PAGMO, "gens")
    (tmp_path / "gens").write_text(NEAT + PAGMO)
    assert [one.header["genome"] for one in read_fsms(tmp_path / "gens").values()] == ["3", "1"]
    with pytest.raises(FsmError, match="flavour: expected one of networks"):
        fsm_of(NEAT, "gen_3", "watermelon")


@pytest.mark.together("networks")
def test_the_simulator_runs_networks_as_the_robot_does():
    """Also with hidden nodes; recorded readings give the same wheels in plain Python."""
    network, _ = published()["transferability-1-neat-epuck-aggregation-7"]
    recording = Simulator(load_mission("transfer_aggregation_epuck", SMALL)).run(network, 1, record=True).recording
    history = recording.history
    for robot in range(3):
        controller = Controller(network, recording.robot_model.reference_model)
        for cycle in range(50):
            actions = controller.step(Readings(*history.readings[cycle, robot]), history.draws[cycle, robot])
            assert (actions.left, actions.right) == tuple(history.wheels[cycle, robot])


@pytest.mark.together("networks")
def test_robots_without_light_sensors_run_networks():
    """Also where there is a light, which they do not perceive."""
    network = to_network(dict.fromkeys(NAMES, 0.5) | dict.fromkeys(NAMES[8:16], -5.0), "evostick")
    given_ = [*SMALL, "robot_model=mercator"]
    lit, dark = (
        load_mission("transfer_grid_mercator", given_),
        load_mission("transfer_grid_mercator", [*given_, "lights=[]"]),
    )
    assert Simulator(lit).run(network, 1).score == Simulator(dark).run(network, 1).score
