import pytest

from mercator_design.errors import RaceError
from mercator_design.race.budget import n_iterations, plan

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
