"""Whole iterated races. All costs are functions of a seed, so no test fails by luck."""

import doctest
import math

import numpy as np
import pytest

import mercator_design.race
from mercator_design.errors import RaceError
from mercator_design.race import (
    Experiment,
    IteratedRace,
    RaceOptions,
    Space,
    categorical,
    integer,
    ordered,
    real,
)
from mercator_design.race.budget import minimum_budget, n_iterations
from tests.race.spaces import machines_text

MIXED = Space(
    [
        real("x", -5, 5),
        integer("n", 1, 1000, log=True),
        ordered("size", [1, 2, 5, 10]),
        categorical("rule", ["slow", "fast"]),
        real("rate", 0, 1, condition='rule == "fast"'),
    ]
)


def mixed_cost(configuration):
    """Least, 0, at x = 2, n = 30, size = 10, rule = fast, rate = 0.25."""
    return (
        (configuration["x"] - 2) ** 2 / 4
        + math.log(configuration["n"] / 30) ** 2
        + abs(math.log(int(configuration["size"]) / 10))
        + (2 if configuration["rule"] == "slow" else 4 * abs(configuration["rate"] - 0.25))
    )


def noise(seed, experiment):
    """Common to all on an instance, and each experiment's own."""
    common = np.random.default_rng([seed, experiment.instance]).normal()
    own = np.random.default_rng([seed, experiment.instance, experiment.configuration]).normal()
    return common + 0.3 * own


def run(race, cost=mixed_cost, seed=0):
    """Run to the end; all experiments with their costs."""
    told = []
    while batch := race.ask():
        assert race.used + len(batch) <= race.budget
        assert len({e.instance for e in batch}) == 1
        costs = [cost(race.configurations[e.configuration]) + noise(seed, e) for e in batch]
        race.tell(costs)
        told += zip(batch, costs, strict=True)
    return told


def test_it_finds_nearly_the_optimum():
    """Of random configurations half cost more than 9.6, and one in a hundred less than 1.7."""
    race = IteratedRace(MIXED, budget=1500, seed=1)
    run(race)
    found = race.configurations[race.best.configuration]
    first = [mixed_cost(c) for c, parent in zip(race.configurations, race.parents, strict=True) if parent is None]
    assert (found["rule"], found["size"]) == ("fast", "10")
    assert mixed_cost(found) < 0.5
    assert mixed_cost(found) < min(first)
    assert race.stop_reason is not None


@pytest.mark.parametrize("test", ["friedman", "t-test", "t-test-holm", "t-test-bonferroni"])
def test_it_improves_with_each_test(test):
    race = IteratedRace(MIXED, budget=600, seed=3, options=RaceOptions(test=test))
    run(race)
    assert mixed_cost(race.configurations[race.best.configuration]) < 0.7


def test_the_same_seed_gives_the_same_race_and_another_one_another():
    def history(seed):
        race = IteratedRace(MIXED, budget=400, seed=seed)
        return run(race), race.configurations, race.elites, race.iterations

    assert history(5) == history(5)
    assert history(5)[1] != history(6)[1]


def test_a_result_does_not_depend_on_when_it_is_asked_about():
    plain, watched = (IteratedRace(MIXED, budget=400, seed=2) for _ in range(2))
    run(plain)
    while batch := watched.ask():
        assert watched.ask() == batch
        assert watched.progress.used == watched.used
        watched.tell([mixed_cost(watched.configurations[e.configuration]) + noise(0, e) for e in batch])
    assert watched.elites == plain.elites


def test_what_it_tells_of_itself_is_what_was_told():
    race = IteratedRace(MIXED, budget=500, seed=4)
    told = run(race)
    assert len(told) == race.used == sum(s.used for s in race.iterations)
    assert len({experiment for experiment, _ in told}) == len(told)  # nothing is run twice
    assert [race.ask(), race.used <= 500] == [[], True]
    for elite in race.elites:
        costs = [cost for experiment, cost in told if experiment.configuration == elite.configuration]
        assert elite.n_results == len(costs)
        assert elite.mean == pytest.approx(np.mean(costs))
        assert elite.sd == pytest.approx(np.std(costs, ddof=1))
    assert race.costs(race.best.configuration) == {
        e.instance: c for e, c in told if e.configuration == race.best.configuration
    }
    assert race.progress.best == race.best == race.elites[0]
    done = len(race.iterations)
    assert (race.progress.iteration, race.progress.iterations) == (
        done,
        done - race.iterations[-1].postselection,
    )
    assert [s.iteration for s in race.iterations] == list(range(1, done + 1))
    assert race.iterations[-1].elites == tuple(race.elites)
    instances = list(dict.fromkeys(experiment.instance for experiment, _ in told))
    assert instances == list(range(len(instances)))
    for configuration in race.configurations:
        MIXED.check(configuration)


