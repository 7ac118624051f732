"""Behaviours do their job in the arena.

Each comparison is a paired one over 40 or 16 seeds, of means that are more than 25 standard errors apart, where ten are
wanted; at six the chance of failing by luck would be below 1e-8.
"""

import dataclasses
import functools

import numpy as np
import pytest

from mercator_design.fsm import parse
from mercator_design.sim.robot_model import load_robot_model
from tests.sim.worlds import simulator

pytestmark = pytest.mark.together

SEEDS, FEWER = range(40), range(16)


@functools.cache
def final_distances(fsm):
    """For each seed the mean distance between robots at start and end, in a large arena."""
    ready = simulator(robots=8, duration=60, apothem=2.5, placement="{shape: disc, radius: 0.9}")
    found = []
    for seed in FEWER:
        poses = ready.run(parse(fsm), seed).trace.poses
        found.append([_mean_distance(poses[0]), _mean_distance(poses[-1])])
    return np.array(found).T


def _mean_distance(poses):
    x, y = poses[:, 0], poses[:, 1]
    distance = np.hypot(x[:, None] - x, y[:, None] - y)
    return distance.sum() / (len(x) * (len(x) - 1))


def standard_errors(differences):
    return differences.mean() / (differences.std(ddof=1) / np.sqrt(len(differences)))


def test_exploration_covers():
    """One robot visits nearly all of the 16 cells of 0.5 m that its centre can reach.

    One that sees no obstacle, and so goes straight on, does not.
    """
    mercator = load_robot_model("mercator")
    blind = dataclasses.replace(mercator, reference_model=mercator.reference_model._replace(obstacle_threshold=2.0))
    explore = parse("--nstates 1 --s0 0 --rwm0 20")

    def cells(model, seeds):
        ready = simulator(duration=240, apothem=1.226, robot_model=model)
        positions = [ready.run(explore, seed).trace.positions.reshape(-1, 2) for seed in seeds]
        return np.array([len(np.unique(np.floor(position / 0.5), axis=0)) for position in positions])

    explored = cells(mercator, SEEDS)
    assert standard_errors(explored[: len(FEWER)] - cells(blind, FEWER)) > 10
    assert standard_errors(explored - 15) > 6


@pytest.mark.thorough
@pytest.mark.parametrize("alpha", [2, 5])
def test_attraction_gathers(alpha):
    _, end = final_distances(f"--nstates 1 --s0 2 --att0 {alpha}")
    _, explored = final_distances("--nstates 1 --s0 0 --rwm0 20")
    assert standard_errors(explored - end) > 10


@pytest.mark.parametrize("alpha", [2, 5])
def test_repulsion_spreads(alpha):
    start, end = final_distances(f"--nstates 1 --s0 3 --rep0 {alpha}")
    assert standard_errors(end - start) > 10
