"""Experiments that run while the race proposes other configurations of their batch."""

import time
from types import SimpleNamespace

import pytest

from mercator_design.designer import flavour_space
from mercator_design.errors import RaceError
from mercator_design.fsm.space.structure import PfsmStructure
from mercator_design.race import Experiment
from mercator_design.race.executors.executor import ExecutorStopped
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.methods.halving import Halving, HalvingOptions
from mercator_design.race.methods.optimizer import Upcoming
from mercator_design.race.session.journal import Journal, read
from mercator_design.race.session.record import Record
from tests.processes import LIMIT
from tests.race.racing import SPACE, measure, places, runner, undisturbed
from tests.tiers import some

BUDGET = 200
WHOLE = undisturbed(race=Halving(SPACE, budget=BUDGET, seed=1))


class Slow(Halving):
    """It proposes nothing before all that is upcoming has run.

    ran: The items that have run.
    """

    def __init__(self, ran=None, **options):
        super().__init__(SPACE, budget=BUDGET, seed=1, **options)
        self.ran = [] if ran is None else ran
        self.came = []

    def ask(self):
        if (upcoming := self.upcoming) is not None:
            items = {
                (tuple(upcoming.configurations[one.configuration].values()), 1000 + one.instance)
                for one in upcoming.experiments
            }
            end = time.monotonic() + LIMIT
            while not items <= {*self.ran}:
                assert time.monotonic() < end, "upcoming experiments do not run"
                time.sleep(0.001)
            self.came += upcoming.experiments
        return super().ask()


def raced(race, jobs=2, *, predicts=True, record=None, **options):
    """The record of a race, and the items that have run."""
    record = record or Record()
    ran = race.ran if isinstance(race, Slow) else []

    def noted(item):
        found = measure(item)
        ran.append(item)
        return found

    with ThreadExecutor(jobs) as executor:
        run = runner(record, executor, race=race, function=noted, **options)
        run.problem.predicts = predicts
        run.finish()
    return record.record, ran


@pytest.mark.parametrize("jobs", [1, 2, 7])
def test_it_makes_no_difference(jobs):
    race = Slow()
    record, ran = raced(race, jobs)
    assert record.digest() == WHOLE.digest()
    assert len(race.came) > 0.2 * BUDGET
    assert len(ran) == len({*ran})
    # What was rightly predicted has not run again, and almost all was.
    assert len(ran) - len(record.experiments) - len(record.speculative.keys() - {*places(record)}) < 4


@pytest.mark.swept
@pytest.mark.parametrize("jobs", some([1, 2], 1))
def test_given_ones_run_while_others_are_sampled(jobs):
    initial = [{"x": float(k), "y": 0.0, "rule": "fast"} for k in range(-4, 5)]
    race = Slow(initial=initial)
    record, _ = raced(race, jobs)
    assert race.came[: len(initial)] == [Experiment(number, 0) for number in range(len(initial))]
    assert record.digest() == undisturbed(race=Halving(SPACE, budget=BUDGET, seed=1, initial=initial)).digest()


@pytest.mark.parametrize("budget", [24, BUDGET])
def test_simple_ones_are_upcoming_before_others_are_sampled(budget):
    space = flavour_space("watermelon", PfsmStructure("watermelon"))
    race = Halving(space, budget=budget, seed=1)
    upcoming = race.upcoming
    batch = race.ask()
    n = len({one.configuration for one in upcoming.experiments})
    assert 0.6 < n / len(race.configurations) < 0.8
    assert [one for one in batch if one.configuration < n] == upcoming.experiments
    assert race.configurations[:n] == [*upcoming.configurations.values()]
    assert race.upcoming is None


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_wrong_number_costs_time_only(jobs):
    class Wrong(Slow):
        def tell(self, costs):
            super().tell(costs)
            if self.upcoming is not None:
                known = {n: c for n, c in self.upcoming.configurations.items() if n < len(self.configurations)}
                new = [c for n, c in self.upcoming.configurations.items() if n not in known]
                numbers = [n for n in self.upcoming.configurations if n not in known]
                turned = dict(zip(numbers, [*new[1:], *new[:1]], strict=True))
                self._upcoming = self.upcoming._replace(configurations={**known, **turned})

    race = Wrong()
    record, ran = raced(race, jobs)
    assert record.digest() == WHOLE.digest()
    assert len(ran) > len(record.experiments) + 0.1 * BUDGET


def test_a_problem_may_forbid_it():
    race = Halving(SPACE, budget=BUDGET, seed=1)
    record, ran = raced(race, 1, predicts=False)
    assert record.digest() == WHOLE.digest()
    assert len(ran) == len(record.experiments)


def test_nothing_is_upcoming_if_nothing_is_proposed():
    race = Halving(SPACE, budget=BUDGET, seed=1, options=HalvingOptions(surrogate=0))
    while batch := race.ask():
        race.tell([race.configurations[one.configuration]["x"] for one in batch])
        assert race.upcoming is None


def test_what_has_run_when_it_is_stopped_is_kept(tmp_path):
    state = SimpleNamespace(stopped=False)

    class Stopped(Slow):
        def ask(self):
            is_proposing = self.upcoming is not None
            batch = super().ask()
            state.stopped |= is_proposing
            return batch

    path, race = tmp_path / "journal.jsonl", Stopped()
    with Journal(path, new=True) as journal, pytest.raises(ExecutorStopped):
        raced(race, record=journal, stopped=lambda: state.stopped)
    record = read(path).record
    assert len(race.came) > 5
    assert {*race.came} - {*places(record)} - record.speculative.keys() == set()
    with Journal(path, new=False) as journal:
        record, ran = raced(Halving(SPACE, budget=BUDGET, seed=1), 1, record=journal)
    assert record.digest() == WHOLE.digest()
    assert len(ran) + len(race.ran) == len(record.experiments)


@pytest.mark.parametrize("error", [RaceError("none is left"), ZeroDivisionError("a defect")])
def test_an_error_while_it_proposes_is_raised(error):
    class Failing(Halving):
        def ask(self):
            if self.upcoming is not None:
                raise error
            return super().ask()

    with pytest.raises(type(error), match=str(error)):
        raced(Failing(SPACE, budget=BUDGET, seed=1))


def test_nothing_is_upcoming_after_an_error():
    class Failing(Halving):
        def _run(self):
            yield Upcoming([], {})
            raise RaceError("none is left")

    race = Failing(SPACE, budget=BUDGET, seed=1)
    assert race.upcoming == ([], {})
    for _ in range(2):
        with pytest.raises(RaceError, match="none is left"):
            race.ask()
        with pytest.raises(RaceError, match="none is left"):
            _ = race.upcoming


def test_a_failure_of_what_is_upcoming_is_one_of_the_race():
    failed = []

    def fails(item):
        if item[0][0] > 3:
            failed.append(item)
            raise OSError("too far")
        return measure(item)

    record = Record()
    with ThreadExecutor(3) as executor:
        race = Halving(SPACE, budget=BUDGET, seed=1)
        runner(record, executor, race=race, function=fails, on_failure="reject").finish()
    alone = Record()
    with ThreadExecutor(1) as executor:
        race = Halving(SPACE, budget=BUDGET, seed=1)
        runner(alone, executor, race=race, function=fails, on_failure="reject").finish()
    assert failed
    assert record.digest() == alone.digest()
