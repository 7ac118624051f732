"""Configurations that a surrogate proposes, in races and by itself."""

import math

import numpy as np
import pytest

from mercator_design.race import Halving, IteratedRace, Space, categorical, integer, real
from mercator_design.race.elimination.additive_model import effects
from mercator_design.race.elimination.history import RaceHistory
from mercator_design.race.proposals.proposals import MAX_LEARNT_FROM, Proposer
from mercator_design.race.space.encoding import Encoding
from mercator_design.race.space.parameter import key_of
from tests.race.mixed import MIXED, mixed_cost, noise, run
from tests.race.spaces import uniform


def test_effects_of_configurations_do_not_depend_on_the_instances_they_have_seen():
    generator = np.random.default_rng(1)
    quality, difficulty = generator.normal(size=30), 10 * generator.normal(size=12)
    costs = quality[:, np.newaxis] + difficulty
    costs[generator.random(costs.shape) < 0.5] = np.nan
    costs[:, 0] = quality + difficulty[0]
    means, variance = effects(costs)
    assert means - means.mean() == pytest.approx(quality - quality.mean(), abs=1e-3)
    assert variance < 1e-4


def test_the_variance_of_a_cost_is_estimated():
    """Of 60 x 20 costs: a relative error of 4 % at one sigma."""
    costs = np.random.default_rng(2).normal(size=(60, 20)) * 3 + np.arange(60.0)[:, np.newaxis]
    assert effects(costs)[1] == pytest.approx(9, rel=0.25)


def proposed(n, configurations, costs, *, excluded=lambda _: False, space=MIXED):
    return Proposer(Encoding(space)).propose(
        n,
        [0, 1],
        RaceHistory(space, configurations=configurations, costs=costs),
        generator=np.random.default_rng(3),
        excluded=excluded,
    )


def ran(n, seed=4):
    configurations = sorted(uniform(MIXED, n, np.random.default_rng(seed)), key=mixed_cost)
    return configurations, [{0: mixed_cost(c), 1: mixed_cost(c) + 1} for c in configurations]


def test_proposals_are_valid_different_new_and_better_than_what_they_were_learnt_from():
    configurations, costs = ran(60)
    found = proposed(20, configurations, costs)
    keys = {key_of(c) for c, _ in found}
    assert len(keys) == 20
    for configuration, parent in found:
        MIXED.check(configuration)
        assert parent in {0, 1}
    assert np.median([mixed_cost(c) for c, _ in found]) < np.quantile([mixed_cost(c) for c in configurations], 0.2)
    assert found == proposed(20, configurations, costs)


def test_nothing_excluded_is_proposed():
    configurations, costs = ran(30)
    found = proposed(20, configurations, costs, excluded=lambda c: c["rule"] == "fast")
    assert {c["rule"] for c, _ in found} == {"slow"}
    assert proposed(20, configurations, costs, excluded=lambda _: True) == []


def test_rejected_configurations_are_learnt_from_as_bad_ones():
    configurations, costs = ran(60)
    with_rule = [
        {**own, 0: math.inf} if c["rule"] == "fast" else own for c, own in zip(configurations, costs, strict=True)
    ]
    rules = [c["rule"] for c, _ in proposed(20, configurations, with_rule)]
    assert rules.count("slow") > rules.count("fast")


def test_equal_costs_and_more_configurations_than_are_learnt_from():
    configurations, _ = ran(MAX_LEARNT_FROM + 50)
    assert len(proposed(5, configurations, [{0: 1.0}] * len(configurations))) == 5


def test_nothing_runs_twice_as_another_configuration():
    space = Space([categorical("a", range(4)), integer("n", 1, 6)])
    race = Halving(space, budget=400, seed=1)
    run(race, cost=lambda c: int(c["a"]) + abs(c["n"] - 4) / 3)
    keys = [key_of(c) for c in race.configurations]
    assert len(keys) == len(set(keys))
    assert race.configurations[race.best.configuration] == {"a": "0", "n": 4}


def test_a_race_ends_when_all_configurations_have_run():
    space = Space([categorical("a", range(3)), categorical("b", range(3))])
    race = Halving(space, budget=400, seed=1)
    run(race, cost=lambda c: int(c["a"]) + int(c["b"]))
    assert len(race.configurations) <= 9
    assert race.stop_reason == "no configuration was found that has not run"
    assert race.configurations[race.best.configuration] == {"a": "0", "b": "0"}


def test_the_surrogate_finds_better_configurations():
    """Ten coordinates: on each of these seeds the surrogate's winner is nearer to the optimum than irace's."""
    space = Space([real(f"x{k}", 0, 1) for k in range(10)])

    def cost(c):
        return sum((x - 0.3) ** 2 for x in c.values())

    for seed in range(3):
        found = []
        for method in (Halving, IteratedRace):
            race = method(space, budget=600, seed=seed)
            while batch := race.ask():
                race.tell([cost(race.configurations[e.configuration]) + 0.3 * noise(seed, e) for e in batch])
            found.append(cost(race.configurations[race.best.configuration]))
        assert found[0] < 0.7 * found[1]


def test_irace_has_no_proposals(monkeypatch):
    monkeypatch.setattr(Proposer, "propose", None)
    run(IteratedRace(MIXED, budget=400, seed=1))
