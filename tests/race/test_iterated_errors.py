"""What an iterated race refuses."""

import math

import pytest

from mercator_design.errors import RaceError
from mercator_design.race import IteratedRace, RaceOptions, Space, categorical, ordered
from tests.race.mixed import MIXED, run
from tests.race.spaces import machines


def test_a_space_with_one_allowed_configuration_is_refused():
    race = IteratedRace(Space([categorical("a", [1, 2])], forbidden=["a == 2"]), budget=60, seed=1)
    with pytest.raises(RaceError, match="expected several different configurations to be allowed, found one"):
        race.ask()


@pytest.mark.parametrize(
    ("initial", "message"),
    [
        ([{"x": 9.0}], "initial configuration 1: parameter 'x': expected real within"),
        (
            [{"x": 1.0, "n": 3, "size": "1", "rule": "slow"}] * 2,
            "initial configuration 2: expected a new one",
        ),
    ],
)
def test_a_wrong_initial_configuration_is_refused(initial, message):
    with pytest.raises(RaceError, match=message):
        IteratedRace(MIXED, budget=400, seed=1, initial=initial)


def test_it_is_an_error_if_all_are_rejected():
    race = IteratedRace(MIXED, budget=400, seed=1)
    batch = race.ask()
    with pytest.raises(RaceError, match="all were rejected"):
        race.tell([math.inf] * len(batch))
    assert race.progress.best is None
    for _ in range(2):  # which is not an end
        with pytest.raises(RaceError, match="all were rejected"):
            race.ask()


def test_a_cost_that_is_not_a_number_changes_nothing():
    race = IteratedRace(MIXED, budget=400, seed=1)
    batch = race.ask()
    with pytest.raises(RaceError, match="cost of configuration 3 on instance 0: expected a number, found nan"):
        race.tell([1.0] * 3 + [math.nan] * (len(batch) - 3))
    with pytest.raises(RaceError, match=f"expected {len(batch)}, one for each experiment asked for, found 2"):
        race.tell([1.0, 2.0])
    assert race.ask() == batch
    run(race)
    plain = IteratedRace(MIXED, budget=400, seed=1)
    run(plain)
    assert race.elites == plain.elites


def test_costs_without_experiments_are_refused():
    race = IteratedRace(MIXED, budget=400, seed=1)
    with pytest.raises(RaceError, match="tell: expected `ask` to be called before"):
        race.tell([1.0])
    with pytest.raises(RaceError, match="best: expected an iteration that has ended"):
        _ = race.best


@pytest.mark.parametrize("budget", [0, -5, 12.5, 500.0, math.nan, "500", True, None])
def test_a_budget_is_a_whole_number(budget):
    with pytest.raises(RaceError, match="budget: expected a whole number, 1 or more, found"):
        IteratedRace(MIXED, budget=budget, seed=1)


@pytest.mark.parametrize("seed", [-1, 0.5, None])
def test_a_seed_is_a_whole_number(seed):
    with pytest.raises(RaceError, match="seed: expected a whole number, 0 or more, found"):
        IteratedRace(MIXED, budget=400, seed=seed)


def test_a_space_without_choice_is_refused():
    with pytest.raises(RaceError, match="expected at least one parameter with more than one value"):
        IteratedRace(Space([categorical("a", [1])]), budget=400, seed=1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"test": "F-test"}, "race option test: expected friedman or t-test .* found F-test"),
        ({"confidence": 1.0}, "confidence: expected between 0 and 1, found 1.0"),
        ({"confidence": math.nan}, "confidence"),
        ({"first_test": 0}, "first_test: expected 1 or more and a multiple of each_test"),
        (
            {"first_test": 5, "each_test": 2},
            "first_test: expected 1 or more and a multiple of each_test .2., found 5",
        ),
        ({"first_test": 5.0}, "first_test: expected a whole number, found 5.0"),
        ({"survivors": 2.5}, "survivors: expected a whole number, found 2.5"),
        ({"mu": None}, "mu: expected a whole number, found None"),
        ({"each_test": 0}, "each_test: expected 1 or more"),
        ({"elitist_new_instances": -1}, "elitist_new_instances: expected 0 or more"),
        ({"elitist_limit": -1}, "elitist_limit: expected 0 or more"),
        ({"iterations": 0}, "iterations: expected 1 or more"),
        ({"survivors": 0}, "survivors: expected 1 or more"),
        ({"mu": -1}, "mu: expected 0 or more"),
        ({"mu": 16, "block_size": 3}, "mu: expected 0 or more and a multiple of block_size .3., found 16"),
        ({"block_size": 0}, "block_size: expected 1 or more"),
        ({"n_configurations": 0}, "n_configurations: expected 1 or more"),
        ({"experiments_per_iteration": 0}, "experiments_per_iteration: expected 1 or more"),
        (
            {"instances": 4},
            "instances: expected 5 or more, for the first test, found 4; add instances, or set first_test",
        ),
        ({"instances": 14, "block_size": 3, "mu": 6}, "a multiple of block_size .3., found 14"),
        ({"instances": 10, "elitist": False}, "instances: expected none if elitist is off, found 10"),
        ({"soft_restart_threshold": -1.0}, "soft_restart_threshold: expected 0 or more"),
    ],
)
def test_an_option_out_of_range_is_refused(options, message):
    with pytest.raises(RaceError, match=message):
        RaceOptions(**options)


def test_a_budget_below_one_iteration_is_refused():
    with pytest.raises(RaceError, match=r"expected at least 60 experiments .* found 59"):
        IteratedRace(machines(), budget=59, seed=1)


def test_fewer_configurations_than_survive_are_refused():
    with pytest.raises(RaceError, match=r"n_configurations: expected more than the 4 survivors .*, found 4"):
        IteratedRace(MIXED, budget=400, seed=1, options=RaceOptions(n_configurations=4))


@pytest.mark.parametrize("options", [{"n_configurations": 90}, {"experiments_per_iteration": 8}])
def test_a_budget_for_no_first_iteration_is_refused(options):
    with pytest.raises(RaceError, match="expected a budget for a first iteration, but the budget left is too small"):
        IteratedRace(MIXED, budget=400, seed=1, options=RaceOptions(**options))


def test_a_space_of_which_too_little_is_left_ends_a_race_with_a_winner():
    """The first race rejects all but one of six configurations, late; the model of that one does not draw others."""
    space = Space([categorical("a", [1, 2, 3]), ordered("b", [1, 2])])
    race = IteratedRace(space, budget=300, seed=1)
    while batch := race.ask():
        kept = [race.configurations[e.configuration] == {"a": "1", "b": "2"} for e in batch]
        race.tell([1.0 if is_kept or e.instance < 4 else math.inf for e, is_kept in zip(batch, kept, strict=True)])
    assert race.configurations[race.best.configuration] == {"a": "1", "b": "2"}
    assert race.stop_reason == "too few configurations were found that are neither forbidden nor rejected"
    assert [one.iteration for one in race.iterations] == list(range(1, len(race.iterations) + 1))