def test_later_races_are_elitist():
    """New instances first, then the old ones, on which the elites do not run again."""
    race = IteratedRace(MIXED, budget=1000, seed=4)
    told = [experiment for experiment, _ in run(race)]
    first, second = race.iterations[0], race.iterations[1]
    batches = told[first.used : first.used + second.used]
    elites = {elite.configuration for elite in first.elites}
    assert batches[0].instance == first.n_instances
    assert elites <= {e.configuration for e in batches if e.instance == first.n_instances}
    again = {e.configuration for e in batches if e.instance < first.n_instances}
    assert again
    assert not elites & again
    parents = {race.parents[number] for number in again}
    assert parents <= elites


def test_a_race_that_is_not_elitist_begins_afresh():
    race = IteratedRace(MIXED, budget=1000, seed=4, options=RaceOptions(elitist=False))
    told = [experiment for experiment, _ in run(race)]
    first, second = race.iterations[0], race.iterations[1]
    batches = told[first.used : first.used + second.used]
    assert min(e.instance for e in batches) == first.n_instances
    assert {e.configuration for e in first.elites} <= {e.configuration for e in batches}
    assert not any(s.postselection for s in race.iterations)


def test_what_is_left_is_spent_on_a_postselection():
    with_it, without = (
        IteratedRace(MIXED, budget=311, seed=8, options=RaceOptions(postselection=wanted)) for wanted in (True, False)
    )
    run(with_it)
    run(without)
    assert with_it.iterations[-1].postselection
    assert with_it.iterations[:-1] == without.iterations
    assert without.used < with_it.used <= 311


def test_a_narrow_model_is_restarted():
    """Two values cannot be told apart for long."""
    space = Space([categorical("a", [1, 2]), categorical("b", [1, 2])])
    race = IteratedRace(space, budget=300, seed=1)
    run(race, cost=lambda c: 0.1 * int(c["a"]))
    assert any(s.soft_restart for s in race.iterations)
    plain = IteratedRace(space, budget=300, seed=1, options=RaceOptions(soft_restart=False))
    run(plain, cost=lambda c: 0.1 * int(c["a"]))
    assert not any(s.soft_restart for s in plain.iterations)


def test_a_space_of_two_configurations_is_raced():
    race = IteratedRace(Space([categorical("a", [1, 2])]), budget=60, seed=1)
    run(race, cost=lambda c: int(c["a"]))
    assert race.configurations[race.best.configuration] == {"a": "1"}
    assert "only 2 different configurations were found, so races end with 1" in race.notes


def test_a_space_with_one_allowed_configuration_is_refused():
    race = IteratedRace(Space([categorical("a", [1, 2])], forbidden=["a == 2"]), budget=60, seed=1)
    with pytest.raises(RaceError, match="expected several different configurations to be allowed, found one"):
        race.ask()


def test_equal_configurations_are_one_elite():
    space = Space([categorical("a", [1, 2, 3]), categorical("b", [1, 2])])
    race = IteratedRace(space, budget=300, seed=1)
    run(race, cost=lambda c: int(c["a"]))
    keys = [space.key(race.configurations[e.configuration]) for e in race.elites]
    assert len(keys) == len(set(keys))


def test_initial_configurations_race_first():
    best = {"x": 2.0, "n": 30, "size": "10", "rule": "fast", "rate": 0.25}
    race = IteratedRace(MIXED, budget=400, seed=1, initial=[best])
    assert race.ask()[0] == Experiment(0, 0)
    assert race.configurations[0] == best
    run(race)
    assert mixed_cost(race.configurations[race.best.configuration]) < 0.05


def test_too_many_initial_configurations_are_noted():
    initial = [{"x": k / 100, "n": 30, "size": "10", "rule": "slow"} for k in range(100)]
    race = IteratedRace(MIXED, budget=200, seed=1, initial=initial)
    batch = race.ask()
    assert race.configurations == initial[: len(batch)]
    assert race.notes == [f"only {len(batch)} of 100 initial configurations fit in the first iteration"]


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


def test_a_rejected_configuration_is_never_sampled_again():
    space = Space([categorical("a", range(4)), categorical("b", range(3))])
    race = IteratedRace(space, budget=300, seed=1)
    rejected = []
    while batch := race.ask():
        bad = [race.configurations[e.configuration] == {"a": "2", "b": "1"} for e in batch]
        rejected += [e.configuration for e, is_bad in zip(batch, bad, strict=True) if is_bad]
        race.tell([math.inf if is_bad else noise(1, e) for e, is_bad in zip(batch, bad, strict=True)])
    assert len(rejected) == 1
    assert not {e.configuration for e in race.elites} & set(rejected)


