"""The configurations that enter a race by halving."""

import math

import numpy as np
import pytest

from mercator_design.errors import RaceError
from mercator_design.race import Experiment, Space, categorical, integer
from mercator_design.race.elimination.history import RaceHistory
from mercator_design.race.proposals.newcomers import Newcomers
from mercator_design.race.space.parameter import key_of
from tests.race.mixed import MIXED, mixed_cost
from tests.race.spaces import uniform
from tests.race.test_structure import SPACE as OF_PAIRS
from tests.race.test_structure import Pairs

PAIRS = Space(OF_PAIRS, structure=Pairs(n_simple=30))


def draws(purpose):
    """The same draws for a purpose each time."""
    return np.random.default_rng([*purpose.encode()])


def keys(children):
    return [key_of(configuration) for configuration, _ in children]


def ran(space, n=30, cost=mixed_cost):
    """A history in which some configurations have run, the best first."""
    history = RaceHistory(space)
    configurations = sorted(uniform(space, n, np.random.default_rng(4)), key=cost)
    for number in history.add([(configuration, None) for configuration in configurations]):
        history.record([Experiment(number, 0)], [cost(configurations[number])])
    return history


def first(space, n, *, history=None, initial=(), simple=0.5, structure=True):
    newcomers = Newcomers(space, history or RaceHistory(space), structure=structure)
    return newcomers.first(n, newcomers.simple(n, initial, simple, draws("simple")), draws("sampling"))


def later(history, n, *, elites=(0, 1, 2), surrogate=0.5, structure=True):
    newcomers = Newcomers(history.space, history, structure=structure)
    n_proposed, further = round(surrogate * n), draws("neighbours")
    neighbours = newcomers.neighbours(n - n_proposed, elites, further)
    return newcomers.later(n, elites, neighbours, n_proposed=n_proposed, proposals=draws("proposals"), draws=further)


class TestFirst:
    def test_given_then_simple_then_evenly_spread(self):
        initial = [{"a": 90, "b": 7, "x": 0.5}, {"a": 1, "b": 2, "x": 0.25}]
        found = [configuration for configuration, _ in first(PAIRS, 22, initial=initial, simple=0.4)]
        assert found[:2] == initial
        assert [c["a"] == c["b"] <= 30 for c in found[2:10]] == [True] * 8
        assert sum(c["a"] != c["b"] for c in found[10:]) > 8
        assert all(c["a"] <= c["b"] for c in found[2:])
        assert len(found) == len(set(map(key_of, found))) == 22

    def test_they_have_no_parents(self):
        assert {parent for _, parent in first(MIXED, 20)} == {None}

    def test_it_is_the_same_with_the_same_draws(self):
        assert first(PAIRS, 30) == first(PAIRS, 30)

    def test_without_the_structure_all_are_evenly_spread(self):
        found = [configuration for configuration, _ in first(PAIRS, 64, simple=1, structure=False)]
        assert len(found) == 64
        assert any(c["a"] > c["b"] for c in found)
        assert sum(c["a"] == c["b"] for c in found) < 5

    def test_a_structure_without_simple_configurations(self):
        assert len(first(Space(OF_PAIRS, structure=Pairs(0)), 16, simple=1)) == 16

    def test_each_comes_once_even_if_it_is_given(self):
        space = Space([categorical("a", range(4)), integer("b", 1, 2)])
        initial = [{"a": "3", "b": 2}, {"a": "0", "b": 1}]
        found = first(space, 50, initial=initial)
        assert [configuration for configuration, _ in found[:2]] == initial
        assert len(set(keys(found))) == len(found) == 8

    def test_more_given_ones_than_there_is_room_for(self):
        initial = [{"a": k, "b": k, "x": 0.5} for k in range(1, 9)]
        assert first(PAIRS, 5, initial=initial) == [(one, None) for one in initial[:5]]

    def test_given_ones_that_are_all_there_are(self):
        space = Space([categorical("a", range(3))])
        initial = [{"a": str(k)} for k in range(3)]
        assert first(space, 10, initial=initial) == [(one, None) for one in initial]

    def test_what_is_forbidden_does_not_come(self):
        forbidden = Space(OF_PAIRS, structure=Pairs(n_simple=30), forbidden=["a > 10"])
        found = first(forbidden, 30)
        assert len(found) > 15
        assert max(configuration["a"] for configuration, _ in found) <= 10

    def test_it_is_an_error_if_all_are_forbidden(self):
        with pytest.raises(RaceError, match="all that were sampled are forbidden"):
            first(Space([integer("n", 1, 100)], forbidden=["n > 0"]), 20)


