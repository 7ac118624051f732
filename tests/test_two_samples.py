"""The statistics of the benchmarks: exact where the approximation is not, and the power that they state."""

import itertools
import math

import numpy as np
import pytest
from scipy.stats import mannwhitneyu, rankdata

from benchmarks.two_samples import POWER, mann_whitney, rejected, share_above, visible_shift
from tests.tiers import some


def enumerated(some, others):
    """Twice the fraction of all ways to deal the values in which the rank sum is as far out."""
    ranks = rankdata(np.concatenate([some, others]))
    found = ranks[: len(some)].sum()
    sums = np.array([sum(each) for each in itertools.combinations(ranks.tolist(), len(some))])
    return min(1.0, 2.0 * min((sums <= found + 1e-9).mean(), (sums >= found - 1e-9).mean()))


@pytest.mark.parametrize("seed", range(5))
def test_small_p_are_exact(seed):
    random = np.random.default_rng(seed)
    some, others = random.integers(2, 5, 6), random.integers(0, 3, 12)
    approximate = mannwhitneyu(some, others).pvalue
    assert approximate < 0.01
    assert mann_whitney(some, others) == pytest.approx(enumerated(some, others), rel=1e-9)
    assert mann_whitney(others, some) == pytest.approx(enumerated(some, others), rel=1e-9)


def test_values_that_are_nearly_all_equal():
    """Four of forty, and none of two hundred, are different: the normal approximation is a hundredfold too sure."""
    some, others = np.r_[np.ones(4), np.zeros(36)], np.zeros(200)
    ways = math.comb(40, 4) / math.comb(240, 4)
    assert mannwhitneyu(some, others).pvalue < 0.02 * ways
    assert mann_whitney(some, others) == pytest.approx(2 * ways)


def test_equal_values_are_one_distribution():
    assert mann_whitney(np.ones(3), np.ones(50)) == 1.0


def test_benjamini_and_hochberg():
    ps = (0.03, 0.0004, 0.0041, 0.0058, 0.5)
    assert rejected(ps, 0.01) == [1, 2, 3]
    assert rejected(ps, 0.001) == []
    assert rejected([], 0.01) == []


@pytest.mark.swept
@pytest.mark.parametrize(("n", "m", "level"), some([(40, 200, 1e-5), (10, 50, 1e-4), (5, 50, 1e-3)], 1))
def test_the_shift_that_is_called_visible_is_found_as_often_as_said(n, m, level):
    """Of 200 samples; five standard errors."""
    random = np.random.default_rng(4)
    shift = visible_shift(n, m, level)
    found = np.mean([mann_whitney(random.normal(shift, 1, n), random.normal(0, 1, m)) <= level for _ in range(200)])
    assert found == pytest.approx(POWER, abs=5 * math.sqrt(POWER * (1 - POWER) / 200))


def test_nothing_is_visible_to_samples_too_small():
    assert visible_shift(1, 50, 0.01) == math.inf
    assert visible_shift(2, 50, 0.01) < math.inf


def test_the_share_above_is_that_of_pairs():
    some, others = np.array([1.0, 2.0, 2.0, 9.0]), np.array([2.0, 3.0, 0.0])
    pairs = [1.0 if a > b else 0.5 if a == b else 0.0 for a in some for b in others]
    assert share_above(some, others) == pytest.approx(np.mean(pairs))
    assert share_above(some, others) + share_above(others, some) == pytest.approx(1.0)
