"""The statistics of studies, beside R and scipy."""

import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from mercator_design.race.elimination.statistics import holm
from mercator_design.studies.statistics.effects import (
    a_effect,
    a_measure,
    difference_of_means,
    difference_of_medians,
    notch,
)
from mercator_design.studies.statistics.power import POWER, designs_needed, visible, visible_shift
from mercator_design.studies.statistics.rank_tests import friedman, rank_sum, signed_rank, van_elteren
from tests.tiers import some

R = json.loads((Path(__file__).parents[1] / "data" / "statistics.json").read_text())
"""What R makes of samples; by statistics.R."""
CLOSE = {"rel": 1e-9, "abs": 1e-12}


def floats(values):
    return np.array(values, dtype=float)


@pytest.mark.parametrize("case", R["rank_sum"])
def test_rank_sums_of_r(case):
    x, y = floats(case["x"]), floats(case["y"])
    assert rank_sum(x, y, ties="normal") == pytest.approx(case["wilcox.test(x, y)"], **CLOSE)
    assert rank_sum(y, x, ties="normal") == pytest.approx(case["wilcox.test(x, y)"], **CLOSE)
    approximate = stats.mannwhitneyu(x, y, method="asymptotic").pvalue
    assert approximate == pytest.approx(case["wilcox.test(x, y, exact = FALSE)"], **CLOSE)
    if dealt := case["combn(rank(c(x, y)), length(x), sum)"]:
        assert rank_sum(x, y) == pytest.approx(dealt, **CLOSE)


@pytest.mark.parametrize("case", R["signed_rank"])
def test_signed_ranks_of_r(case):
    differences = floats(case["x"]) - floats(case["y"])
    expected = case["wilcox.test(x, y, paired = TRUE)"]
    assert signed_rank(differences, ties="normal") == pytest.approx(expected, **CLOSE)
    assert signed_rank(-differences, ties="normal") == pytest.approx(expected, **CLOSE)


@pytest.mark.parametrize("case", R["friedman"])
def test_friedman_and_nemenyi_of_r(case):
    found = friedman(-floats(case["rows"]))  # ranks of R begin with the smallest
    assert found.p_value == pytest.approx(case["friedman.test(rows)"], **CLOSE)
    assert found.statistic == pytest.approx(case["friedman.test(rows)$statistic"], **CLOSE)
    pairs = [found.p_values[pair] for pair in itertools.combinations(range(len(found.mean_ranks)), 2)]
    assert pairs == pytest.approx(case["ptukey"], abs=1e-9)


@pytest.mark.parametrize("case", R["holm"])
def test_holm_of_r(case):
    assert holm(floats(case["p"])).tolist() == pytest.approx(case["p.adjust(p, 'holm')"], **CLOSE)


@pytest.mark.parametrize("case", R["van_elteren"])
def test_van_elteren_of_r(case):
    pairs = list(zip(map(floats, case["x"]), map(floats, case["y"]), strict=True))
    assert van_elteren(pairs) == pytest.approx(case["coin::independence_test"], **CLOSE)


def enumerated(first, second):
    """Twice the fraction of all ways to deal the values in which the rank sum is as far out."""
    ranks = stats.rankdata(np.concatenate([first, second]))
    found = ranks[: len(first)].sum()
    sums = np.array([sum(each) for each in itertools.combinations(ranks.tolist(), len(first))])
    return min(1.0, 2.0 * min((sums <= found + 1e-9).mean(), (sums >= found - 1e-9).mean()))


@pytest.mark.parametrize("seed", range(5))
def test_rank_sums_are_exact_with_ties(seed):
    random = np.random.default_rng(seed)
    first, second = random.integers(2, 5, 6), random.integers(0, 3, 12)
    assert rank_sum(first, second) == pytest.approx(enumerated(first, second), rel=1e-9)
    assert rank_sum(second, first) == pytest.approx(enumerated(first, second), rel=1e-9)


def test_values_that_are_nearly_all_equal():
    """Four of forty, and none of two hundred, are different: the normal approximation is a hundredfold too sure."""
    first, second = np.r_[np.ones(4), np.zeros(36)], np.zeros(200)
    ways = math.comb(40, 4) / math.comb(240, 4)
    assert rank_sum(first, second, ties="normal") < 0.02 * ways
    assert rank_sum(first, second) == pytest.approx(2 * ways)


def test_equal_values_are_one_distribution():
    assert rank_sum(np.ones(3), np.ones(50)) == 1.0
    assert signed_rank(np.zeros(4)) == signed_rank(np.zeros(4), ties="normal") == 1.0
    assert friedman(np.ones((4, 3))).p_value == 1.0
    assert van_elteren([(np.ones(3), np.ones(3))]) == 1.0


