"""A space whose configurations mean something beyond their parameters' values."""

import pytest

from mercator_design.race import IteratedRace, RaceOptions, Space, integer, real
from tests.race.mixed import run


class Pairs:
    """Two numbers of which the order says nothing; neighbours have the same sum."""

    def __init__(self, n_simple=0):
        self.asked, self.n_simple = 0, n_simple

    def canonical(self, configuration):
        low, high = sorted((configuration["a"], configuration["b"]))
        return {**configuration, "a": low, "b": high}

    def neighbour(self, configuration, draws):
        self.asked += 1
        step = int(draws.integers(-3, 4))
        a, b = configuration["a"] + step, configuration["b"] - step
        return self.canonical({**configuration, "a": a, "b": b}) if 1 <= min(a, b) <= max(a, b) <= 99 else configuration

    def simple(self, draws):
        return [{"a": k, "b": k, "x": round(draws.random(), 4)} for k in range(1, self.n_simple + 1)]


def raced(options):
    pairs = Pairs()
    space = Space([integer("a", 1, 99), integer("b", 1, 99), real("x", 0, 1)], structure=pairs)
    race = IteratedRace(space, budget=500, seed=1, options=options)
    run(race, cost=lambda c: abs(c["a"] * c["b"] - 600) / 100 + c["x"])
    return race, pairs


def test_what_the_sampling_model_draws_is_in_canonical_form():
    race, _ = raced(RaceOptions(surrogate=0))
    assert all(configuration["a"] <= configuration["b"] for configuration in race.configurations)
    assert len({race.space.key(c) for c in race.configurations}) == len(race.configurations)


def test_neighbours_are_candidates():
    race, pairs = raced(RaceOptions())
    assert pairs.asked > 100
    for configuration in race.configurations:
        race.space.check(configuration)


@pytest.mark.parametrize("options", [RaceOptions(structure=0), RaceOptions.irace()])
def test_it_may_be_left_alone(options):
    race, pairs = raced(options)
    assert not all(configuration["a"] <= configuration["b"] for configuration in race.configurations)
    assert pairs.asked == 0


@pytest.mark.parametrize(("budget", "n_simple"), [(300, 0), (300, 4), (300, 40), (900, 4), (900, 400)])
def test_a_part_of_the_first_configurations_is_simple(budget, n_simple):
    def first(options):
        space = Space([integer("a", 1, 99), integer("b", 1, 99), real("x", 0, 1)], structure=Pairs(n_simple))
        race = IteratedRace(space, budget=budget, seed=1, options=options)
        race.ask()
        simple = [c for c in race.configurations if c["a"] == c["b"] <= n_simple]
        return len(race.configurations), len(simple), race

    planned, none, _ = first(RaceOptions(simple=0))
    n, k, race = first(RaceOptions(simple=1))
    room = race._planner.next(1, left=budget, n_elites=0, n_seen=0).budget // 2 - planned  # two instances each
    assert none == 0
    assert k == max(min(n_simple, planned, room), 0)
    assert n == planned + k
    assert first(RaceOptions(simple=0.5))[1] == max(min(n_simple, planned // 2, room), 0)
