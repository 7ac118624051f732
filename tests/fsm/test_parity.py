"""Compiled and plain kernels are the same function: equal to the last bit over their whole domains."""

import ast
import inspect
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.fsm.control import control_cycle
from mercator_design.jit import compiled
from mercator_design.modules.behaviours import behave, strength, wheels_from_vector
from mercator_design.modules.clustering import lidar_neighbours, neighbours_in_hits
from mercator_design.modules.conditions import colour_label, ground_level, logistic, probability
from mercator_design.modules.module import BEHAVIOURS, CONDITIONS
from mercator_design.modules.perception import (
    gray_level,
    ground_by_vote,
    light_direction,
    nearest_label,
    perceive,
    proximity_weight,
)
from mercator_design.modules.reference import ACTIONS, N_READINGS, SCRATCH, NonNegative, ReferenceModel
from mercator_design.network.control import activate, network_cycle
from mercator_design.network.inputs import fill_inputs, fill_sensors, gray_sample
from mercator_design.sim.simulate import tables_of
from mercator_design.software import Controller
from tests.fsm.strategies import DRAW, DRAWS, READINGS, pfsms, values

pytestmark = pytest.mark.together("parity")  # compiled once

LEVEL = st.floats(0.0, 255.0)
# The simulated original's numbers (argos3-rvr, demiurge-rvr-dao), as far from the defaults as published variants get.
ORIGINAL = ReferenceModel(
    proximity_near_weight=0.0,
    proximity_constant=0.0,
    proximity_inverse=1.0,
    neighbour_scale=100.0,
    strength_step=1.0,
    repulsion_power=2.0,
    black_highest=0.1,
    gray_lowest=0.1,
    gray_highest=160.0,
    white_lowest=220.0,
    hue_period=1e9,
    slowest_wheel=-0.5,
    count_wraps=1.0,
)
ZEROS = ReferenceModel(  # every constant that may be zero
    **{name: 0.0 for name, kind in ReferenceModel.__annotations__.items() if kind == NonNegative}
)
MODELS = st.sampled_from(
    [
        ReferenceModel(),
        ORIGINAL,
        ZEROS,
        ReferenceModel(neighbour_obstacle_range=0.55),
        ReferenceModel(neighbour_offset=0.0),
    ]
)


def behaving(position, model, readings, parameters, memory, u, actions):
    """An entry to the dispatcher, compiled as the engine is."""
    behave(position, model, readings, parameters, memory, u, actions)


def probable(position, model, readings, parameters, memory, found):
    probability(position, model, readings, parameters, memory, found)


@pytest.mark.parametrize("module", BEHAVIOURS.values(), ids=lambda m: m.name)
@given(data=st.data())
def test_behaviours(module, data):
    parameters = [float(value) for value in data.draw(values(module))]
    model, readings, u = data.draw(MODELS), data.draw(READINGS), data.draw(DRAW)
    plain_memory = [data.draw(st.integers(0, 100).map(float)), data.draw(st.sampled_from([-1.0, 1.0]))]
    memory, plain, fast = np.array(plain_memory), [0.0] * ACTIONS, np.zeros(ACTIONS)
    behave(module.position, model, readings, parameters, plain_memory, u, plain)
    compiled(behaving)(module.position, model, readings, np.array(parameters), memory, u, fast)
    assert fast.tolist() == plain
    assert memory.tolist() == plain_memory
    assert all(-1.0 <= wheel <= 1.0 for wheel in plain[:2])


@pytest.mark.parametrize("module", CONDITIONS.values(), ids=lambda m: m.name)
@given(data=st.data())
def test_conditions_are_probabilities(module, data):
    parameters = [float(value) for value in data.draw(values(module))]
    model, readings = data.draw(MODELS), data.draw(READINGS)
    plain, fast = [0.0], np.zeros(1)
    probability(module.position, model, readings, parameters, [], plain)
    compiled(probable)(module.position, model, readings, np.array(parameters), np.zeros(0), fast)
    assert fast.tolist() == plain
    assert 0.0 <= plain[0] <= 1.0


