"""The tests of a race against other oracles than irace, with which test_vectors.py compares."""

import math
import tracemalloc

import numpy as np
import pytest
from scipy.stats import wilcoxon

from mercator_design.race.elimination.statistics import concordance, eliminate, holm, signed_rank_p_value
from tests.tiers import some


def test_equal_costs_have_full_concordance():
    assert concordance(np.ones((3, 2))) == 1.0


@pytest.mark.parametrize("n", [3, 10, 49, 50, 80])
def test_wilcoxon_is_scipys(n):
    """An oracle of its own for more instances than the measured cases have."""
    costs = np.random.default_rng(n).normal(size=(n, 2))
    costs[:, 1] += 0.3
    method = "exact" if n < 50 else "approx"
    expected = wilcoxon(costs[:, 0], costs[:, 1], method=method, correction=True).pvalue
    assert eliminate(costs, "friedman", 0.95).p_value == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("n", [5, 30])
def test_friedman_is_scipys(n):
    from scipy.stats import friedmanchisquare

    costs = np.random.default_rng(n).integers(0, 4, size=(n, 6)).astype(float)
    assert eliminate(costs, "friedman", 0.95).p_value == pytest.approx(friedmanchisquare(*costs.T).pvalue)


def test_one_that_is_nowhere_worse_wins_without_a_test():
    costs = np.array([[1.0, 2.0], [3.0, 3.0]])
    assert eliminate(costs, "friedman", 0.999).survivors.tolist() == [True, False]
    assert eliminate(costs[:, ::-1], "friedman", 0.999).survivors.tolist() == [False, True]


def test_equal_costs_eliminate_nothing_among_three():
    verdict = eliminate(np.ones((4, 3)), "friedman", 0.95)
    assert verdict.survivors.all()
    assert math.isnan(verdict.p_value)


def test_friedman_eliminates_none_on_one_instance():
    """At a low confidence, its p-value is significant."""
    verdict = eliminate(np.array([[1.0, 2.0, 3.0, 4.0]]), "friedman", 0.5)
    assert verdict.p_value < 0.5
    assert verdict.survivors.all()


@pytest.mark.swept
@pytest.mark.parametrize("seed", some(range(20), 6))
def test_signed_ranks_as_scipy_s(seed):
    draws = np.random.default_rng(seed)
    differences = draws.integers(-3, 5, 8).astype(float) if seed % 2 else draws.normal(0.5, 1, 30)
    expected = wilcoxon(differences, alternative="greater", zero_method="zsplit").pvalue
    assert signed_rank_p_value(differences) == pytest.approx(expected, rel=1e-9)


def test_p_values_are_corrected_as_holm_does():
    assert holm(np.array([0.01, 0.04, 0.03])) == pytest.approx([0.03, 0.06, 0.06])


@pytest.mark.parametrize("seed", range(4))
def test_many_signed_ranks_as_scipy_s_approximation(seed):
    draws = np.random.default_rng(seed)
    differences = draws.normal(0.1, 1, 50 + 100 * seed)
    if seed % 2:  # ties, but no zeros, which the approximation of scipy counts as a tie
        differences = np.ceil(10 * np.abs(differences)) * np.sign(differences)
    expected = wilcoxon(differences, alternative="greater", method="approx", correction=True).pvalue
    assert signed_rank_p_value(differences) == pytest.approx(expected, rel=1e-9)


def test_many_zeros_are_not_significant():
    """Few differences besides them are tested exactly."""
    assert signed_rank_p_value(np.zeros(60)) == 1.0
    assert signed_rank_p_value(np.array([0.0] * 60 + [1.0])) == 0.5


@pytest.mark.swept
@pytest.mark.parametrize("n", some(range(2, 40), 10))
def test_of_two_the_one_with_the_lower_median_of_all_pairs_wins(n):
    """Also with ties, and if as many sums of pairs are above 0 as below."""
    draws = np.random.default_rng(n)
    for _ in range(50):
        differences = draws.integers(-3, 4, n) / 2 if n % 2 else draws.normal(0, 1, n).round(1)
        costs = np.column_stack((5 + differences, np.full(n, 5.0)))
        differences = costs[:, 0] - costs[:, 1]
        differences = differences[differences != 0]
        if (differences < 0).any() and (differences > 0).any():
            sums = np.add.outer(differences, differences)[np.tril_indices(len(differences))]
            assert eliminate(costs, "friedman", 0.95).best == int(np.median(sums) > 0)


def test_two_are_compared_without_all_pairs_in_memory():
    costs = np.random.default_rng(1).normal(size=(3000, 2))
    eliminate(costs[:60], "friedman", 0.95)  # loads scipy
    tracemalloc.start()
    eliminate(costs, "friedman", 0.95)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 3000 * 8 * 50  # all pairs are 36 MB