def test_signed_ranks_are_exact_with_ties_and_zeros():
    differences = np.array([0.0, 1.0, 1.0, 2.0, -1.0, 3.0, 3.0])
    ranks = stats.rankdata(np.abs(differences)) * (differences != 0)
    found = ranks[differences > 0].sum()
    sums = np.array([np.dot(ranks, signs) for signs in itertools.product((0, 1), repeat=7)])
    assert signed_rank(differences) == pytest.approx(2 * (sums >= found - 1e-9).mean())


def test_van_elteren_s_test_is_the_rank_sum_test_on_one_problem():
    random = np.random.default_rng(1)
    first, second = random.normal(0.5, 1, 30), random.normal(0, 1, 25).round(1)
    one = stats.mannwhitneyu(first, second, method="asymptotic", use_continuity=False).pvalue
    assert van_elteren([(first, second)]) == pytest.approx(one)
    assert van_elteren([(first, second), (second, first)]) == pytest.approx(1.0, abs=0.2)
    assert van_elteren([(first, second)] * 4) < one**2


def test_nemenyi_s_distance_is_that_of_its_table():
    """Demsar 2006, table 5: 2.343 for three methods and 2.728 for five."""
    for k, q in ((3, 2.343), (5, 2.728)):
        found = friedman(np.random.default_rng(k).random((10, k)))
        assert found.distance == pytest.approx(q * math.sqrt(k * (k + 1) / 60), rel=3e-4)


def test_the_a_measure_is_that_of_pairs():
    first, second = np.array([1.0, 2.0, 2.0, 9.0]), np.array([2.0, 3.0, 0.0])
    pairs = [1.0 if a > b else 0.5 if a == b else 0.0 for a in first for b in second]
    assert a_measure(first, second) == pytest.approx(np.mean(pairs))
    assert a_measure(first, second) + a_measure(second, first) == pytest.approx(1.0)


def test_effects_have_intervals_around_them():
    first, second = np.arange(10.0), np.arange(10.0) + 3.0
    for effect, value in ((a_effect, 0.245), (difference_of_medians, -3.0), (difference_of_means, -3.0)):
        found = effect(first, second)
        assert found.value == pytest.approx(value)
        assert found.low < value < found.high
        assert effect(first, second) == found
        assert effect(first[:1], second)[1:] == (None, None)


def test_intervals_hold_what_they_estimate_as_often_as_they_say():
    """Of 100 samples; 93 of 100 are expected, and fewer than 76 have a chance of 1e-7."""
    random = np.random.default_rng(2)
    inside = 0
    for _ in range(100):
        _, low, high = a_effect(random.normal(0.5, 1, 20), random.normal(0, 1, 20))
        inside += low <= 0.638 <= high  # normal distribution function at 0.5 / sqrt(2)
    assert inside >= 76


def test_a_notch_is_that_of_box_plots():
    values = np.arange(1.0, 10.0)
    assert notch(values) == pytest.approx((5 - 1.57 * 4 / 3, 5 + 1.57 * 4 / 3))


@pytest.mark.swept
@pytest.mark.parametrize(("n", "m", "level"), some([(40, 200, 1e-5), (10, 50, 1e-4), (5, 50, 1e-3)], 1))
def test_the_shift_that_is_called_visible_is_found_as_often_as_said(n, m, level):
    """Of 200 samples; five standard errors."""
    random = np.random.default_rng(4)
    shift = visible_shift(n, m, level)
    found = np.mean([rank_sum(random.normal(shift, 1, n), random.normal(0, 1, m)) <= level for _ in range(200)])
    assert found == pytest.approx(POWER, abs=5 * math.sqrt(POWER * (1 - POWER) / 200))


def test_nothing_is_visible_to_samples_too_small():
    assert visible_shift(1, 50, 0.01) == math.inf
    assert visible_shift(2, 50, 0.01) < math.inf
    assert visible(3).shift == math.inf
    assert visible(4).shift < math.inf
    assert visible(10).a_measure > visible(20).a_measure > 0.5
    assert visible(20, 14).shift > visible(20).shift


@pytest.mark.parametrize("n_tests", [1, 100, 10**9])
def test_the_designs_needed_are_the_least_that_can_show_a_difference(n_tests):
    n, level = designs_needed(n_tests), 0.05 / n_tests
    least_p = [rank_sum(np.arange(k, 2.0 * k), np.arange(float(k))) for k in (n - 1, n)]
    assert least_p[1] <= level < least_p[0]


def test_the_designs_needed_are_counted_without_a_limit():
    assert designs_needed(10**30) == 55
    assert 2 / math.comb(110, 55) <= 0.05e-30 < 2 / math.comb(108, 54)
