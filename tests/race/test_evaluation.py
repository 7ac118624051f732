"""What a race found is tested on instances that it never sees, and the race does not know."""

import time
from types import SimpleNamespace

import pytest

from mercator_design.errors import RaceError
from mercator_design.race.elimination.race import Experiment
from mercator_design.race.executors.executor import ExecutorStopped
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.session import evaluation, events  # whose classes pytest would take for tests
from mercator_design.race.session.events import Measurement
from mercator_design.race.session.journal import Journal, read
from mercator_design.race.session.outcome import ExperimentFailed
from mercator_design.race.session.record import Record
from tests.race import racing
from tests.race.lines import events_in, journal_of
from tests.race.racing import TESTING, measure, resumed, runner, undisturbed

WHOLE = undisturbed()
EXPECTED = WHOLE.ends[-1].winner, WHOLE.digest()


@pytest.fixture
def ended():
    """A record and its race, at its end."""
    record = Record()
    with ThreadExecutor(1) as executor:
        one = runner(record, executor)
        one.finish()
    return record, one.problem.optimizer


def test_which_are_tested(ended):
    _, race = ended
    elites = [elite.configuration for elite in race.elites]
    assert len(elites) > 1
    assert evaluation.Testing(runs=3).configurations(race) == elites[:1] == [race.best.configuration]
    assert evaluation.Testing(runs=3, elites=99).configurations(race) == elites
    bests = [iteration.elites[0].configuration for iteration in reversed(race.iterations)]
    assert evaluation.Testing(runs=3, iterations=True).configurations(race) == list(
        dict.fromkeys([*elites[:1], *bests])
    )
    assert len(set(bests)) > 1
    assert evaluation.Testing(runs=2, elites=2).experiments(race) == [
        Experiment(elites[0], 0), Experiment(elites[0], 1), Experiment(elites[1], 0), Experiment(elites[1], 1),
    ]  # fmt: skip


@pytest.mark.parametrize("jobs", [1, 3])
def test_the_race_is_the_same_and_the_tests_are_noted(tmp_path, jobs):
    path = tmp_path / "journal.jsonl"
    winner, digest, n = resumed(path, ThreadExecutor(jobs), testing=TESTING)
    assert (winner, digest) == EXPECTED
    record = read(path).record
    known = {*racing.places(record)} | record.speculative.keys()
    assert n == len(known) + len(record.tests)
    scores = record.view.test_scores()
    assert len(scores[winner]) == TESTING.runs
    values = tuple(record.configurations[winner].values())
    assert list(scores[winner]) == [measure((values, 1_000_000 + k)).score for k in range(TESTING.runs)]
    assert resumed(path, testing=TESTING) == (*EXPECTED, 0)


def test_cut_at_every_line(tmp_path):
    path = tmp_path / "journal.jsonl"
    resumed(path, testing=TESTING, budget=50)
    data = path.read_bytes()
    lines = data.splitlines(keepends=True)
    first = next(k for k, line in enumerate(lines) if b'"event":"test"' in line)
    for n in range(first, len(lines)):
        path.write_bytes(b"".join(lines[:n]) + lines[n][:20])
        assert resumed(path, testing=TESTING, budget=50)[2] == len(lines) - n
        assert path.read_bytes() == data


def test_more_tests_can_be_asked_for(tmp_path):
    path = tmp_path / "journal.jsonl"
    resumed(path)
    assert resumed(path, testing=evaluation.Testing(runs=5)) == (*EXPECTED, 5)
    assert resumed(path, testing=evaluation.Testing(runs=8)) == (*EXPECTED, 3)
    assert resumed(path, testing=evaluation.Testing(runs=8, elites=3)) == (*EXPECTED, 16)


def test_after_a_larger_budget(tmp_path):
    path = tmp_path / "journal.jsonl"
    resumed(path, testing=evaluation.Testing(runs=5))
    with Journal(path, new=False) as one:
        one.note(events.BudgetExtended(budget=500))
    winner, digest, _ = resumed(path, testing=evaluation.Testing(runs=5))
    longer = undisturbed(budgets=(racing.BUDGET, 500))
    assert (winner, digest) == (longer.ends[-1].winner, longer.digest())
    assert winner in read(path).record.view.test_scores()