@given(st.data())
def test_perception(data):
    model = data.draw(MODELS)
    proximity = data.draw(st.lists(st.floats(0, 20), min_size=8, max_size=8))
    angles = np.linspace(-3, 3, 8)
    row = st.tuples(st.floats(0.0, 0.75), st.floats(-1, 1), st.floats(-1, 1))
    neighbours = data.draw(st.lists(row, min_size=1, max_size=5))
    n = data.draw(st.integers(0, len(neighbours)))
    rows = [
        proximity,
        np.cos(angles).tolist(),
        np.sin(angles).tolist(),
        *map(list, zip(*neighbours, strict=True)),
    ]
    ground, light = [1.0, 2.0, 3.0], [0.5, -0.5]
    count = float(data.draw(st.integers(0, 5)))
    others = [0.0] * N_READINGS
    plain = perceive(model, *rows, n, count, ground, light, others)
    fast = compiled(perceive)(model, *map(np.array, rows), n, count, *map(np.array, (ground, light, others)))
    assert plain.neighbours == count
    assert tuple(fast) == tuple(plain)
    assert math.hypot(plain.proximity_x, plain.proximity_y) <= 1.0 + 1e-12
    assert math.hypot(plain.neighbours_x, plain.neighbours_y) <= n * 1e6 * math.sqrt(2.0) * (1.0 + 1e-12)


@given(
    pfsms(),
    st.lists(st.tuples(READINGS, st.lists(DRAW, min_size=DRAWS, max_size=DRAWS)), max_size=12),
    MODELS,
)
def test_control_cycles(pfsm, cycles, model):
    controller = Controller(pfsm, model)
    tables = tables_of(pfsm)
    memory, actions = np.zeros(tables.memory), np.zeros(ACTIONS)
    actions[2] = -1.0
    for readings, draws in cycles:
        compiled(control_cycle)(model, tables.program, readings, memory, np.array(draws), actions)
        assert tuple(actions[:SCRATCH]) == tuple(controller.step(readings, draws))
        assert int(memory[0]) == controller.state


@given(st.data())
def test_lidar_neighbours(data):
    model = data.draw(MODELS)
    reading = st.one_of(st.just(0.0), st.floats(0.05, 0.8), st.sampled_from([0.5, 0.51]))
    ranges = data.draw(st.lists(reading, min_size=1, max_size=40))
    step = 2 * math.pi / len(ranges)
    plain_rows = [[0.0] * len(ranges) for _ in range(3)]
    fast_rows = [np.zeros(len(ranges)) for _ in range(3)]
    n = lidar_neighbours(model, ranges, -math.pi, step, *plain_rows)
    row, every = np.array(ranges), np.arange(len(ranges))
    assert compiled(neighbours_in_hits)(model, row, every, len(ranges), -math.pi, step, *fast_rows) == n
    assert [row.tolist() for row in fast_rows] == plain_rows
    assert all(model.lidar_nearest <= distance <= model.neighbour_range for distance in plain_rows[0][:n])


@given(MODELS, st.lists(st.floats(0, 1), min_size=8, max_size=8), st.floats(0, 16), st.floats(0, 16))
def test_light_and_votes(model, readings, blacks, whites):
    angles = np.linspace(-3, 3, 8)
    plain = light_direction(model, readings, np.cos(angles).tolist(), np.sin(angles).tolist())
    fast = compiled(light_direction)(model, np.array(readings), np.cos(angles), np.sin(angles))
    assert tuple(fast) == tuple(plain)
    assert math.hypot(*plain) == pytest.approx(1.0) or plain == (0.0, 0.0)
    assert compiled(ground_by_vote)(model, blacks, whites) == ground_by_vote(model, blacks, whites)


