"""Moves from configurations to others nearby."""

import numpy as np
import pytest

from mercator_design.race import Space, categorical, integer, parse_space, real
from mercator_design.race.proposals.moves import Moves
from mercator_design.race.space.encoding import Encoding
from tests.race.mixed import MIXED
from tests.race.spaces import machines

MACHINES = machines()
DEPENDENT = parse_space('n "" i (1, 9)\nm "" i (1, "n")\nx "" r (0, "n / 2") | n > 3')


@pytest.fixture(params=[MIXED, MACHINES, DEPENDENT], ids=["mixed", "machines", "dependent"])
def space(request):
    return request.param


class Moved:
    """Moves of configurations, which are encoded before and decoded after."""

    def __init__(self, space, seed):
        self.draws = np.random.default_rng(seed)
        self.encoding = Encoding(space)
        self.moves = Moves(self.encoding, self.draws)

    def uniform(self, n):
        return self.decoded(self.encoding.uniform(n, self.draws))

    def mutated(self, parents, donors):
        return self.decoded(self.moves.mutated(self.encoding.rows(parents), self.encoding.rows(donors)))

    def crossed(self, ones, others):
        return self.decoded(self.moves.crossed(self.encoding.rows(ones), self.encoding.rows(others)))

    def decoded(self, rows):
        return [self.encoding.configuration(row) for row in self.encoding.settled(rows)]


def test_all_moves_give_valid_configurations(space):
    moves = Moved(space, 1)
    pool = moves.uniform(50)
    for child in (*pool, *moves.mutated(pool, pool), *moves.mutated(pool, []), *moves.crossed(pool, pool[::-1])):
        space.check(child)


def test_a_mutation_changes_a_few_parameters():
    moves = Moved(MACHINES, 2)
    numbers = []
    parents = moves.uniform(200)
    for parent, child in zip(parents, moves.mutated(parents, []), strict=True):
        numbers.append(sum(child.get(name) != value for name, value in parent.items() if name in child))
        assert child != parent or numbers[-1] == 0
    assert 1 <= np.mean(numbers) < 3


def test_a_category_always_changes_to_another():
    moves = Moved(Space([categorical("a", "xyz")]), 3)
    found = {child["a"] for child in moves.mutated([{"a": "x"}] * 60, [])}
    assert found == {"y", "z"}


def test_numbers_move_near_or_anywhere():
    moves = Moved(Space([real("x", 0, 1)]), 4)
    found = np.array([child["x"] for child in moves.mutated([{"x": 0.5}] * 1000, [])])
    near = np.abs(found - 0.5) < 0.1
    # Near by half of normal steps of 0.15 (probability 0.495) and of uniform ones (0.2): 0.35, +- 0.015 at one sigma.
    assert 0.25 < near.mean() < 0.45
    assert found.min() < 0.1
    assert found.max() > 0.9


def test_what_becomes_active_is_lent_by_donors():
    space = Space([categorical("a", "xy"), integer("n", 1, 10**6, condition='a == "y"')])
    found = Moved(space, 5).mutated([{"a": "x"}] * 100, [{"a": "y", "n": 4711}])
    assert 20 < sum(child["n"] == 4711 for child in found) < 80


def test_a_crossing_takes_each_value_from_either():
    space = Space([real(f"x{k}", 0, 1) for k in range(40)])
    ones, others = ([{p.name: place for p in space.parameters}] for place in (0.25, 0.75))
    (child,) = Moved(space, 6).crossed(ones, others)
    assert set(child.values()) == {0.25, 0.75}


def test_a_crossing_has_the_structure_of_one_parent_or_of_both():
    """A parameter that is active in one parent alone has its value from there, if it is active in the child."""
    space = Space([categorical("a", "xy"), integer("n", 1, 10**6, condition='a == "y"')])
    found = Moved(space, 7).crossed([{"a": "x"}] * 50, [{"a": "y", "n": 4711}] * 50)
    assert {child.get("n") for child in found} == {None, 4711}
