"""Networks behave as the original programs recorded, and compiled as in plain Python."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.errors import FsmError
from mercator_design.jit import compiled
from mercator_design.missions.mission import load_mission
from mercator_design.modules.reference import Readings, ReferenceModel, sense_of
from mercator_design.network.control import network_cycle
from mercator_design.network.inputs import _LEVELS, _SHARES, INPUTS, fill_inputs, fill_sensors, gray_sample
from mercator_design.network.network import FIRST, Gene, Network, NetworkNode, perceptron_nodes
from mercator_design.sim.simulate import Simulator
from mercator_design.software.controller import Controller
from tests.fsm.strategies import DRAW, READINGS
from tests.network.networks import load, network_of, networks, published

pytestmark = pytest.mark.together("networks")  # compiled once

MERCATOR = ReferenceModel(network_black_highest=0.1, network_white_lowest=0.95)
MODELS = {"mercator": MERCATOR, "epuck": ReferenceModel()}
VECTORS = load("network_vectors.json.gz")["vectors"]


class Twice:
    """A network in plain and in compiled form, which must agree to the last bit."""

    def __init__(self, network, model):
        self._model, self._program = model, network.program()
        self._arrays = type(self._program)(
            *(
                np.array(row, np.float64 if name == "parameters" else np.int64)
                for name, row in self._program._asdict().items()
            )
        )
        self.memory = [0.0] * self._program.memory
        self._fast = np.zeros(self._program.memory)

    def step(self, readings, u):
        plain, fast = [0.0] * 5, np.zeros(5)
        network_cycle(self._model, self._program, readings, self.memory, (u,), plain)
        compiled(network_cycle)(self._model, self._arrays, readings, self._fast, np.array([u]), fast)
        assert fast.tolist() == plain
        assert self._fast.tolist() == self.memory
        return plain[:2]


def draw_of(gray):
    """The uniform draw for which this is read on gray floor."""
    return float(np.interp(gray, _LEVELS, _SHARES))


def test_recorded_cycles():
    for vector in VECTORS:
        one = Twice(network_of(vector["genome"]), MODELS[vector["robot"]])
        for step in vector["steps"]:
            given_ = step["readings"]
            readings = Readings(
                *given_["proximity"],
                float(given_["neighbours"]),
                *given_["neighbour_vector"],
                *[float(given_["ground"])] * 3,
                *given_["light"],
            )
            wheels = one.step(readings, draw_of(given_["gray_sample"]))
            assert one.memory[FIRST : FIRST + 15] == pytest.approx(step["inputs"], abs=1e-9)
            assert wheels == pytest.approx(step["wheels"], abs=1e-9)


def passes_of_neat(network, inputs, activations, active, ever):
    """One cycle, in other words: dictionaries instead of tables."""
    order = [node.number for node in network.all_nodes if node.number not in network.inputs]
    outputs = [*network.outputs]
    for _ in range(19):
        sums, live = {}, {}
        for node in order:
            links = [gene for gene in network.enabled if gene.target == node]
            sums[node] = sum(g.weight * (inputs | activations)[g.source] for g in links)
            before = {number: is_live for number, is_live in active.items() if order.index(number) > order.index(node)}
            live[node] = any(g.source in inputs or {**before, **live}.get(g.source, False) for g in links)
        for node in order:
            if live[node]:
                activations[node] = 1 / (1 + math.exp(min(-4.924273 * sums[node], 700)))
        active.update(live)
        ever |= {node for node in order if live[node]}
        if ever >= {*outputs}:
            break
    return [2 * activations[node] - 1 for node in outputs]


@given(networks(), st.lists(st.tuples(READINGS, DRAW), min_size=1, max_size=5))
def test_any_network(network, cycles):
    """With loops and nodes that no input reaches; compared with another interpreter."""
    one = Twice(network, ReferenceModel())
    order = [node.number for node in network.all_nodes if node.number not in network.inputs]
    activations, active, ever = dict.fromkeys(order, 0.0), dict.fromkeys(order, False), set()
    for readings, u in cycles:
        wheels = one.step(readings, u)
        inputs = dict(zip(network.inputs, one.memory[FIRST : FIRST + 15], strict=True))
        assert wheels == pytest.approx(passes_of_neat(network, inputs, activations, active, ever), abs=1e-7)
        assert all(-1.0 <= wheel <= 1.0 for wheel in wheels)
        assert one.memory[0] == 0.0


def test_no_weights_stand_still_and_no_links_drive_backwards():
    genes = tuple(Gene(k, to, 0.0) for k in range(1, 16) for to in (16, 17))
    assert Twice(Network(perceptron_nodes(), genes), ReferenceModel()).step(Readings(), 0.5) == [0.0, 0.0]
    assert Twice(Network(perceptron_nodes(), ()), ReferenceModel()).step(Readings(), 0.5) == [-1.0, -1.0]


def test_a_signal_needs_a_cycle_for_each_link_except_in_the_first():
    nodes = (*perceptron_nodes(), NetworkNode(18, "hidden"))
    one = Twice(Network(nodes, (Gene(1, 18, 5.0), Gene(18, 16, 5.0), Gene(15, 17, 5.0))), ReferenceModel())
    first = one.step(Readings(), 0.5)[0]  # a hidden activation of 1/2
    assert first == pytest.approx(math.tanh(0.5 * 4.924273 * 2.5))
    assert one.step(Readings(proximity_x=-1.0), 0.5)[0] == first
    obstacle = Readings(proximity_x=0.5, proximity_y=0.5)
    assert one.step(obstacle, 0.5)[0] == first
    assert one.step(Readings(), 0.5)[0] > first


def inputs_of(readings, model=MERCATOR, gray=0.4):
    row = [0.0] * 16
    fill_inputs(model, readings, gray, row, 1)
    assert row[0] == 0.0
    return dict(zip([one.name for one in INPUTS["1.2"]], row[1:], strict=True))


def test_inputs():
    half = math.sqrt(0.5)
    found = inputs_of(Readings(proximity_x=-0.8, neighbours=2.0, neighbours_y=0.1, light_x=half, light_y=-half))
    assert (found["obstacle front left"], found["obstacle front right"]) == (0.0, 0.0)
    assert found["obstacle rear left"] == found["obstacle rear right"] == pytest.approx(0.8 * half)
    assert found["neighbours front left"] == found["neighbours rear left"] == pytest.approx(0.1 * half)
    assert found["light front right"] == pytest.approx(1.0)
    assert found["number of neighbours"] == pytest.approx(1 - 2 / (1 + math.exp(2)))
    assert found["bias"] == 1.0


@pytest.mark.parametrize(
    ("level", "mercator", "epuck"),
    [
        (0.0, 0.0, 0.0),
        (0.1, 0.0, 0.0),
        (0.5, 0.4, 0.0),
        (0.96, 1.0, 0.0),
        (127.5, 1.0, 0.4),
        (242.5, 1.0, 1.0),
        (255.0, 1.0, 1.0),
    ],
)
def test_floor_inputs(level, mercator, epuck):
    ground = Readings(ground_red=level, ground_green=level, ground_blue=level)
    assert inputs_of(ground)["floor"] == mercator
    assert inputs_of(ground, ReferenceModel())["floor"] == epuck


def test_gray_samples_have_the_quantiles_of_the_recorded_ones():
    draws = np.linspace(0, 1, 100_001)[:-1]
    found = [gray_sample(u) for u in draws]
    assert found == sorted(found)
    shares = [0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95]
    assert np.quantile(found, shares) == pytest.approx([0.18, 0.24, 0.30, 0.37, 0.50, 0.59, 0.92], abs=1e-3)
    assert np.mean(found) == pytest.approx(0.41, abs=0.01)
    assert gray_sample(0.0) == 0.0


def test_what_a_network_reads():
    nodes = perceptron_nodes()
    assert Network(nodes, (Gene(1, 16, 1.0), Gene(9, 17, 1.0), Gene(12, 17, 1.0, enabled=False))).reads == {
        "proximity",
        "ground",
    }
    lit = Network(nodes, (Gene(5, 16, 1.0), Gene(15, 17, 1.0)))
    assert lit.reads == frozenset()  # a robot without light sensors runs it in the dark
    assert lit.program().reads == (8,)


def test_inputs_of_reference_model_1_1():
    """Sensors one by one, from the left of the front on; a vector to neighbours that is shorter than 1."""
    readings = Readings(neighbours=2.0, neighbours_x=0.3, neighbours_y=0.4)
    readings = readings._replace(
        **{f"ranges_{k}": k / 10 for k in range(8)}, **{f"lights_{k}": 1 - k / 10 for k in range(8)}
    )
    readings = readings._replace(grounds_0=0.0, grounds_1=128.0, grounds_2=255.0)
    row = [0.0] * 26
    fill_sensors(ReferenceModel(), readings, (0.1, 0.5, 0.9), row, 1)
    assert row[:1] == [0.0]
    assert row[1:9] == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.0]
    assert row[9:17] == pytest.approx([0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 1.0])
    assert row[17:20] == [0.0, gray_sample(0.5), 1.0]
    assert row[20] == pytest.approx(1.0 - 2.0 / (1.0 + math.exp(2.0)))
    length = 2.0 / (1.0 + math.exp(-0.5)) - 1.0
    left, right = 0.7 * length / math.sqrt(0.5), 0.1 * length / math.sqrt(0.5)
    assert row[21:25] == pytest.approx([left, right, 0.0, 0.0])
    assert row[25] == 1.0


def older():
    """Published networks of reference model 1.1."""
    return [network for network, one in published().values() if one["reference_model"] == "1.1"]


def test_networks_of_reference_model_1_1_run():
    """On e-pucks; a robot's controller does what the simulator did."""
    network = dataclasses.replace(older()[0], flavour="evostick-epuck")
    simulator = Simulator(load_mission("vanilla_aggregation", ["robots=4", "duration=10", "robot_model=epuck-2018"]))
    history = simulator.run(network, 1, record=True).history
    model = simulator.robot_model.reference_model
    for robot in range(4):
        controller = Controller(network, model)
        for cycle, readings in enumerate(history.readings[:, robot]):
            found = controller.step(Readings(*readings.tolist()), history.draws[cycle, robot].tolist())
            assert [found.left, found.right] == history.wheels[cycle, robot].tolist()
    assert len(np.unique(history.wheels[..., 0])) > 5
    senses = {sense_of(Readings._fields[k]) for k in np.flatnonzero(np.ptp(history.readings, axis=(0, 1)))}
    assert senses >= {"ranges", "lights", "grounds", "neighbours"}


def test_robots_without_these_sensors_refuse_networks_of_reference_model_1_1():
    with pytest.raises(FsmError, match="needs grounds and lights, which robot mercator does not perceive"):
        Simulator(load_mission("aggregation")).run(older()[0], 1)
