"""What configurations cost as if all had seen the same instances."""

import tracemalloc

import numpy as np

from mercator_design.race.elimination.additive_model import effects, expected, table

INSTANCES = np.array([0.0, 10.0, -20.0, 5.0, 1.0, 4.0])
TRUE = np.array([3.0, 1.0, 2.0, 8.0])


def test_a_table_of_costs():
    found = table([{0: 1.0, 3: 2.0}, {}, {1: np.inf}])
    np.testing.assert_array_equal(found, [[1, np.nan, 2], [np.nan] * 3, [np.nan, np.inf, np.nan]])
    assert table([]).shape == (0, 0)


def test_the_memory_of_an_expectation_is_that_of_few_tables():
    """Also where most places of the table are empty, as those of all elites of a long race."""
    costs = np.full((100, 500), np.nan, order="F")
    costs[:, :10] = np.random.default_rng(1).normal(size=(100, 10))
    costs[0] = 1.0
    expected(costs)
    tracemalloc.start()
    try:
        expected(costs)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 4 * costs.nbytes  # and the one that is given


def test_instances_are_taken_out_where_there_are_gaps():
    costs = TRUE[:, np.newaxis] + INSTANCES
    costs[0, :3] = costs[1, 4] = costs[2, 1:3] = np.nan
    means, variance = effects(costs)
    np.testing.assert_allclose(means - means.mean(), TRUE - TRUE.mean(), atol=1e-6)
    assert variance < 1e-9
    found = expected(costs)
    np.testing.assert_allclose(found - found.mean(), TRUE - TRUE.mean(), atol=1e-6)


def test_one_extreme_result_does_not_decide():
    noise = np.random.default_rng(1).normal(scale=0.1, size=(4, 30))
    costs = TRUE[:, np.newaxis] + noise
    costs[1, 7] += 1000.0
    assert effects(costs)[0].argmin() != 1
    assert expected(costs).argmin() == 1


def test_few_results_count_for_less():
    """All are near 0 by what they cost, but for the two best; one of these has a single result."""
    costs = np.random.default_rng(2).normal(size=(8, 40))
    costs[:, 0] = 0.0
    costs[:2] -= 2.0
    costs[1, 1:] = np.nan
    means, _ = effects(costs)
    drawn = (expected(costs) - means.mean()) / (means - means.mean())
    assert drawn[0] > 0.9
    assert drawn[1] < 0.7


def test_equal_costs_are_expected_to_stay_equal():
    assert expected(np.full((3, 4), 7.0)).tolist() == [7.0] * 3
