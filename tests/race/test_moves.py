"""Moves from configurations to others nearby."""

import itertools

import numpy as np
import pytest

from mercator_design.race import Space, categorical, integer, parse_space, real
from mercator_design.race.methods.moves import Moves
from tests.race.mixed import MIXED
from tests.race.spaces import machines_text

MACHINES = parse_space(machines_text())
DEPENDENT = parse_space('n "" i (1, 9)\nm "" i (1, "n")\nx "" r (0, "n / 2") | n > 3')


@pytest.fixture(params=[MIXED, MACHINES, DEPENDENT], ids=["mixed", "machines", "dependent"])
def space(request):
    return request.param


def test_all_moves_give_valid_configurations(space):
    moves = Moves(space, np.random.default_rng(1))
    pool = [moves.uniform() for _ in range(50)]
    for one, other in itertools.pairwise(pool):
        for child in (one, moves.mutated(one, pool), moves.mutated(one, []), moves.crossed(one, other)):
            space.check(child)


def test_a_mutation_changes_a_few_parameters():
    moves = Moves(MACHINES, np.random.default_rng(2))
    numbers = []
    for _ in range(200):
        parent = moves.uniform()
        child = moves.mutated(parent, [])
        numbers.append(sum(child.get(name) != value for name, value in parent.items() if name in child))
        assert child != parent or numbers[-1] == 0
    assert 1 <= np.mean(numbers) < 3


def test_a_category_always_changes_to_another():
    space = Space([categorical("a", "xyz")])
    moves = Moves(space, np.random.default_rng(3))
    found = {moves.mutated({"a": "x"}, [])["a"] for _ in range(60)}
    assert found == {"y", "z"}


def test_numbers_move_near_or_anywhere():
    moves = Moves(Space([real("x", 0, 1)]), np.random.default_rng(4))
    found = np.array([moves.mutated({"x": 0.5}, [])["x"] for _ in range(1000)])
    near = np.abs(found - 0.5) < 0.1
    # Near by half of normal steps of 0.15 (probability 0.495) and of uniform ones (0.2): 0.35, +- 0.015 at one sigma.
    assert 0.25 < near.mean() < 0.45
    assert found.min() < 0.1
    assert found.max() > 0.9


def test_what_becomes_active_is_lent_by_donors():
    space = Space([categorical("a", "xy"), integer("n", 1, 10**6, condition='a == "y"')])
    moves = Moves(space, np.random.default_rng(5))
    lent = [moves.mutated({"a": "x"}, [{"a": "y", "n": 4711}])["n"] == 4711 for _ in range(100)]
    assert 20 < sum(lent) < 80


def test_a_crossing_takes_each_value_from_either():
    space = Space([real(f"x{k}", 0, 1) for k in range(40)])
    moves = Moves(space, np.random.default_rng(6))
    child = moves.crossed({p.name: 0.25 for p in space.parameters}, {p.name: 0.75 for p in space.parameters})
    assert set(child.values()) == {0.25, 0.75}
