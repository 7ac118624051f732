"""Whole iterated races. All costs are functions of a seed, so no test fails by luck."""

import doctest
import math
import random

import numpy as np
import pytest

import mercator_design.race
from mercator_design.errors import RaceError
from mercator_design.race import (
    EliminationRace,
    Experiment,
    IteratedRace,
    RaceOptions,
    RaceRules,
    Space,
    categorical,
    integer,
    real,
)
from mercator_design.race.elimination.budget import minimum_budget, n_iterations
from mercator_design.race.methods import iterated
from mercator_design.race.proposals.model import SamplingModel
from mercator_design.race.space.parameter import key_of
from tests.race.mixed import MIXED, mixed_cost, noise, run
from tests.race.spaces import machines
from tests.tiers import some


def test_it_finds_nearly_the_optimum():
    """Of random configurations half cost more than 9.6, and one in a hundred less than 1.7.

    irace's model never draws the last size, 10. With 5, the least cost is 0.69.
    """
    race = IteratedRace(MIXED, budget=1500, seed=1)
    run(race)
    found = race.configurations[race.best.configuration]
    first = [mixed_cost(c) for c, parent in zip(race.configurations, race.parents, strict=True) if parent is None]
    assert (found["rule"], found["size"]) == ("fast", "5")
    assert mixed_cost(found) < 0.9
    assert mixed_cost(found) < min(first)
    assert race.stop_reason is not None


@pytest.mark.parametrize("test", ["friedman", "t-test", "t-test-holm", "t-test-bonferroni"])
def test_it_improves_with_each_test(test):
    race = IteratedRace(MIXED, budget=600, seed=3, options=RaceOptions(test=test))
    run(race)
    assert mixed_cost(race.configurations[race.best.configuration]) < 1.2


