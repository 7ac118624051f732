import pytest

from mercator_design.errors import RaceError
from mercator_design.race.elimination.budget import n_iterations
from mercator_design.race.elimination.options import RaceOptions
from mercator_design.race.elimination.planning import Planner
from mercator_design.race.irace.parameters import parse_space
from mercator_design.race.methods.iterated import IteratedRace

NUMBERS = parse_space("".join(f'x{k} "" r (-5, 5)\n' for k in range(4)))
IRACE = RaceOptions()


@pytest.mark.parametrize(
    ("n_variable", "least"),
    [(1, 42), (2, 96), (5, 180), (11, 300), (20, 504), (45, 728), (100, 1008), (149, 1350)],
)
def test_from_iraces_least_budget_on_the_plan_is_iraces(n_variable, least):
    enough = Planner(IRACE, n_variable, least)
    assert (enough.n_iterations, enough.max_configurations, enough.note) == (n_iterations(n_variable), None, None)
    fewer = Planner(IRACE, n_variable, least - 1)
    assert fewer.n_iterations < enough.n_iterations
    assert fewer.survivors == enough.survivors
    assert fewer.max_configurations == 2 * enough.survivors
    assert f"{least} experiments would allow all {enough.n_iterations}" in str(fewer.note)


def test_a_budget_for_no_iteration_is_refused_with_the_one_that_would_do():
    assert Planner(IRACE, 149, 60).n_iterations == 1
    with pytest.raises(RaceError, match=r"expected at least 60 experiments for 149 parameters \(1350 .*\), found 59"):
        Planner(IRACE, 149, 59)


@pytest.mark.parametrize(("iterations", "goes_on"), [(None, True), (4, False)])
def test_the_note_of_fewer_iterations_says_whether_more_may_follow(iterations, goes_on):
    """As irace does, a race goes on after the planned iterations unless the user says how many there are."""
    options = RaceOptions(iterations=iterations)
    race = IteratedRace(NUMBERS, budget=100, seed=1, options=options)
    (note,) = race.notes
    assert note.startswith(
        "a budget of 100 is planned for 2 instead of 4 iterations, with at most 8 configurations in "
    )
    assert (", and more follow while budget is left" in note) is goes_on
    while batch := race.ask():
        race.tell([(configuration - 3.0) ** 2 + 0.1 * instance for configuration, instance in batch])
    made = sum(not summary.postselection for summary in race.iterations)
    assert (made > 2) is goes_on
    assert made >= 2
