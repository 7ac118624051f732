"""What holds of every method of a race: one class of tests for all, and what some of them do besides."""

import math
import re
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from mercator_design.cli.races.race import race as command
from mercator_design.errors import RaceError
from mercator_design.race import Experiment, Halving, Space, categorical, integer, ordered, real
from mercator_design.race.executors.processes import ProcessExecutor
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.methods.optuna_sampler import OptunaSampler
from mercator_design.race.methods.table import METHODS
from mercator_design.race.session.journal import Journal
from mercator_design.race.session.record import Record
from mercator_design.race.space.parameter import key_of
from tests.race.mixed import MIXED, mixed_cost, noise, run
from tests.race.racing import SPACE, measure, runner
from tests.race.spaces import machines
from tests.tiers import some


def race_of(method, space=MIXED, budget=300, seed=1):
    return METHODS[method](space, budget=budget, seed=seed)


def recorded(method, executor, *, budgets=(140,), record=None, seed=1, **options):
    """A race of it, run with an executor and noted."""
    record = Record() if record is None else record
    with executor as running:
        one = runner(record, running, race=race_of(method, SPACE, budgets[0], seed), seed=seed, **options)
        known = record.record.budgets
        known += budgets[1:][len(known) - 1 :]
        one.finish()
    return record.record


@pytest.fixture(scope="module")
def processes():
    with ProcessExecutor(2) as executor:
        yield executor


def reject_all(race):
    while batch := race.ask():
        race.tell([math.inf] * len(batch))


def run_in(record):
    """What has run, asked for or not."""
    return {*record.speculative, *((one.configuration, one.instance) for one in record.experiments.values())}


def test_the_command_line_has_them_all():
    (choices,) = (p.type.choices for p in command.params if p.name == "method")
    assert list(choices) == list(METHODS)