@pytest.mark.parametrize(
    "options",
    [
        {"each_test": 5, "first_test": 5},
        {"each_test": 3, "first_test": 6, "elitist_new_instances": 2, "block_size": 2, "mu": 12},
        {"first_test": 1, "mu": 0},
        {"first_test": 1, "mu": 0, "test": "t-test"},
        {"first_test": 1, "mu": 0, "test": "t-test-holm", "elitist": False},
    ],
)
def test_new_instances_need_not_be_a_multiple_of_those_between_tests_and_one_may_be_enough(options):
    """As irace's own test of bug 10 has it, with eachTest = 5 and elitistNewInstances = 1."""
    race = IteratedRace(MIXED, budget=900, seed=2, options=RaceOptions(**options))
    run(race)
    assert 800 < race.used <= 900
    assert len(race.iterations) > 1
    best = mixed_cost(race.configurations[race.best.configuration])
    assert best < sorted(mixed_cost(c) for c in race.configurations)[len(race.configurations) // 2]


def test_a_race_that_would_exceed_the_budget_ends():
    """A case in which irace's rules alone would make three experiments too many."""
    generator = random.Random(805)
    space = Space([real(f"x{k}", 0, 1) for k in range(5)])
    options = RaceOptions(first_test=12, elitist_new_instances=5)
    race = IteratedRace(space, budget=255, seed=805, options=options)
    while batch := race.ask():
        race.tell([generator.gauss(0, 1) + 3 * sum(race.configurations[e.configuration].values()) for e in batch])
    assert 245 < race.used <= 255
    assert "the whole budget is used" in [s.stop_reason for s in race.iterations]


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


def test_old_instances_are_visited_in_a_new_order():
    race = IteratedRace(MIXED, budget=1000, seed=4)
    told = [experiment.instance for experiment, _ in run(race, cost=lambda _: 0.0)]
    n_old, start = race.iterations[0].n_instances, race.iterations[0].used
    second = list(dict.fromkeys(told[start : start + race.iterations[1].used]))
    assert second[0] == n_old
    old = second[1 : n_old + 1]
    assert sorted(old) == list(range(n_old))
    assert old != sorted(old)


@pytest.fixture
def recorded(monkeypatch):
    """A race that has run, and with what its races and its sampling model were called."""
    races, updates, restarts = [], [], []

    class RecordedRace(EliminationRace):
        def __init__(self, configurations, **options):
            races.append({"configurations": list(configurations), **options})
            super().__init__(configurations, **options)

    class RecordedModel(SamplingModel):
        def update(self, elites, parents, **numbers):
            updates.append({"elites": list(elites), **numbers})
            super().update(elites, parents, **numbers)

        def restart(self, elites, n_new):
            restarts.append((list(elites), n_new))
            super().restart(elites, n_new)

    monkeypatch.setattr(iterated, "EliminationRace", RecordedRace)
    monkeypatch.setattr(iterated, "SamplingModel", RecordedModel)
    space = Space([categorical("a", [1, 2, 3]), categorical("b", [1, 2]), integer("n", 1, 9)])
    race = IteratedRace(space, budget=311, seed=2)
    run(race, cost=lambda c: 0.3 * int(c["a"]) + 0.1 * c["n"])
    return race, races, updates, restarts


def test_races_and_models_get_the_numbers_of_their_iteration(recorded):
    race, races, updates, _ = recorded
    used, seen = 0, 0
    regular = [s for s in race.iterations if not s.postselection]
    assert len(regular) > 2
    for given, summary in zip(races, race.iterations, strict=True):
        assert given["max_experiments"] == 311 - used
        assert len(given["configurations"]) == summary.n_configurations
        if summary.postselection:
            assert given["planned_budget"] == given["max_experiments"]
            assert given["survivors"] == 1
            assert (given["rules"].first_test, given["rules"].elitist_limit) == (seen, 0)
        else:
            assert (given["planned_budget"], given["survivors"]) == (summary.budget, 3)
            assert given["rules"] == RaceRules()
            seen = max(seen, given["next_instance"], summary.n_instances)
        used += summary.used
    assert race.iterations[-1].postselection
    for update, before, summary in zip(updates, regular, regular[1:], strict=False):
        elites = [elite.configuration for elite in before.elites]
        assert update == {
            "elites": elites,
            "n_new": summary.n_configurations - len(elites),
            "iteration": summary.iteration,
            "iterations": max(3, summary.iteration),
        }
        assert summary.n_new == update["n_new"]
    assert len(updates) == len(regular) - 1


def test_a_soft_restart_widens_the_models_of_elites(recorded):
    race, _, updates, restarts = recorded
    restarted = [s for s in race.iterations if s.soft_restart]
    assert len(restarted) == len(restarts) > 0
    for summary, (elites, n_new) in zip(restarted, restarts, strict=True):
        assert n_new == summary.n_new
        assert set(elites) <= set(updates[summary.iteration - 2]["elites"])


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
        IteratedRace(MIXED, budget=311, seed=1, options=RaceOptions(postselection=wanted)) for wanted in (True, False)
    )
    run(with_it)
    run(without)
    assert with_it.iterations[-1].postselection
    assert with_it.iterations[:-1] == without.iterations
    assert without.used < with_it.used <= 311


@pytest.mark.parametrize(("share", "kept"), [(0.05, 25), (0.2, 100)])
def test_a_share_of_the_budget_is_kept_for_a_postselection(share, kept):
    """Also of a budget that is extended."""
    race = IteratedRace(MIXED, budget=500, seed=1, options=RaceOptions(postselection=share))
    for budget, before in ((500, 0), (1000, 500)):
        if before:
            race.extend(budget)
        run(race)
        last = race.iterations[-1]
        assert last.postselection
        assert last.budget >= kept * budget // 500
        assert before < race.used - last.used <= budget - kept * budget // 500
        assert race.used <= budget


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


def test_equal_configurations_are_one_elite():
    space = Space([categorical("a", [1, 2, 3]), categorical("b", [1, 2])])
    race = IteratedRace(space, budget=300, seed=1)
    run(race, cost=lambda c: int(c["a"]))
    assert len({key_of(c) for c in race.configurations}) < len(race.configurations)
    for summary in race.iterations:
        keys = [key_of(race.configurations[e.configuration]) for e in summary.elites]
        assert len(keys) == len(set(keys))