def test_what_is_under_way_when_they_are_stopped_is_kept(ended):
    record, race = ended
    begun = []

    def counted(item):
        begun.append(item)
        time.sleep(0.002)
        return measure(item)

    with ThreadExecutor(3) as executor, pytest.raises(ExecutorStopped):
        racing.run_all_tests(record, executor, function=counted, stopped=lambda: len(begun) > 10)
    assert 10 < len(record.tests) == len(begun) < len(TESTING.experiments(race))


class TestFailures:
    @staticmethod
    def failing(item):
        if item[1] % 7 == 3:
            raise ArithmeticError("no")
        return measure(item) if item[1] % 7 else Measurement(float("nan"), "")

    def test_they_stop_the_tests_by_default_and_are_tried_again(self, ended):
        record, race = ended
        for _ in range(2):
            with (
                ThreadExecutor(1) as executor,
                pytest.raises(ExperimentFailed, match=r"a test \(configuration") as stop,
            ):
                racing.run_all_tests(record, executor, function=self.failing)
            assert stop.value.finished.configuration == race.best.configuration
            assert all(one.score is not None for one in record.tests.values())

    def test_they_are_noted_if_that_is_wanted(self, ended):
        record, race = ended
        with ThreadExecutor(2) as executor:
            racing.run_all_tests(record, executor, function=self.failing, on_failure="reject")
            assert len(record.tests) == len(TESTING.experiments(race))
            failures = {one.failure for one in record.tests.values() if one.score is None}
            assert failures == {"ArithmeticError: no", "expected a score from -1e+100 to 1e+100, found nan"}
            assert 0 < len(record.view.test_scores()[race.best.configuration]) < TESTING.runs
            racing.run_all_tests(record, executor, function=None)  # nothing is left to run


def test_other_instances_are_refused(ended):
    record, race = ended
    record.note(events.TestDone(configuration=race.best.configuration, instance=0, seed=7, score=1.0))
    with ThreadExecutor(1) as executor, pytest.raises(RaceError, match="instance 0 to have seed 1000000, found 7"):
        racing.run_all_tests(record, executor)


def test_two_results_of_one_test(tmp_path):
    path = tmp_path / "journal.jsonl"
    resumed(path, testing=evaluation.Testing(runs=2))
    known = events_in(path.read_bytes())
    event = {"event": "test", "configuration": EXPECTED[0], "instance": 1, "seed": 1, "score": 1.0}
    path.write_bytes(journal_of([*known, known[-1], event]))
    with pytest.raises(RaceError, match=r"test: configuration \d+ on instance 1 is there twice"):
        read(path)


def test_the_place_of_a_test_is_not_searched_for(monkeypatch):
    """It takes as many comparisons of experiments as there are tests, not their square."""
    n_compared = 0

    class Counted(Experiment):
        __hash__ = Experiment.__hash__

        def __eq__(self, other):
            nonlocal n_compared
            n_compared += 1
            return tuple(self) == tuple(other)

    monkeypatch.setattr(evaluation, "Experiment", Counted)
    with ThreadExecutor(1) as executor:
        runner(Record(), executor, testing=evaluation.Testing(runs=300)).finish()
    assert n_compared < 3000


def test_the_evaluator_compares_on_each_test_instance_those_that_have_run():
    asked = []

    def evaluate(item, alive):
        asked.append((item, alive))
        return Measurement(1.0, "")

    def function(item):
        return 1 / 0 if item == (5, 1) else Measurement(0.0, "")

    def item(experiment, configuration, *, test):
        return tuple(experiment)

    problem = SimpleNamespace(function=function, item=item, evaluate=evaluate)
    tests = [Experiment(number, instance) for number in (7, 5) for instance in (0, 1)]
    with ThreadExecutor(1) as executor:
        known = [Experiment(3, 0)]
        found = dict(evaluation.results_of(problem, executor, tests, {5: {}, 7: {}}, known, lambda: False))
    assert asked == [((7, 0), [3, 7, 5]), ((5, 0), [3, 7, 5]), ((7, 1), [7])]
    assert found.keys() == {*tests}