@given(st.lists(st.sampled_from([0.0, 127.0, 255.0, 93.5]), min_size=3, max_size=30), st.tuples(LEVEL, LEVEL, LEVEL))
def test_labels(levels, measured):
    labels = levels[: len(levels) // 3 * 3]
    plain = nearest_label(labels, *measured)
    assert compiled(nearest_label)(np.array(labels), *measured) == plain
    distances = [math.dist(labels[k : k + 3], measured) for k in range(0, len(labels), 3)]
    assert distances[plain] == pytest.approx(min(distances))


@pytest.mark.parametrize(
    ("law", "distance", "weight"),
    [
        ({"proximity_constant": 0.0, "proximity_inverse": 1.0}, 0.2, 5.0),
        ({"proximity_constant": 1.0, "proximity_inverse": 0.0, "proximity_slope": -0.5}, 0.4, 0.8),
        ({"proximity_constant": 0.0, "proximity_inverse": 0.0, "proximity_exponential": 1.0}, 0.3, math.exp(-0.3)),
        (
            {"proximity_constant": 1.0, "proximity_inverse": 0.0, "proximity_slope": -40, "proximity_square": 400},
            0.06,
            0.04,
        ),
    ],
    ids=["inverse", "linear", "exponential", "square"],
)
def test_other_proximity_laws(law, distance, weight):
    model = ReferenceModel(**law)
    assert proximity_weight(model, distance) == pytest.approx(weight)
    assert compiled(proximity_weight)(model, distance) == proximity_weight(model, distance)


def test_proximity_laws():
    paper = ReferenceModel()
    assert proximity_weight(paper, 0.04) == 1.0
    assert proximity_weight(paper, 0.05) == pytest.approx(1.0)
    assert proximity_weight(paper, 0.4) == pytest.approx(0.0)
    assert proximity_weight(paper, 0.401) == proximity_weight(paper, math.inf) == 0.0
    assert proximity_weight(ORIGINAL, 0.04) == 0.0  # vanishes
    assert proximity_weight(ORIGINAL, 0.4) == 2.5


@pytest.mark.parametrize(
    ("law", "distance", "weight"),
    [
        ({}, 0.5, 1 / 1.5),
        ({"neighbour_offset": 0.0}, 0.5, 2.0),
        ({"neighbour_offset": 0.0}, 0.0, 1e6),
        ({"neighbour_offset": 0.0, "neighbour_gap": 0.6}, 0.5, 1e6),
    ],
    ids=["default", "paper", "in one place", "touching"],
)
def test_how_much_a_neighbour_weighs(law, distance, weight):
    found = perceive(
        ReferenceModel(**law), (), (), (), (distance,), (1.0,), (0.0,), 1, 1.0, (0, 0, 0), (0, 0), [0.0] * N_READINGS
    )
    assert found.neighbours_x == pytest.approx(weight)


KERNELS = [
    *(module.function for module in (*BEHAVIOURS.values(), *CONDITIONS.values())),
    control_cycle,
    perceive,
    proximity_weight,
    wheels_from_vector,
    strength,
    gray_level,
    ground_level,
    nearest_label,
    ground_by_vote,
    light_direction,
    neighbours_in_hits,
    logistic,
    colour_label,
    network_cycle,
    activate,
    fill_inputs,
    fill_sensors,
    gray_sample,
]


@pytest.mark.parametrize("kernel", KERNELS, ids=lambda k: k.__name__)
def test_kernels_keep_to_the_subset(kernel):
    """Only what means the same in Python and compiled: no exceptions, no containers made, nothing but `math`."""
    allowed = (
        ast.Module, ast.FunctionDef, ast.arguments, ast.arg, ast.Expr, ast.Constant, ast.Return, ast.Assign,
        ast.AugAssign, ast.If, ast.IfExp, ast.While, ast.For, ast.Continue, ast.Break, ast.Compare, ast.BoolOp,
        ast.BinOp, ast.UnaryOp, ast.Call, ast.Name, ast.Attribute, ast.Subscript, ast.Tuple, ast.expr_context,
        ast.Slice, ast.operator, ast.unaryop, ast.boolop, ast.cmpop, ast.Starred,
    )  # fmt: skip
    tree = ast.parse(inspect.getsource(kernel))
    for node in ast.walk(tree.body[0].body and ast.Module(tree.body[0].body, [])):
        assert isinstance(node, allowed), ast.dump(node)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "math":
            assert node.attr in {"sqrt", "exp", "floor", "pi", "cos", "sin", "inf"}, node.attr