def test_it_is_an_error_if_all_are_rejected():
    race = IteratedRace(MIXED, budget=400, seed=1)
    batch = race.ask()
    with pytest.raises(RaceError, match="all were rejected"):
        race.tell([math.inf] * len(batch))


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
    with pytest.raises(RaceError, match="found none asked for"):
        race.tell([1.0])
    with pytest.raises(RaceError, match="best is asked for"):
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
        ({"first_test": 1}, "first_test: expected 2 or more and a multiple of each_test"),
        (
            {"first_test": 5, "each_test": 2},
            "first_test: expected 2 or more and a multiple of each_test .2., found 5",
        ),
        ({"each_test": 0}, "each_test: expected 1 or more"),
        (
            {"first_test": 6, "each_test": 2},
            "elitist_new_instances: expected 0 or a multiple of each_test .2., found 1",
        ),
        ({"elitist_limit": -1}, "elitist_limit: expected 0 or more"),
        ({"iterations": 0}, "iterations: expected 1 or more"),
        ({"survivors": 0}, "survivors: expected 1 or more"),
        ({"mu": 0}, "mu: expected 1 or more"),
        ({"soft_restart_threshold": -1.0}, "soft_restart_threshold: expected 0 or more"),
    ],
)
def test_an_option_out_of_range_is_refused(options, message):
    with pytest.raises(RaceError, match=message):
        RaceOptions(**options)


def test_iterations_and_survivors_may_be_chosen():
    race = IteratedRace(MIXED, budget=600, seed=1, options=RaceOptions(iterations=3, survivors=2, postselection=False))
    run(race)
    assert len(race.iterations) == 3
    assert race.stop_reason == "all 3 iterations are done"
    assert max(len(s.elites) for s in race.iterations) == 2


@pytest.mark.parametrize("d", [1, 2, 5, 11, 45])
@pytest.mark.parametrize("kind", ["noise", "flat", "sloping"])
def test_no_budget_is_exceeded(d, kind):
    space = Space([real(f"x{k}", 0, 1) for k in range(d)])
    costs = {"noise": lambda _: 0.0, "sloping": lambda c: 10 * sum(c.values()), "flat": lambda _: 0.0}
    started = 0
    for budget in (20, 43, 77, 100, 181, 250, 400):
        for first_test, elitist in ((5, True), (8, True), (2, True), (5, False)):
            options = RaceOptions(first_test=first_test, elitist=elitist)
            mu = options.planned_mu
            least = minimum_budget(1, n_iterations(d), mu=mu, each_test=1, n_new=1, elitist=elitist)
            if budget < least:
                with pytest.raises(RaceError, match=f"budget: expected at least {least} experiments"):
                    IteratedRace(space, budget=budget, seed=1, options=options)
                continue
            race = IteratedRace(space, budget=budget, seed=budget, options=options)
            started += 1
            while batch := race.ask():
                assert race.used + len(batch) <= budget
                own = [noise(0, e) if kind != "flat" else 0.0 for e in batch]
                race.tell(
                    [costs[kind](race.configurations[e.configuration]) + o for e, o in zip(batch, own, strict=True)]
                )
            assert race.elites
            assert race.used <= budget
    assert started >= 8


@pytest.mark.parametrize(("budget", "iterations"), [(60, 1), (200, 2), (1000, 7), (1350, 9)])
def test_a_large_grammar_is_raced_with_a_small_budget(budget, iterations):
    """irace refuses fewer than 1350 experiments for 149 parameters."""
    space = Space.from_text(machines_text())
    race = IteratedRace(space, budget=budget, seed=1)
    assert race.progress.iterations == iterations
    assert len(race.notes) == (iterations < 9)
    run(race, cost=lambda c: abs(c["NumStates"] - 3) + (c["S0"] != "2"))
    assert race.used <= budget
    assert race.used > 0.95 * budget
    for configuration in race.configurations:
        space.check(configuration)


def test_a_budget_below_one_iteration_is_refused():
    with pytest.raises(RaceError, match=r"expected at least 60 experiments .* found 59"):
        IteratedRace(Space.from_text(machines_text()), budget=59, seed=1)


def test_the_example_of_the_package_runs():
    failed, attempted = doctest.testmod(mercator_design.race)
    assert failed == 0
    assert attempted >= 5
