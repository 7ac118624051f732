"""How a race stands, as read from its events, against what its optimizer and its record say."""

import math
import random

import pytest

from mercator_design.race import IteratedRace
from mercator_design.race.elimination.summary import Progress, Scores
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.session import events
from mercator_design.race.session.events import (
    BudgetExtended,
    ConfigurationAdded,
    ExperimentDone,
    IterationEnded,
    RaceEnded,
    ScoreRevised,
)
from mercator_design.race.session.journal import Journal, read
from mercator_design.race.session.record import Record
from mercator_design.race.session.view import RaceView
from tests.race.racing import BUDGET, SPACE, TESTING, runner

PLAN = Progress(iteration=1, iterations=3, alive=0, used=0, budget=10, best=None)
ONE = {"iteration": 1, "seed": 1}
ENDED = {"postselection": False, "budget": 9, "used": 2, "configurations": 2, "instances": 1, "stagnant": 0, "note": ""}


def cost(score):
    return score


def progress(view):
    return view.progress(cost, PLAN)


def test_it_follows_the_race():
    race = IteratedRace(SPACE, budget=BUDGET, seed=1)
    executor = ThreadExecutor(1)
    run = runner(Record(), executor, race=race)
    plan = runner(Record(), executor).problem.optimizer.progress
    view = RaceView(BUDGET)
    now = view.progress(run.problem.cost, plan)
    assert (now.best, now.alive, now.used, view.leader) == (None, 0, 0, None)
    n_run, seen = 0, []
    with executor:
        for event in run:
            view.note(event)
            now, true = view.progress(run.problem.cost, plan), race.progress
            if isinstance(event, ExperimentDone):
                n_run += 1
                if seen[-1:] != [true.alive]:
                    seen.append(true.alive)
                assert now.used == n_run
                if true.iteration <= true.iterations:
                    assert now.alive in seen[-3:]  # perhaps an instance late
            elif isinstance(event, IterationEnded):
                assert (now.alive, now.best.configuration, view.leader) == (event.alive, *[event.elites[0]] * 2)
                costs = race.costs(event.elites[0])
                assert now.best.mean == pytest.approx(sum(costs.values()) / len(costs))
                assert view.incumbents[-1].scores == costs
    assert view.leader == now.best.configuration == run.result.configuration
    assert now.iterations >= now.iteration == len(race.iterations)
    assert list(view.results()) == list(run.result.finished)
    assert run.view.progress(run.problem.cost, plan) == race.progress  # which knows it exactly


def test_live_and_from_the_journal_it_is_the_same(tmp_path):
    """Also for a race that is resumed, and for one whose journal is read a little at a time."""
    views = []
    with ThreadExecutor(2) as executor:
        with Journal(tmp_path / "journal", new=True) as journal:
            part = runner(journal, executor, testing=TESTING)
            for _ in zip(range(200), part, strict=False):
                pass
            part.close()
        with Journal(tmp_path / "journal", new=False) as journal:
            assert journal.record.view.n_experiments == len(journal.record.experiments) > 0
            run = runner(journal, executor, testing=TESTING)
            run.finish()
            views.append(run.view)
    views.append(read(tmp_path / "journal").record.view)
    for view in views:
        view.live = None
        assert (view.leader, view.winner, view.is_complete) == (*[run.result.configuration] * 2, True)
        assert view.test_scores() == {one: scores.values for one, scores in run.result.tests.items()}
        assert view.headline() == run.result.headline == (run.result.tests[view.leader], True)
        assert view.headline(fresh=False) == (run.result.scores, False)
        assert tuple(view.scores(view.leader).values()) == run.result.scores.values
    assert [vars(view) for view in views[1:]] == [vars(view) for view in views[:1]]


def test_failures_and_revised_scores():
    view = RaceView(10)
    view.note(ExperimentDone(experiment=0, configuration=0, instance=0, score=None, failure="why", **ONE))
    assert (progress(view).best, view.scores(0)) == (None, {})
    view.note(ExperimentDone(experiment=1, configuration=1, instance=0, score=2.0, **ONE))
    view.note(ScoreRevised(experiment=2, configuration=1, instance=0, score=3.0))
    assert (progress(view).best.mean, progress(view).alive) == (3.0, 2)
    assert math.isnan(progress(view).best.sd)
    view.note(ScoreRevised(experiment=3, configuration=1, instance=0, score=None, failure="worse"))
    assert (progress(view).best, view.scores(1)) == (None, {})
    assert [(one.score, one.failure) for one in view.results()] == [(None, "why"), (None, "worse")]


def test_who_leads_while_a_race_ends_and_is_extended():
    view = RaceView(2)
    for number in (0, 1):
        view.note(ConfigurationAdded(configuration=number, parent=None, values={}))
        view.note(ExperimentDone(experiment=number, configuration=number, instance=0, score=3.0 - number, **ONE))
    assert (view.leader, view.headline()) == (None, None)
    view.note(IterationEnded(iteration=1, alive=1, elites=(1, 0), **ENDED))
    assert (view.leader, view.headline(), view.winner, view.is_complete) == (1, (Scores((2.0,)), False), None, False)
    view.note(RaceEnded(budget=2, experiments=2, winner=0))
    view.note(events.TestDone(configuration=0, instance=1, seed=1, score=7.0))
    view.note(events.TestDone(configuration=0, instance=0, seed=1, score=None, failure="why"))
    view.note(events.TestDone(configuration=1, instance=0, seed=1, score=1.0))
    assert (view.leader, view.headline(), view.is_complete) == (0, (Scores((7.0,)), True), True)
    assert view.headline(fresh=False).where == "in the race, 1 run"
    assert view.headline().where == "on 1 fresh instance"
    assert view.test_scores() == {0: (7.0,), 1: (1.0,)}
    view.note(BudgetExtended(budget=4))
    assert (view.leader, view.winner, view.is_complete, view.budget) == (1, 0, False, 4)


def test_scores_are_in_the_order_of_experiments_whatever_finishes_first():
    run = [
        ExperimentDone(experiment=number, configuration=0, instance=(7 * number) % 10, score=float(number), **ONE)
        for number in range(10)
    ]
    view = RaceView(10)
    for event in random.Random(1).sample(run, len(run)):
        view.note(event)
    view.note(IterationEnded(iteration=1, alive=1, elites=(0,), **ENDED))
    assert list(view.results()) == run
    assert list(view.results()[2:4]) == run[2:4]
    assert list(view.scores(0).items()) == list(view.incumbents[0].scores.items())
    assert list(view.scores(0).values()) == list(map(float, range(10)))


def test_the_best_before_is_compared_by_its_scores_of_that_time():
    view = RaceView(10)
    for number in range(4):
        view.note(ExperimentDone(experiment=number, configuration=number % 2, instance=number // 2, score=1.0, **ONE))
    view.note(IterationEnded(iteration=1, alive=2, elites=(0, 1), **ENDED))
    view.note(ScoreRevised(experiment=4, configuration=0, instance=1, score=5.0))
    view.note(IterationEnded(iteration=2, alive=2, elites=(1, 0), **ENDED))
    view.note(ScoreRevised(experiment=5, configuration=0, instance=1, score=6.0))
    view.note(IterationEnded(iteration=3, alive=2, elites=(1, 0), **ENDED))
    assert [one.before for one in view.incumbents] == [None, {0: 1.0, 1: 5.0}, None]
    assert [one.scores for one in view.incumbents] == [{0: 1.0, 1: 1.0}] * 3