def test_of_equal_configurations_the_better_ranked_one_stays():
    """A newcomer that equals the best elite has its costs, and comes after it."""
    space = Space([categorical("a", [1, 2, 3]), categorical("b", [1, 2])])
    race = IteratedRace(space, budget=300, seed=1)
    while batch := race.ask():
        configurations = [race.configurations[e.configuration] for e in batch]
        race.tell([int(c["a"]) + 0.5 * int(c["b"]) for c in configurations])
    equal = [n for n, c in enumerate(race.configurations) if c == {"a": "1", "b": "1"}]
    assert len(equal) > 1
    assert race.best.configuration == equal[0]


def test_initial_configurations_race_first():
    best = {"x": 2.0, "n": 30, "size": "10", "rule": "fast", "rate": 0.25}
    race = IteratedRace(MIXED, budget=400, seed=1, initial=[best])
    assert race.ask()[0] == Experiment(0, 0)
    assert race.configurations[0] == best
    run(race)
    assert mixed_cost(race.configurations[race.best.configuration]) < 0.1


def test_too_many_initial_configurations_are_noted():
    initial = [{"x": k / 100, "n": 30, "size": "10", "rule": "slow"} for k in range(100)]
    race = IteratedRace(MIXED, budget=200, seed=1, initial=initial)
    batch = race.ask()
    assert race.configurations == initial[: len(batch)]
    assert race.notes == [f"only {len(batch)} of 100 initial configurations fit in the first iteration"]


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


def test_iterations_and_survivors_may_be_chosen():
    race = IteratedRace(MIXED, budget=600, seed=1, options=RaceOptions(iterations=3, survivors=2, postselection=False))
    run(race)
    assert len(race.iterations) == 3
    assert race.stop_reason == "all 3 iterations are done"
    assert max(len(s.elites) for s in race.iterations) == 2


@pytest.mark.swept
@pytest.mark.parametrize("d", some([1, 5, 45], 3))
@pytest.mark.parametrize("kind", ["noise", "flat", "sloping"])
def test_no_budget_is_exceeded(d, kind):
    space = Space([real(f"x{k}", 0, 1) for k in range(d)])
    costs = {"noise": lambda _: 0.0, "sloping": lambda c: 10 * sum(c.values()), "flat": lambda _: 0.0}
    started = 0
    for budget in (20, 43, 77, 100, 181, 400):
        for first_test, elitist in ((5, True), (5, False), (8, True), (2, True))[: 2 if budget > 100 else 4]:
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
    assert started >= 6


@pytest.mark.parametrize(("budget", "iterations"), [(60, 1), (100, 1), (1000, 7), (1350, 9)])
def test_a_budget_that_is_too_small_for_all_iterations_is_reported(budget, iterations):
    """irace refuses fewer than 1350 experiments for 149 parameters."""
    race = IteratedRace(machines(), budget=budget, seed=1)
    assert race.progress.iterations == iterations
    assert len(race.notes) == (iterations < 9)


@pytest.mark.parametrize("budget", [60, 100, 1000])
def test_a_large_grammar_is_raced_with_a_small_budget(budget):
    space = machines()
    race = IteratedRace(space, budget=budget, seed=1)
    run(race, cost=lambda c: abs(c["NumStates"] - 3) + (c["S0"] != "2"))
    assert race.used <= budget
    assert race.used > 0.95 * budget
    for configuration in race.configurations:
        space.check(configuration)


def test_the_example_of_the_package_runs():
    failed, attempted = doctest.testmod(mercator_design.race)
    assert failed == 0
    assert attempted >= 5


def test_each_iteration_races_as_many_configurations_as_is_asked():
    options = RaceOptions(n_configurations=9, postselection=False)
    race = IteratedRace(MIXED, budget=1000, seed=3, options=options)
    run(race)
    assert {summary.n_configurations for summary in race.iterations} == {9}
    free = IteratedRace(MIXED, budget=1000, seed=3)
    run(free)
    assert free.iterations[0].n_configurations > 9