@pytest.mark.swept
@pytest.mark.parametrize("method", some(METHODS, 4))
class TestConformance:
    def test_the_whole_budget_is_used_and_never_more_and_it_finds_something_good(self, method):
        """Random configurations cost 5.6 in the mean; a tenth of them less than 1.7."""
        for budget in (90, 311, 500):
            race = race_of(method, budget=budget)
            told = run(race)  # checks each batch
            assert race.used == len(told) <= budget
            assert race.used > 0.95 * budget
            assert sum(iteration.used for iteration in race.iterations) == race.used
            assert len({e for e, _ in told}) == len(told)  # nothing runs twice
        assert mixed_cost(race.configurations[race.best.configuration]) < 1.7

    def test_same_seed_same_race(self, method):
        told = [run(race_of(method, budget=150, seed=seed)) for seed in (1, 1, 2)]
        assert told[0] == told[1] != told[2]

    def test_configurations_are_valid_and_have_parents(self, method):
        race = race_of(method, machines(), budget=150)
        run(race, cost=len)
        for configuration in race.configurations:
            race.space.check(configuration)
        assert len(race.parents) == len(race.configurations)
        assert all(parent is None or parent < number for number, parent in enumerate(race.parents))

    def test_what_it_tells_of_itself(self, method):
        race = race_of(method)
        with pytest.raises(RaceError, match="expected an iteration that has ended"):
            _ = race.best
        assert (race.used, race.iteration, race.elites, race.stop_reason) == (0, 0, [], None)
        told, iterations = [], []
        while batch := race.ask():
            assert race.ask() == batch
            before = race.progress
            assert (before.iteration, before.used, before.budget) == (race.iteration, len(told), 300)
            assert before.alive >= 1
            iterations.append(before.iteration)
            costs = [mixed_cost(race.configurations[e.configuration]) + noise(0, e) for e in batch]
            told += zip(batch, costs, strict=True)
            race.tell(costs)
        assert iterations == sorted(iterations)
        assert sorted({*iterations}) == [summary.iteration for summary in race.iterations]
        assert race.stop_reason
        assert race.best == race.elites[0] == race.iterations[-1].elites[0] == race.progress.best
        own = {e.instance: cost for e, cost in told if e.configuration == race.best.configuration}
        assert race.costs(race.best.configuration) == own
        assert race.best.n_results == len(own)
        assert race.best.mean == pytest.approx(sum(own.values()) / len(own))

    def test_lookahead_predicts_experiments(self, method):
        race, predicted, hits = race_of(method), set(), 0
        while batch := race.ask():
            likely = race.lookahead(20)
            assert len(likely) <= 20
            assert not {*likely} & {*batch}
            hits += len(predicted & {*batch})
            predicted |= {*likely}
            race.tell([mixed_cost(race.configurations[e.configuration]) + noise(0, e) for e in batch])
        assert hits > 0.2 * race.used
        assert race.lookahead(20) == []

    @pytest.mark.together
    def test_any_executor_gives_the_same(self, method, processes):
        executors = ThreadExecutor(1), ThreadExecutor(5), nullcontext(processes)
        assert len({recorded(method, executor).digest() for executor in executors}) == 1

    def test_a_race_that_was_killed_is_resumed(self, method, tmp_path):
        """At any byte; no finished experiment is run again."""
        whole = tmp_path / "whole.jsonl"
        with Journal(whole, new=True) as journal:
            expected = recorded(method, ThreadExecutor(2), record=journal).digest()
        text = whole.read_bytes()
        for n in (len(text) // 7, len(text) // 2, len(text) - 300):
            cut = tmp_path / f"{n}.jsonl"
            cut.write_bytes(text[:n])
            anew = []

            def counted(item, anew=anew):
                anew.append(item)
                return measure(item)

            with Journal(cut, new=False) as journal:
                known = run_in(journal.record)
                assert len(known) > 5
                assert recorded(method, ThreadExecutor(1), record=journal, function=counted).digest() == expected
                assert len(anew) == len(run_in(journal.record) - known)

    def test_its_budget_can_be_extended(self, method):
        at_once = recorded(method, ThreadExecutor(1), budgets=(100, 180))
        later = recorded(method, ThreadExecutor(1), budgets=(100,))
        assert [end.budget for end in later.ends] == [100]
        recorded(method, ThreadExecutor(2), budgets=(100, 180), record=later)
        assert later.digest() == at_once.digest()
        assert [end.budget for end in later.ends] == [100, 180]
        assert 100 < later.ends[-1].experiments <= 180

    def test_an_extended_race_goes_on(self, method):
        race = race_of(method, budget=150)
        with pytest.raises(RaceError, match="expected the race to have ended"):
            race.extend(300)
        told = run(race)
        n = len(race.configurations)
        with pytest.raises(RaceError, match="budget: expected a whole number, 151 or more, found 150"):
            race.extend(150)
        race.extend(300)
        assert race.stop_reason is None
        told += run(race)
        assert 280 < race.used <= 300
        assert len(race.configurations) > n
        assert len({e for e, _ in told}) == len(told)

    def test_what_is_rejected_is_not_run_again_and_does_not_win(self, method):
        race = race_of(method, budget=200)
        rejected = {}
        while batch := race.ask():
            assert not {e.configuration for e in batch} & rejected.keys()
            values = [race.configurations[e.configuration] for e in batch]
            costs = [math.inf if c["x"] > 0.5 else mixed_cost(c) for c in values]
            race.tell(costs)
            for experiment, c, cost in zip(batch, values, costs, strict=True):
                if math.isinf(cost):
                    assert key_of(c) not in rejected.values()
                    rejected[experiment.configuration] = key_of(c)
        assert rejected
        assert all(race.configurations[elite.configuration]["x"] <= 0.5 for elite in race.elites)

    def test_it_is_an_error_if_all_are_rejected(self, method):
        race = race_of(method)
        with pytest.raises(RaceError, match="all were rejected"):
            reject_all(race)
        assert race.used <= 60

    def test_forbidden_configurations_do_not_run(self, method):
        space = Space([real("x", 0, 1), integer("n", 1, 9)], forbidden=["n > 3 & x < 0.5"])
        race = race_of(method, space, budget=300)
        run(race, cost=lambda c: -c["n"] + c["x"])
        assert not any(c["n"] > 3 and c["x"] < 0.5 for c in race.configurations)
        assert race.configurations[race.best.configuration]["n"] == 9

    def test_a_small_space_is_raced_to_its_best(self, method):
        space = Space([ordered("a", range(1, 4)), integer("b", 0, 2)])
        race = race_of(method, space)
        run(race, cost=lambda c: abs(int(c["a"]) - 3) + abs(c["b"] - 1))
        assert race.configurations[race.best.configuration] == {"a": "3", "b": 1}
        assert race.used <= 300

    def test_bounds_that_depend_on_others(self, method):
        space = Space(
            [integer("n", 1, 20), integer("k", 0, "n"), real("w", "k", "n + 1"), real("v", 0, 1, condition="k > 5")]
        )
        race = race_of(method, space, budget=400)
        run(race, cost=lambda c: abs(c["n"] - 15) + abs(c["k"] - 10) + abs(c["w"] - 12) / 2)
        for configuration in race.configurations:
            space.check(configuration)
        best = race.configurations[race.best.configuration]
        assert abs(best["n"] - 15) + abs(best["k"] - 10) < 9

    def test_equal_costs(self, method):
        """Nothing can be told apart, and nothing goes wrong."""
        race = race_of(method)
        while batch := race.ask():
            race.tell([0.0] * len(batch))
        assert race.best.mean == 0

    def test_costs_that_are_none(self, method):
        race = race_of(method)
        with pytest.raises(RaceError, match="tell: expected `ask` to be called before"):
            race.tell([1.0])
        batch = race.ask()
        with pytest.raises(RaceError, match="expected a number, found nan"):
            race.tell([math.nan] * len(batch))
        with pytest.raises(RaceError, match=f"expected {len(batch)}, one for each"):
            race.tell([])
        assert race.ask() == batch

    def test_what_it_refuses(self, method):
        for wrong in ({"budget": 12.5}, {"budget": 0}, {"budget": 12}, {"seed": -1}):
            with pytest.raises(RaceError, match=next(iter(wrong))):
                METHODS[method](MIXED, **({"budget": 300, "seed": 1} | wrong))
        with pytest.raises(RaceError, match="more than one value"):
            race_of(method, Space([categorical("a", [1])]))
        space = Space([integer("a", 1, 2), integer("b", 1, 2)], forbidden=["a == 2", "b == 2"])
        with pytest.raises(RaceError, match="expected several different configurations to be allowed, found one"):
            race_of(method, space).ask()


SEARCHES = ["random", "tpe", "cma-es"]


def search_of(method, space=MIXED, budget=300, seed=1, **options):
    """One with options of its own."""
    search = METHODS[method]
    return search(space, budget=budget, seed=seed, options=replace(search.keywords["options"], **options))


@pytest.mark.swept
@pytest.mark.parametrize("method", some(SEARCHES, 2))
class TestSearch:
    def test_all_is_spent_and_what_is_left_goes_to_the_best(self, method):
        race = search_of(method, budget=317, instances=10, generation=7)
        told = run(race)
        assert race.used == 317
        last = race.iterations[-1]
        assert last.postselection
        finals = [e for e, _ in told[-last.used :]]
        before = race.iterations[-2].elites
        assert {e.configuration for e in finals} <= {elite.configuration for elite in before}
        assert before[0].configuration in {e.configuration for e in finals}
        assert race.best.n_results == 12  # of 7 experiments, 5 are on one instance, and 2 on the next

    def test_the_winner_has_the_least_mean_of_those_that_have_seen_most(self, method):
        race = search_of(method, budget=250, instances=8, generation=8)
        run(race)
        found = [race.history.statistics(number) for number in range(len(race.configurations))]
        most = max(one.n_results for one in found)
        assert race.best == min((one for one in found if one.n_results == most), key=lambda one: one.mean)

    def test_configurations_of_an_extended_search_see_what_the_best_have_seen(self, method):
        race = search_of(method, budget=317, instances=10, generation=7)
        run(race)
        most, n = race.best.n_results, len(race.configurations)
        race.extend(450)
        run(race)
        seen = {race.history.statistics(number).n_results for number in range(n, len(race.configurations))}
        assert max(seen) >= most > 10

    def test_it_begins_with_given_configurations(self, method):
        given = [
            {"x": 2.0, "n": 30, "size": "10", "rule": "fast", "rate": 0.25},
            {"x": -1.2345, "n": 999, "size": "1", "rule": "slow"},
        ]
        race = METHODS[method](MIXED, budget=300, seed=1, initial=given)
        run(race)
        assert race.configurations[:2] == given
        assert race.configurations[race.best.configuration] == given[0]

    def test_given_configurations_with_dependent_bounds(self, method):
        space = Space([integer("n", 1, 20), integer("k", 0, "n"), real("w", "k", "n + 1")])
        given = [{"n": n, "k": k, "w": w} for n, k, w in ((1, 0, 0.5), (7, 7, 7.25), (20, 3, 21.0))]
        race = METHODS[method](space, budget=300, seed=1, initial=given)
        race.ask()
        assert race.configurations[:3] == given


def test_a_space_that_is_mostly_forbidden_is_searched_to_the_end_of_the_budget():
    """Of its configurations 1 % are allowed: a run of 100 that are not is likely."""
    race = race_of("random", Space([real("x", 0, 1)], forbidden=["x > 0.01"]), budget=400)
    run(race, cost=lambda c: c["x"])
    assert race.stop_reason == "the budget left is too small for another configuration"


def test_a_search_of_a_space_that_has_run_says_how_often_it_has_drawn():
    race = search_of("random", Space([categorical("a", [1, 2, 3])]), budget=200, instances=5)
    run(race, cost=lambda c: int(c["a"]))
    assert re.fullmatch(r"no configuration was found within 100 draws that has not run", race.stop_reason)


def test_if_all_elites_are_rejected_the_best_of_the_others_run_on():
    """In the final race of 7 experiments, whose first instance is the eleventh."""

    def raced(rejected):
        race = search_of("random", budget=317, instances=10, generation=7)
        while batch := race.ask():
            costs = [mixed_cost(race.configurations[e.configuration]) + noise(0, e) for e in batch]
            late = [e.instance >= 10 and e.configuration in rejected for e in batch]
            race.tell([math.inf if is_rejected else cost for cost, is_rejected in zip(costs, late, strict=True)])
        return race

    elites = {elite.configuration for elite in raced(()).iterations[-2].elites}
    race = raced(elites)
    costs = [list(race.costs(number).values())[:10] for number in range(len(race.configurations))]
    others = sorted({*range(len(costs))} - elites, key=lambda number: sum(costs[number]))[:5]
    assert {number for number in range(len(costs)) if len(race.costs(number)) > 10} == {*elites, *others[:2]}
    assert (len(elites), race.used) == (5, 317)
    assert {elite.configuration for elite in race.elites} == {*others}
    assert race.best.configuration in others[:2]


@pytest.fixture(scope="module", params=[("tpe", 600), ("cma-es", 1000)], ids=["tpe", "cma-es"])
def learnt(request):
    """A race by Optuna that has ended."""
    method, budget = request.param
    race = race_of(method, budget=budget)
    run(race)
    return race


def test_optuna_prunes_what_is_worse(learnt):
    seen = [learnt.history.statistics(number).n_results for number in range(len(learnt.configurations))]
    assert sum(n < 20 for n in seen) > len(seen) / 2
    assert min(seen) >= 4  # the least that its test can tell apart at 0.1


def test_optuna_learns(learnt):
    """Its last configurations are better than its first: by luck with a chance of 1e-7, as of 30 beside 30."""
    costs = [mixed_cost(c) for c in learnt.configurations]
    from scipy.stats import mannwhitneyu

    assert mannwhitneyu(costs[:30], costs[-30:], alternative="greater").pvalue < 1e-7


def test_the_estimator_learns_where_nothing_is_allowed():
    """Though costs fall towards there: about 40 of 100 draws are wasted, 98 or more if it ignored them."""
    space = Space([real("x", 0, 1), integer("n", 1, 9)], forbidden=["n > 3 & x < 0.5"])
    sampler = OptunaSampler(space, seed=1, generation=10, name="tpe")
    wasted = 0
    for k in range(150):
        proposal = sampler()
        given, is_forbidden = proposal.configuration, space.is_forbidden(proposal.configuration)
        proposal.finish(None if is_forbidden else given["x"] - given["n"])
        wasted += is_forbidden and k >= 50
    assert wasted < 70


@pytest.mark.thorough
def test_the_estimator_learns_what_is_not_allowed_after_a_first_cost_and_not_without_end():
    """Without a cost it would search around the first forbidden ones; with thousands of them it would be slow."""
    sampler = OptunaSampler(Space([real("x", 0, 1)]), seed=1, generation=10, name="tpe")
    for cost in [*[None] * 20, 1.0, *[None] * 520]:
        sampler().finish(cost)
    worst = [trial.number for trial in sampler._study.trials if trial.value == math.inf]
    assert worst == list(range(21, 521))


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::optuna.exceptions.ExperimentalWarning")
def test_optuna_s_own_pruner_does_the_same():
    """On a few differences, where scipy's test is exact with ties, too."""
    import optuna

    draws = np.random.default_rng(1)
    decisions = []
    for _ in range(12):
        race = search_of("random", budget=400, instances=8, generation=2, pruning=0.1)
        study = optuna.create_study(pruner=optuna.pruners.WilcoxonPruner())
        best = draws.integers(0, 4, 8)
        other = best + draws.integers(-1, 3, 8)
        for costs in (best, other):
            trial = study.ask()
            (number,) = race.history.add([({}, None)])
            for instance, cost in enumerate(costs.tolist()):
                trial.report(cost, instance)
                race.history.costs[number][instance] = cost
                decisions.append((race._is_worse(number), trial.should_prune()))
            study.tell(trial, costs.mean())
            race.history.elites = [race.history.statistics(0)]
    assert all(ours == theirs for ours, theirs in decisions)
    assert 10 < sum(ours for ours, _ in decisions) < 100


def test_cma_es_needs_numbers():
    with pytest.raises(RaceError, match="method cma-es: expected at least two numeric or ordered parameters, found 1"):
        race_of("cma-es", Space([integer("n", 1, 9), categorical("a", "xyz")]))


@pytest.mark.parametrize("name", ["tpe", "cma-es"])
def test_a_budget_of_which_nothing_is_learnt_is_reported(name):
    space = Space([real("x", 0, 1), real("y", 0, 1)])
    [note] = METHODS[name](space, budget=200, seed=1).notes
    assert "a budget of 200 is little more than random search" in note
    assert METHODS[name](space, budget=201, seed=1).notes == []
    assert METHODS["random"](space, budget=200, seed=1).notes == []


def test_an_interrupted_race_does_not_end_as_one_that_is_complete():
    class Interrupted(Halving):
        def _later_children(self, n, elites):
            raise KeyboardInterrupt

    race = Interrupted(MIXED, budget=300, seed=1)
    with pytest.raises(KeyboardInterrupt):
        run(race)
    for _ in range(2):
        with pytest.raises(RaceError, match="cannot continue after KeyboardInterrupt"):
            race.ask()


def test_elites_of_a_search_are_sorted_again_when_costs_are_replaced():
    race = search_of("random", Space([real("x", 0, 1)]), budget=60, instances=10, generation=3)
    while len(race.elites) < 3:
        race.tell([float(one.configuration) for one in race.ask()])
    race.revise({Experiment(0, 0): 1000.0})
    assert [elite.configuration for elite in race.elites] == [1, 2, 0]
    assert race.best.configuration == 1
