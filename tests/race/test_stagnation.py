"""A race that no longer finds anything better says so, and one that does says nothing."""

import math
import random
import re

import numpy as np
import pytest
from scipy.stats import ttest_ind

from mercator_design.race import Halving, IteratedRace, parse_space
from mercator_design.race.elimination.stagnation import MIN_ITERATIONS, agreement, is_better, judged
from mercator_design.race.elimination.summary import Elite, IterationSummary
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.session.events import IterationEnded
from mercator_design.race.session.journal import read
from mercator_design.race.session.record import Record
from tests.race.racing import resumed, runner
from tests.tiers import some

SPACE = parse_space('x "" r (-5, 5)\ny "" r (-5, 5)\nz "" r (-5, 5)\nrule "" c (a, b, c)')


def distance(configuration):
    x, y, z, rule = configuration.values()
    return (x - 1) ** 2 + (y + 1) ** 2 + (z - 2) ** 2 + (rule != "b")


def notes(cost, method, seed, space=SPACE, of=distance):
    """Of the iterations of a race; a cost is of the distance from the optimum and a standard normal draw."""
    race = method(space, budget=1000, seed=seed)
    rng = random.Random(seed)
    while batch := race.ask():
        race.tell([cost(of(race.configurations[e.configuration]), rng.gauss(0, 1)) for e in batch])
    return [(one.iteration, one.note) for one in race.iterations if one.note]


LATEST = {Halving: 8, IteratedRace: 2 + MIN_ITERATIONS}
"""The iteration in which a race without a gain says so at the latest: generations after the first are small."""


@pytest.mark.parametrize("method", LATEST)
class TestRaces:
    """Of fixed seeds: nothing is left to luck."""

    @pytest.mark.swept
    def test_most_that_improve_say_nothing(self, method):
        """Of ten parameters, there is more to improve than the budget is enough for."""
        space = parse_space("\n".join(f'x{k} "" r (-5, 5)' for k in range(10)))

        def far(configuration):
            return sum((x - 1) ** 2 for x in configuration.values())

        found = [notes(lambda d, noise: d + 0.1 * d * noise, method, seed, space, far) for seed in some(range(5), 2)]
        assert sum(map(bool, found)) <= 1
        assert all("first iteration" not in note for few in found for _, note in few)

    @pytest.mark.parametrize("seed", range(4))
    def test_one_that_has_reached_the_best_there_is(self, method, seed):
        [(iteration, note)] = notes(lambda d, _: float(d > 8), method, seed)
        assert iteration <= LATEST[method]
        assert re.match(r"no gain in [3-7] iterations, since iteration 1: \d+ is still the best", note)

    @pytest.mark.thorough
    def test_most_that_see_noise_only_say_so(self, method):
        """Halving tests no newcomers: those that ran twice were selected by their first result."""
        found = [dict(notes(lambda _, noise: noise, method, seed)) for seed in range(8)]
        first = "no significant difference between the configurations of the first iteration (Kendall's W "
        n_first = sum(few.get(1, "").startswith(first) for few in found)
        assert n_first >= 6 if method is IteratedRace else n_first == 0
        later = [note for few in found for iteration, note in few.items() if iteration > 1]
        assert len(later) >= 6
        alike = ["; no significant difference between new configurations in " in note for note in later]
        assert any(alike) == (method is IteratedRace)

    def test_one_that_sees_nothing(self, method):
        found = dict(notes(lambda *_: 1.0, method, 1))
        assert found[1] == "all configurations of the first iteration cost the same: the race cannot learn from them"
        assert 4 <= max(found) <= LATEST[method]


