"""A space whose configurations mean something beyond their parameters' values."""

import pytest

from mercator_design.race import IteratedRace, RaceOptions, Space, integer, real
from tests.race.mixed import run


class Pairs:
    """Two numbers of which the order says nothing; neighbours have the same sum."""

    def __init__(self):
        self.asked = 0

    def canonical(self, configuration):
        low, high = sorted((configuration["a"], configuration["b"]))
        return {**configuration, "a": low, "b": high}

    def neighbour(self, configuration, draws):
        self.asked += 1
        step = int(draws.integers(-3, 4))
        a, b = configuration["a"] + step, configuration["b"] - step
        return self.canonical({**configuration, "a": a, "b": b}) if 1 <= min(a, b) <= max(a, b) <= 99 else configuration


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
