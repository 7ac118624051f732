"""A space whose configurations mean something beyond their parameters' values."""

import pytest

from mercator_design.race import Halving, HalvingOptions, IteratedRace, Space, integer, real
from mercator_design.race.space.parameter import key_of
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


SPACE = [integer("a", 1, 99), integer("b", 1, 99), real("x", 0, 1)]


def raced(method, **given):
    pairs = Pairs(n_simple=30)
    race = method(Space(SPACE, structure=pairs), budget=500, seed=1, **given)
    run(race, cost=lambda c: abs(c["a"] * c["b"] - 600) / 100 + c["x"])
    return race, pairs


@pytest.mark.parametrize("surrogate", [0, 0.5, 1])
def test_all_that_runs_is_in_canonical_form_and_runs_once(surrogate):
    race, pairs = raced(Halving, options=HalvingOptions(surrogate=surrogate))
    assert all(configuration["a"] <= configuration["b"] for configuration in race.configurations)
    assert len({key_of(c) for c in race.configurations}) == len(race.configurations)
    assert pairs.asked > 50
    for configuration in race.configurations:
        race.space.check(configuration)


def test_neighbours_are_moves_in_the_structure():
    race, _ = raced(Halving, options=HalvingOptions(surrogate=0))
    later = [number for number, parent in enumerate(race.parents) if parent is not None]
    assert len(later) > 20
    for number in later:
        child, parent = race.configurations[number], race.parents[number]
        before = race.configurations[parent]
        assert (child["a"] + child["b"], child["x"]) == (before["a"] + before["b"], before["x"])


@pytest.mark.parametrize(
    ("method", "given"), [(Halving, {"options": HalvingOptions(structure=False)}), (IteratedRace, {})]
)
def test_it_may_be_left_alone(method, given):
    race, pairs = raced(method, **given)
    assert not all(configuration["a"] <= configuration["b"] for configuration in race.configurations)
    assert pairs.asked == 0


@pytest.mark.parametrize("simple", [0.0, 0.5, 0.7, 1.0])
@pytest.mark.parametrize(("budget", "n_simple"), [(300, 0), (300, 4), (300, 40), (900, 4), (900, 400)])
def test_a_part_of_the_first_configurations_is_simple(budget, n_simple, simple):
    """They come first. Those of Pairs differ in each round by x, so there are enough; a few of the others are alike."""
    race = Halving(
        Space(SPACE, structure=Pairs(n_simple)), budget=budget, seed=1, options=HalvingOptions(simple=simple)
    )
    n = len(race.ask())
    is_simple = [c["a"] == c["b"] <= n_simple for c in race.configurations]
    assert n == budget // 5
    expected = round(simple * n) if n_simple else 0
    assert is_simple[:expected] == [True] * expected
    assert sum(is_simple) <= expected + 5
