"""The tests of a race against R's numbers; means that differ by rounding alone are in order there, ties here."""

import math

import numpy as np
import pytest

from mercator_design.race.tests import concordance, eliminate, overall_ranks, ranking
from tests.race.reference import load, table

T_TESTS = {"none": "t-test", "holm": "t-test-holm", "bonferroni": "t-test-bonferroni"}


def numbered(case, mask):
    return [number for number, kept in zip(case["alive_before"], mask, strict=True) if kept]


def alive(case):
    return table(case["costs"])[:, np.array(case["alive_before"]) - 1]


def test_friedman_and_wilcoxon_are_iraces():
    cases = load("race_tests")
    assert len(cases) == 220
    for case in cases:
        expected = case["friedman"]
        verdict = eliminate(alive(case), "friedman", case["confidence"])
        assert numbered(case, verdict.survivors) == expected["survivors"]
        assert verdict.ranks.tolist() == expected["test_ranks"]
        ranks = ranking(alive(case), "friedman")
        assert ranks.tolist() == expected["race_ranks"]
        assert case["alive_before"][int(ranks.argmin())] == expected["best"]
        p_value = math.nan if expected["p_value"] in {None, "NaN"} else expected["p_value"]
        assert verdict.p_value == pytest.approx(p_value, rel=1e-9, abs=1e-300, nan_ok=True)


@pytest.mark.parametrize("correction", T_TESTS)
def test_t_tests_are_iraces(correction):
    for case in load("race_tests"):
        expected = case["ttest"][correction]
        costs = alive(case)
        means = costs.mean(axis=0)
        assert means == pytest.approx(np.array(expected["test_ranks"]), rel=1e-12, abs=1e-13)
        verdict = eliminate(costs, T_TESTS[correction], case["confidence"])
        if case["alive_before"][verdict.best] == expected["best"]:
            assert numbered(case, verdict.survivors) == expected["survivors"]
            assert verdict.p_value == pytest.approx(expected["p_value"], rel=1e-9, abs=1e-300)
        else:
            tied = case["alive_before"].index(expected["best"])
            assert means[tied] == pytest.approx(means[verdict.best], rel=1e-12)
        ranks, theirs = verdict.ranks, np.array(expected["race_ranks"])
        differ = np.abs(np.subtract.outer(means, means)) > 1e-12 * np.abs(means)
        ours_before = np.less.outer(ranks, ranks)[differ]
        assert (ours_before == np.less.outer(theirs, theirs)[differ]).all()


def test_few_cases_have_ties_that_r_breaks_by_rounding():
    """So that the leniency above does not hide anything else."""
    lenient = [
        case["id"]
        for case in load("race_tests")
        if eliminate(alive(case), "t-test", case["confidence"]).best
        != case["alive_before"].index(case["ttest"]["none"]["best"])
    ]
    assert lenient == [3]


def test_overall_ranks_are_iraces():
    cases = load("race_vectors")["overall_ranks"]
    assert len(cases) == 60
    for case in cases:
        assert overall_ranks(table(case["costs"]), "friedman").tolist() == case["friedman"]
        assert overall_ranks(table(case["costs"]), "t-test").tolist() == case["ttest"]


def test_concordance_is_iraces():
    cases = load("race_vectors")["table_columns"]
    assert len(cases) == 30
    for case in cases:
        found = concordance(table(case["costs"]))
        assert found.spearman == pytest.approx(case["spearman_rho"], abs=1e-12)
        assert found.kendall == pytest.approx(case["kendall_w"], abs=1e-12)
        assert found.variance == pytest.approx(case["qvar"], rel=1e-12)


def test_one_row_has_no_concordance_and_equal_costs_have_all():
    assert all(map(math.isnan, concordance(np.array([[1.0, 2.0]]))))
    assert concordance(np.ones((3, 2))).kendall == 1.0


@pytest.mark.parametrize("n", [3, 10, 49, 50, 80])
def test_wilcoxon_is_scipys(n):
    """An oracle of its own for more instances than the measured cases have."""
    from scipy.stats import wilcoxon

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
