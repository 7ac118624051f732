import pytest

from mercator_design.design import Designer, Scores
from mercator_design.missions.mission import load_mission
from mercator_design.seeds import LARGEST_SEED, instance_seed
from mercator_design.sim.simulate import Simulator


def test_scores_sum_up():
    scores = Scores((1.0, 2.0, 3.0, 6.0))
    assert scores.mean == 3.0
    assert scores.standard_deviation == pytest.approx(2.160247)
    assert scores.quartiles == (1.75, 2.5, 3.75)
    low, high = scores.confidence_interval  # t of 3 degrees of freedom: 3.182446
    assert (low, high) == (pytest.approx(3 - 3.182446 * 2.160247 / 2), pytest.approx(3 + 3.182446 * 2.160247 / 2))


def test_a_single_score_has_no_spread():
    assert Scores((4.0,)).standard_deviation is None
    assert Scores((4.0,)).confidence_interval is None


def test_a_huge_budget_costs_nothing_before_it_is_used():
    simulator = Simulator(load_mission("aggregation", ["duration=1"]))
    assert Designer(simulator, budget=10**12, seed=1).race.ask()


def test_seeds_of_instances_are_those_of_irace_s_domain_and_differ_by_purpose():
    seeds = [instance_seed(1, purpose, k) for purpose in ("race", "evaluation") for k in range(500)]
    assert all(1 <= seed <= LARGEST_SEED for seed in seeds)
    assert len(set(seeds)) == len(seeds)  # a chance below 3e-4 for one master seed; this one is fixed