def test_an_iteration_too_small_for_the_configurations_asked_for_is_left_out():
    """A quarter of 1000 experiments is too little for 60 configurations, a larger share of them is not."""
    options = RaceOptions(n_configurations=60, postselection=False)
    race = IteratedRace(MIXED, budget=1000, seed=3, options=options)
    run(race)
    assert race.iterations[0].iteration > 1
    assert race.iterations[0].n_configurations == 60
    assert race.stop_reason == "the budget left is too small to race 60 configurations"


def test_iterations_have_the_budget_asked_for():
    options = RaceOptions(experiments_per_iteration=150, postselection=False)
    race = IteratedRace(MIXED, budget=500, seed=3, options=options)
    run(race)
    used = [summary.used for summary in race.iterations]
    left = [500 - sum(used[:number]) for number in range(len(used))]
    assert [summary.budget for summary in race.iterations] == [min(150, of_left) for of_left in left]
    assert len(used) > 2


def test_blocks_of_instances_are_raced_on_together_and_in_their_order():
    options = RaceOptions(block_size=3, first_test=2, mu=6, postselection=False)
    race = IteratedRace(MIXED, budget=1500, seed=4, options=options)
    told = run(race)
    seen, later = 0, 0
    for summary in race.iterations:
        experiments, told = told[: summary.used], told[summary.used :]
        instances = list(dict.fromkeys(experiment.instance for experiment, _ in experiments))
        blocks = [instances[k : k + 3] for k in range(0, len(instances), 3)]
        assert [[i % 3 for i in block] for block in blocks] == [[0, 1, 2]] * len(blocks)
        assert all(block[2] == block[0] + 2 for block in blocks)
        if seen:
            assert blocks[0] == [seen, seen + 1, seen + 2]  # one new block
            later += blocks[1:] != sorted(blocks[1:])
        assert summary.n_instances % 3 == 0
        assert summary.n_instances >= 6
        seen = max(seen, *(i + 1 for i in instances))
    assert later > 0
    assert len(race.iterations) > 2


def test_instances_that_come_to_an_end():
    """Nothing runs on others, or on one twice; and with all of them seen, newcomers still race."""
    race = IteratedRace(MIXED, budget=700, seed=2, options=RaceOptions(instances=8))
    told = run(race)
    assert {e.instance for e, _ in told} == set(range(8))
    assert len({e for e, _ in told}) == len(told)
    assert 600 < race.used <= 700
    assert race.best.n_results == 8
    assert mixed_cost(race.configurations[race.best.configuration]) < 1.7
    ended = [summary.stop_reason for summary in race.iterations]
    assert "all instances were used" in ended
    first_with_all = next(k for k, summary in enumerate(race.iterations) if summary.n_instances == 8)
    assert any(summary.n_new for summary in race.iterations[first_with_all + 1 :])


def test_few_instances_for_many_experiments():
    """Down to as many as the first test needs, and with blocks."""
    for options in (RaceOptions(first_test=2, instances=2), RaceOptions(first_test=2, instances=6, block_size=3, mu=6)):
        race = IteratedRace(MIXED, budget=500, seed=3, options=options)
        told = run(race)
        assert {e.instance for e, _ in told} == set(range(options.instances))


def test_old_instances_in_their_own_order():
    options = RaceOptions(sample_instances=False, postselection=False)
    race = IteratedRace(MIXED, budget=600, seed=1, options=options)
    told = run(race)
    for summary in race.iterations:
        experiments, told = [e for e, _ in told[: summary.used]], told[summary.used :]
        seen = list(dict.fromkeys(e.instance for e in experiments))
        if summary.iteration > 1:
            assert seen[0] == max(seen[: seen.index(0)])
            assert sorted(seen[1:]) == seen[1:]


def test_minimum_budgets_are_irace_s():
    """As its checkMinimumBudget says."""
    expected = {1: 42, 2: 96, 3: 96, 5: 180, 7: 180, 11: 300, 20: 504, 45: 728, 100: 1008, 133: 1350}
    assert {d: RaceOptions().minimum_budget(d) for d in expected} == expected
