from itertools import combinations

import pytest

from mercator_design.race.elimination.postselection import select_candidates


def test_complete_candidates_share_the_budget_on_new_instances():
    assert select_candidates({4: 0, 1: 0, 7: 3, 2: 0}, 2, 1) == [4, 1]


def test_all_complete_candidates_count_however_many():
    assert select_candidates(dict.fromkeys(range(30), 0), 20, 1) == list(range(20))


def test_as_many_as_can_run_on_a_new_instance_otherwise():
    assert select_candidates({4: 0, 1: 2, 7: 9}, 4, 1) == [4, 1]
    assert select_candidates({4: 0, 1: 2, 7: 9}, 14, 1) == [4, 1, 7]


def test_of_equally_many_those_with_the_best():
    assert select_candidates({4: 2, 1: 1, 7: 1}, 5, 1) == [4, 1]


def test_a_budget_too_small_for_new_instances_completes():
    assert select_candidates({4: 0, 1: 1, 7: 9}, 2, 4) == [4, 1]


@pytest.mark.parametrize("needs", [{}, {4: 0}, {4: 0, 1: 9}, {4: 9, 1: 9}])
def test_fewer_than_two_are_none(needs):
    assert select_candidates(needs, 5, 6) == []


@pytest.mark.parametrize("budget", range(3, 40, 3))
def test_no_larger_choice_would_fit(budget):
    needs = {number: number * number % 7 + number % 2 for number in range(10)}
    chosen = select_candidates(needs, budget, 1)
    prices = {candidate: need + 1 for candidate, need in needs.items()}
    fitting = [
        group for size in range(2, 11) for group in combinations(needs, size) if sum(prices[c] for c in group) <= budget
    ]
    assert len(chosen) == max(map(len, fitting))
    assert sum(prices[c] for c in chosen) <= budget
