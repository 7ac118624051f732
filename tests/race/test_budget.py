import pytest

from mercator_design.errors import RaceError
from mercator_design.race.budget import iteration_budget, minimum_budget, n_configurations, n_iterations, plan
from tests.race.reference import load


def test_arithmetic_is_iraces():
    cases = load("race_vectors")["arithmetic"]
    assert len(cases) == 480
    for case in cases:
        mu, block = case["mu"], case["blockSize"]
        each_test, n_new = case["eachTest"] * block, case["elitistNewInstances"] * block
        n = n_iterations(case["n_variable_parameters"])
        assert n == case["nb_iterations"] == case["min_survival"]
        for elitist in (True, False):
            needed = minimum_budget(n, n, mu=mu, each_test=each_test, n_new=n_new, elitist=elitist)
            assert needed == case["minimum_budget_elitist" if elitist else "minimum_budget_nonelitist"]
        remaining = case["budget"]
        for step in case["schedule"]:
            i = step["iteration"]
            budget = iteration_budget(remaining, i, n)
            remaining -= budget
            assert budget == step["current_budget"]
            alone = n_configurations(budget, i, mu=mu, each_test=each_test)
            assert alone == step["nb_configurations_first_or_nonelitist"]
            if i > 1:
                n_old = mu + (i - 2) * n_new
                with_elites = n_configurations(
                    budget, i, mu=mu, each_test=each_test, n_elites=n, n_old=n_old, n_new=n_new
                )
                assert with_elites == step["nb_configurations_elitist"]


def test_numbers_of_configurations_are_iraces():
    cases = load("race_vectors")["nb_configurations"]
    assert len(cases) == 300
    for case in cases:
        found = n_configurations(
            case["currentBudget"],
            case["indexIteration"],
            mu=case["mu"],
            each_test=case["eachTest"] * case["blockSize"],
            n_elites=case["nElites"],
            n_old=case["nOldInstances"],
            n_new=case["newInstances"],
        )
        assert found == case["result"]


DEFAULTS = {"mu": 5, "each_test": 1, "n_new": 1, "elitist": True}


@pytest.mark.parametrize(
    ("n_variable", "least"),
    [(1, 42), (2, 96), (5, 180), (11, 300), (20, 504), (45, 728), (100, 1008), (149, 1350)],
)
def test_from_iraces_least_budget_on_the_plan_is_iraces(n_variable, least):
    enough = plan(least, n_variable=n_variable, **DEFAULTS)
    assert (enough.iterations, enough.configurations, enough.note) == (n_iterations(n_variable), None, None)
    fewer = plan(least - 1, n_variable=n_variable, **DEFAULTS)
    assert fewer.iterations < enough.iterations
    assert fewer.survivors == enough.survivors
    assert fewer.configurations == 2 * enough.survivors
    assert f"{least} experiments would allow all" in str(fewer.note)


def test_a_budget_for_no_iteration_is_refused_with_the_one_that_would_do():
    assert plan(60, n_variable=149, **DEFAULTS).iterations == 1
    with pytest.raises(RaceError, match=r"expected at least 60 experiments for 149 parameters \(1350 .*\), found 59"):
        plan(59, n_variable=149, **DEFAULTS)