def test_note_counts_soft_restarts():
    """A space so small that newcomers repeat what there was."""
    small = parse_space('a "" c (a, b, c, d)\nb "" c (a, b, c, d)')
    race = IteratedRace(small, budget=600, seed=1)
    rng = random.Random(1)
    while batch := race.ask():
        race.tell([(race.configurations[e.configuration]["a"] != "a") + 0.1 * rng.gauss(0, 1) for e in batch])
    [note] = [one.note for one in race.iterations if one.note]
    assert re.search(r"\d+ is (still the best|not significantly better than \d+); \d+ soft restarts?\b", note)


class TestGain:
    def test_on_common_instances_only(self):
        earlier = {0: 3.0, 1: 5.0, 2: 4.0}
        assert is_better({0: 2.0, 1: 4.1, 2: 2.9, 9: 100.0}, earlier)
        assert not is_better({0: 2.0, 1: 6.0, 2: 4.0}, earlier)
        assert not is_better(earlier, earlier)
        assert not is_better({2: 0.0, 9: 0.0}, earlier)  # one instance tells nothing

    def test_what_was_rejected_since_is_beaten(self):
        assert is_better({0: 1.0, 1: 2.0}, {0: math.inf, 1: 2.5})
        assert is_better({0: 9.0}, {0: 1.0, 7: math.inf})

    def test_on_all_instances_if_few_are_common(self):
        """By Welch's test, whatever the instances are called."""
        costs = {9: 1.0, 8: 2.0, 7: 1.5}
        assert is_better(costs, {0: 4.0, 1: 5.0, 2: 4.5})
        assert is_better(costs, {0: 4.0, 1: 5.0, 7: 4.5})  # a third is common
        assert not is_better(costs, {0: 1.0, 1: 2.0, 2: 1.5})
        assert not is_better({0: 4.0, 1: 5.0, 2: 4.5}, costs)
        assert is_better({0: 1.0, 1: 1.0}, {2: 2.0, 3: 2.0})  # without any variance
        assert not is_better({0: 1.0, 1: 1.0}, {2: 1.0, 3: 1.0})
        assert not is_better({0: 0.0}, {1: 9.0, 2: 8.0})  # one result tells nothing
        for unit in (1e-82, 1e78):  # the square of its variance is no number
            assert is_better({0: unit, 1: 1.5 * unit}, {2: 9 * unit, 3: 8 * unit})
            assert not is_better({0: 9 * unit, 1: 8 * unit}, {2: unit, 3: 1.5 * unit})
        assert not is_better({0: 0.0, 1: 0.5}, {2: 9.0})

    def test_half_of_the_instances_in_common_are_enough_for_a_paired_test(self):
        """The common ones alone decide, though the others would say the opposite."""
        own = {0: 1.0, 1: 2.0, 2: 3.1, 3: 50.0, 4: 60.0, 5: 70.0}
        assert is_better(own, {0: 2.0, 1: 3.1, 2: 4.0, 6: 0.0, 7: 1.0, 8: 2.0})
        assert not is_better(own, {0: 2.0, 1: 3.1, 6: 0.0, 7: 1.0, 8: 2.0, 9: 3.0})

    def test_it_agrees_with_scipy_on_independent_costs(self):
        draws = np.random.default_rng(1)
        decisions = []
        for _ in range(500):
            costs = draws.normal(0, draws.uniform(0.1, 3), draws.integers(2, 12))
            earlier = draws.normal(1, draws.uniform(0.1, 3), draws.integers(2, 12))
            expected = ttest_ind(costs, earlier, equal_var=False, alternative="less").pvalue < 0.05
            later = {100 + k: cost for k, cost in enumerate(costs.tolist())}
            assert is_better(later, dict(enumerate(earlier.tolist()))) == expected
            decisions.append(expected)
        assert 100 < sum(decisions) < 400

    @pytest.mark.parametrize("first", [0, 10])
    def test_how_often_there_is_one_by_chance(self, first):
        """At 5 %: of 2000 pairs without a difference 100 on average, and fewer than 50 or more than 150 by luck with a
        probability below 1e-6."""
        rng = random.Random(1)

        def costs(first):
            return {k: rng.gauss(0, 1) for k in range(first, first + 10)}

        assert 50 <= sum(is_better(costs(first), costs(0)) for _ in range(2000)) <= 150