@pytest.mark.parametrize("surrogate", [0, 0.5, 1])
class TestLater:
    def test_each_is_new_and_comes_once(self, surrogate):
        history = ran(MIXED)
        found = later(history, 24, surrogate=surrogate)
        assert len(set(keys(found))) == len(found) == 24
        for configuration, parent in found:
            MIXED.check(configuration)
            assert history.number(configuration) is None
            assert parent in {0, 1, 2}

    def test_it_is_the_same_with_the_same_draws(self, surrogate):
        assert later(ran(MIXED), 12, surrogate=surrogate) == later(ran(MIXED), 12, surrogate=surrogate)

    def test_a_space_of_which_a_few_are_left(self, surrogate):
        space = Space([categorical("a", range(4)), integer("b", 1, 5)])
        history = ran(space, 12, cost=lambda c: c["b"])
        known = set(map(key_of, history.configurations))
        found = later(history, 50, surrogate=surrogate)
        assert found
        assert len(set(keys(found))) == len(found) <= 20 - len(known)
        assert not known & set(keys(found))

    def test_a_space_of_which_nothing_is_left(self, surrogate):
        space = Space([categorical("a", range(3))])
        history = RaceHistory(space)
        for number in history.add([({"a": str(k)}, None) for k in range(3)]):
            history.record([Experiment(number, 0)], [float(number)])
        assert later(history, 5, surrogate=surrogate) == []

    def test_what_is_forbidden_or_was_rejected_does_not_come(self, surrogate):
        space = Space([integer("n", 1, 40), categorical("a", "xy")], forbidden=["n > 20"])
        history = RaceHistory(space)
        for n in range(1, 11):
            (number,) = history.add([({"n": n, "a": "x"}, None)])
            history.record([Experiment(number, 0)], [math.inf if n == 7 else float(20 - n)])
        found = later(history, 30, elites=[9, 8], surrogate=surrogate)
        assert len(found) > 10
        assert {"n": 7, "a": "x"} not in [configuration for configuration, _ in found]
        assert max(configuration["n"] for configuration, _ in found) <= 20

    def test_those_of_a_structure_are_in_canonical_form(self, surrogate):
        def cost(configuration):
            return abs(configuration["a"] - 20) + abs(configuration["b"] - 60)

        history = RaceHistory(PAIRS)
        given = [PAIRS.structure.canonical(c) for c in uniform(PAIRS, 40, np.random.default_rng(1))]
        for number in history.add([(configuration, None) for configuration in sorted(given, key=cost)]):
            history.record([Experiment(number, 0)], [cost(history.configurations[number])])
        found = later(history, 12, elites=range(5), surrogate=surrogate)
        assert len(found) == 12
        assert all(configuration["a"] <= configuration["b"] for configuration, _ in found)


def test_neighbours_differ_from_their_parents_in_a_few_parameters():
    history = ran(MIXED)
    found = later(history, 60, surrogate=0)
    changed = []
    for configuration, parent in found:
        before = history.configurations[parent]
        changed.append(sum(configuration.get(p.name) != before.get(p.name) for p in MIXED.parameters))
    assert min(changed) == 1
    assert np.mean(changed) < 3
    assert {parent for _, parent in found} == {0, 1, 2}


def test_those_of_the_surrogate_come_first_and_are_better():
    history = ran(MIXED, 60)
    proposed = later(history, 20, surrogate=1)
    assert later(history, 40, surrogate=0.5)[:20] == proposed
    neighbours = later(history, 20, surrogate=0)
    median = np.median([mixed_cost(c) for c in history.configurations])
    for found in (proposed, neighbours):
        assert np.median([mixed_cost(c) for c, _ in found]) < median
