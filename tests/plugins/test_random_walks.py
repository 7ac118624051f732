"""The shipped random walks: the distributions of their steps and turns, at obstacles, and in an arena."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import kstest, wrapcauchy

from mercator_design.config import shipped
from mercator_design.missions.mission import load_mission
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.reference import Readings, ReferenceModel
from mercator_design.plugins.loading import load_plugin
from mercator_design.sim.checks.trial import refuse_wrong
from mercator_design.sim.simulate import Simulator
from mercator_design.software.files import read_fsm

pytestmark = [pytest.mark.usefixtures("registries"), pytest.mark.together("kernels")]

PLUGIN = Path(__file__).parents[2] / "scenarios" / "plugins" / "random_walks"
WALKS = ("ballistic", "brownian", "levy", "correlated")
MODEL = ReferenceModel()
UNLUCKY = 1e-7
"""Chance that a Kolmogorov-Smirnov test of draws from the right distribution fails by luck."""


def software(walk):
    return read_fsm(PLUGIN / f"{walk}.txt").software


def legs(walk, n, *, way=0.02, seed=1):
    """Lengths [m] and turns [rad] before them of an ideal robot's steps, which drives `way` [m] in a cycle.

    The robot turns by 0.4 rad in a cycle at most, exactly as it is told. The first leg is left out.
    """
    load_plugin(PLUGIN)
    one = software(walk)
    state, behave = one.states[0], next(node.module.function for _, node in one.nodes)
    random, memory = np.random.default_rng(seed), [0.0] * 6
    x = y = heading = 0.0
    driven, lengths, headings = 0.0, [], []
    while len(lengths) <= n:
        readings = Readings(odometry_x=x, odometry_y=y, heading=heading)
        did = behave(MODEL, readings, memory, random.random(), *state.parameters)
        if did.left == did.right == 1.0:
            if driven == 0.0:
                headings.append(heading)
            x, y, driven = x + way * math.cos(heading), y + way * math.sin(heading), driven + way
        else:
            if driven > 0.0:
                lengths.append(driven)
                driven = 0.0
            angle = heading + 0.4 * did.right
            heading = (angle + math.pi) % (2.0 * math.pi) - math.pi
    headings = np.array(headings)
    turns = (np.diff(headings) + math.pi) % (2.0 * math.pi) - math.pi
    return np.array(lengths[1:]), turns[: n - 1]


def test_brownian_steps_have_one_length_and_uniform_directions():
    lengths, turns = legs("brownian", 400)
    assert lengths == pytest.approx(0.31, abs=0.011)  # a step ends in the cycle after its length
    assert kstest(turns, "uniform", args=(-math.pi, 2.0 * math.pi)).pvalue > UNLUCKY
    assert np.abs(turns).max() > 2.5


def test_correlated_turns_have_a_wrapped_cauchy_distribution():
    lengths, turns = legs("correlated", 400)
    assert lengths == pytest.approx(0.31, abs=0.011)
    # By luck alone the distance is above 0.145 with a chance of 1e-7; the robot drives on within 0.01 rad.
    assert kstest(turns % (2.0 * math.pi), wrapcauchy(0.9).cdf).statistic < 0.2
    assert np.mean(np.cos(turns)) == pytest.approx(0.9, abs=0.09)


def test_a_ballistic_robot_turns_to_a_uniform_direction_at_a_wall_only():
    load_plugin(PLUGIN)
    behave = next(node.module.function for _, node in software("ballistic").nodes)
    memory, drawn = [0.0] * 6, []
    for k in range(2000):
        memory[0] = 2.0  # it drives
        behave(MODEL, Readings(proximity_x=0.5), memory, (k + 0.5) / 2000)
        drawn.append(memory[1])
    assert kstest(drawn, "uniform", args=(-math.pi, 2.0 * math.pi)).statistic < 0.001
    memory[0], memory[4] = 2.0, 1e6
    for k in range(5000):
        assert tuple(behave(MODEL, Readings(odometry_x=0.03 * k), memory, 0.3))[:2] == (1.0, 1.0)


def test_the_draws_of_a_levy_step_are_those_of_its_density():
    load_plugin(PLUGIN)
    one = software("levy")
    behave = next(node.module.function for _, node in one.nodes)
    lengths = []
    for k in range(1000):
        memory = [1.0, 0.0, 0.0, 0.0, 0.0, 5.0]  # it has turned
        behave(MODEL, Readings(), memory, (k + 0.5) / 1000, *one.states[0].parameters)
        lengths.append(memory[4])
    expected = 0.1 * (1.0 - (np.arange(1000) + 0.5) / 1000) ** (-1.0 / 0.4)
    assert lengths == pytest.approx(np.minimum(expected, 1e6))


def test_a_robot_that_cannot_turn_drives_on_after_a_while():
    load_plugin(PLUGIN)
    behave = next(node.module.function for _, node in software("ballistic").nodes)
    memory = [1.0, 1.5, 0.0, 0.0, 0.0, 0.0]
    did = [behave(MODEL, Readings(), memory, 0.5) for _ in range(100)]
    assert did[0].left < 0.0 < did[0].right
    assert (did[-1].left, did[-1].right) == (1.0, 1.0)


@pytest.mark.parametrize("walk", WALKS)
def test_walks_explore_an_arena(walk):
    load_plugin(PLUGIN)
    simulator = Simulator(load_mission("map_rooms", ["duration=30"]))
    trace = simulator.run(software(walk), 1).trace
    assert np.linalg.norm(np.ptp(trace.positions, axis=0), axis=1).min() > 0.5


@pytest.mark.thorough
def test_the_flavour_can_be_tried():
    load_plugin(PLUGIN)
    refuse_wrong(flavour_of("random_walks"), MODEL)


def test_all_machines_are_shipped_with_the_flavour():
    assert {file.stem for file in PLUGIN.glob("*.txt")} == set(WALKS)
    assert PLUGIN.parent.parent == next(iter(shipped.missions().values())).parent