def test_agreement():
    kendall, p_value = agreement([{0: 1.0, 1: 10.0}, {0: 2.0, 1: 20.0, 5: 0.0}, {0: 3.0, 1: 30.0}])
    assert kendall == 1
    assert p_value == pytest.approx(math.exp(-2))  # of chi-square 4 with 2 degrees of freedom
    for costs in ([], [{0: 1.0, 1: 2.0}], [{0: 1.0}, {1: 1.0}], [{0: 1.0}, {0: 2.0}]):
        assert agreement(costs) is None
    kendall, p_value = agreement([{0: 1.0, 1: 2.0}, {0: 1.0, 1: 2.0}])
    assert (math.isnan(kendall), p_value) == (True, 1)


def iteration(number, best):
    elite = Elite(configuration=best, mean=0.0, sd=0.0, n_results=2)
    return IterationSummary(
        iteration=number, postselection=False, budget=100, used=100, n_configurations=2, n_new=2, n_instances=2,
        n_alive=1, elites=(elite,), soft_restart=False, stop_reason="",
    )  # fmt: skip


class TestJudged:
    """Of an iteration, given the costs of configurations."""

    def test_a_first_iteration_of_which_one_was_accepted(self):
        costs = [{0: 1.0, 1: 2.0}, {0: math.inf}, {0: math.inf}]
        found = judged(iteration(1, 0), [], costs.__getitem__, [0, 1, 2], 1000)
        assert found.note.startswith("too few configurations of the first iteration were accepted")

    def test_a_first_iteration_whose_newcomers_are_not_to_be_compared(self):
        found = judged(iteration(1, 0), [], [{0: 1.0}].__getitem__, [], 1000)
        assert (found.note, found.newcomers_differ) == ("", True)

    def test_a_single_newcomer_is_not_one_that_cannot_be_told_apart(self):
        costs = [{0: 1.0, 1: 2.0}, {0: 3.0, 1: 4.0}]
        ended = [iteration(1, 0)]
        for number in range(2, 6):
            ended.append(judged(iteration(number, 0), ended, costs.__getitem__, [1], 400))
        [note] = [one.note for one in ended if one.note]
        assert note == "no gain in 3 iterations, since iteration 1: 0 is still the best"

    def test_a_best_that_was_rejected_is_no_measure(self):
        costs = [{0: 1.0, 1: math.inf}, {0: 3.0, 1: 4.0}, {0: 5.0, 1: 9.0}]
        assert judged(iteration(2, 1), [iteration(1, 0)], costs.__getitem__, [1, 2], 400).stagnant == 0


class TestRecord:
    """Iterations are noted as they end."""

    def test_they_are_as_the_race_has_them(self):
        record = Record()
        with ThreadExecutor(1) as executor:
            one = runner(record, executor)
            told = [event for event in one if isinstance(event, IterationEnded)]
        assert told == list(record.iterations.values())
        assert [ended.iteration for ended in told] == [ended.iteration for ended in one.problem.optimizer.iterations]
        assert [ended.elites[0] for ended in told] == [ended.best for ended in one.problem.optimizer.iterations]
        assert sum(ended.used for ended in told) == len(record.experiments)

    def test_once_however_often_the_race_is_stopped(self, tmp_path):
        path = tmp_path / "journal.jsonl"
        resumed(path)
        data = path.read_bytes()
        lines = data.splitlines(keepends=True)
        places = [k for k, line in enumerate(lines) if b'"event":"iteration"' in line]
        assert len(places) > 3
        for place in places:
            for n in (place, place + 1):
                path.write_bytes(b"".join(lines[:n]))
                resumed(path)
                assert path.read_bytes() == data
        assert len(read(path).record.iterations) == len(places)
