"""EvoStick's evolutionary algorithm, as published."""

import math
from collections import Counter

import numpy as np
import pytest

from mercator_design.race import Experiment, Space, real
from mercator_design.race.methods.evostick import EvoStick, EvoStickOptions
from mercator_design.race.methods.table import METHODS
from tests.race.mixed import noise, run

WEIGHTS = Space([real(f"w{k}", -5, 5) for k in range(30)])
CENTRE = np.linspace(-2, 2, 30)
PUBLISHED = EvoStickOptions()


def square(configuration):
    """0 at CENTRE; 45 at 0, near which weights begin."""
    return float(((np.array([*configuration.values()]) - CENTRE) ** 2).sum())


def generations(race, cost=square):
    """The race to its end; the batches of each iteration."""
    found = {}
    while batch := race.ask():
        found.setdefault(race.iteration, []).append(batch)
        race.tell([cost(race.configurations[e.configuration]) + noise(0, e) for e in batch])
    return [*found.values()]


def test_the_published_plan():
    """Of 100 000: 90 generations of 100 on 10 instances, and 100 runs of each of the last population. Here a fifth."""
    assert PUBLISHED.reduced(100_000) == PUBLISHED.reduced(10_000) == (100, 10)
    race = EvoStick(WEIGHTS, budget=20_000, seed=1)
    assert race.notes == []
    plan = Counter()
    while batch := race.ask():
        plan[race.iteration] += len(batch)
        race.tell([float(e.configuration) for e in batch])
    assert [*plan.values()] == [1000] * 18 + [2000]


def test_generations_run_on_instances_of_their_own_and_the_best_fifth_have_children():
    race = EvoStick(WEIGHTS, budget=10_000, seed=1)
    *evolved, last = generations(race)
    assert len(evolved) == 9
    for k, batches in enumerate(evolved):
        population = [e.configuration for e in batches[0]]
        assert len({*population}) == 100
        assert batches == [[Experiment(one, n) for one in population] for n in range(10 * k, 10 * k + 10)]
        following = [e.configuration for e in [*evolved, last][k + 1][0]]
        means = {one: np.mean([race.costs(one)[n] for n in range(10 * k, 10 * k + 10)]) for one in population}
        elites = sorted(population, key=means.__getitem__)[:20]
        assert following[:20] == elites
        assert {race.parents[one] for one in following[20:]} <= {*elites}
    final = {one: np.mean([race.costs(one)[n] for n in range(90, 100)]) for one in following}
    assert race.best.configuration == min(final, key=final.__getitem__)
    assert race.iterations[-1].postselection


def test_weights_begin_small():
    race = EvoStick(WEIGHTS, budget=10_000, seed=1)
    race.ask()
    first = np.array([[*one.values()] for one in race.configurations])
    assert first.shape == (100, 30)
    assert abs(first).max() <= 1.0
    assert first.std() == pytest.approx(1 / math.sqrt(3), rel=0.05)


def test_mutations():
    """Of a copy of 3: what is added to leaves 2 to 4, what is replaced -1 to 1. Shares differ by chance by 0.01."""
    race = EvoStick(WEIGHTS, budget=10_000, seed=1)
    draws = np.random.default_rng(1)
    parent = {one.name: 3.0 for one in WEIGHTS.parameters}
    children = np.array([[*race._mutated(parent, draws).values()] for _ in range(4000)])

    def shares(columns):
        part = children[:, columns]
        same, replaced = (part == 3.0).mean(), (abs(part) <= 1.0).mean()
        assert ((part == 3.0) | (abs(part) <= 1.0) | ((part >= 2.0) & (part <= 4.0))).all()
        return same, replaced

    assert shares(slice(0, 25)) == pytest.approx((0.05, 0.1), abs=0.02)
    assert shares(slice(25, 30)) == pytest.approx((0.2, 0.2), abs=0.02)
    severe = (children[:, :25] <= 1.0).any(axis=1).mean()  # only severe mutation replaces one of these
    assert severe == pytest.approx(0.5 * (1 - 0.8**25), abs=0.03)
    high = race._mutated(dict.fromkeys(parent, 4.9999), draws)
    assert max(high.values()) == 5.0


@pytest.mark.parametrize(
    ("method", "budget", "most"), [("evostick", 1500, 32), ("halving", 1500, 32), ("cma-es", 600, 90)]
)
def test_thirty_weights(method, budget, most):
    """Better than where they begin (43), or than random ones, of which the best of 1000 costs 130."""
    race = METHODS[method](WEIGHTS, budget=budget, seed=1)
    run(race, cost=square)
    assert square(race.configurations[race.best.configuration]) < most


@pytest.mark.parametrize("budget", [20, 21, 39, 57, 103, 1234])
def test_small_budgets(budget):
    race = EvoStick(WEIGHTS, budget=budget, seed=1)
    run(race, cost=square)
    assert race.used == budget
    assert "is small for this method: the population is" in race.notes[0]
    assert all(race.costs(number) for number in range(len(race.configurations)))  # none was made in vain


def test_a_population_that_is_rejected_gives_way_to_what_was_accepted_before():
    race = EvoStick(WEIGHTS, budget=300, seed=1)
    while batch := race.ask():
        late = race.iteration > 3
        costs = [square(race.configurations[e.configuration]) for e in batch]
        race.tell([math.inf if late and e.configuration != 0 else c for e, c in zip(batch, costs, strict=True)])
    assert race.best.configuration == 0


def test_an_extension_that_is_too_small_for_a_population():
    race = EvoStick(WEIGHTS, budget=300, seed=1)
    run(race, cost=square)
    n = len(race.configurations)
    race.extend(303)
    run(race, cost=square)
    assert race.used == 303
    assert len(race.configurations) == n
