"""Where a race stands, as read from its events, against what its optimizer says."""

import pytest

from mercator_design.race import IteratedRace
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.session.events import ExperimentDone, IterationEnded, ScoreRevised
from mercator_design.race.session.record import Record
from mercator_design.race.session.standing import Standing
from tests.race.racing import BUDGET, SPACE, runner


def test_it_follows_the_race():
    race = IteratedRace(SPACE, budget=BUDGET, seed=1)
    executor = ThreadExecutor(1)
    run = runner(Record(), executor, race=race)
    problem = runner(Record(), executor).problem
    standing = Standing(problem.cost, problem.optimizer.progress)
    assert (standing.progress.best, standing.progress.alive, standing.progress.used) == (None, 0, 0)
    n_run, seen = 0, []
    with executor:
        for event in run:
            standing.note(event)
            now, true = standing.progress, race.progress
            if isinstance(event, ExperimentDone):
                n_run += 1
                if seen[-1:] != [true.alive]:
                    seen.append(true.alive)
                assert now.used == n_run
                if true.iteration <= true.iterations:
                    assert now.alive in seen[-3:]  # perhaps an instance late
            elif isinstance(event, IterationEnded):
                assert (now.alive, now.best.configuration) == (event.alive, event.elites[0])
                costs = race.costs(event.elites[0])
                assert now.best.mean == pytest.approx(sum(costs.values()) / len(costs))
    assert now.best.configuration == run.result.configuration
    assert now.iterations >= now.iteration == len(race.iterations)


def test_failures_and_revised_scores():
    problem = runner(Record(), ThreadExecutor(1)).problem
    standing = Standing(problem.cost, problem.optimizer.progress)
    one = {"iteration": 1, "instance": 0, "seed": 1}
    standing.note(ExperimentDone(experiment=0, configuration=0, score=None, failure="why", **one))
    assert standing.progress.best is None
    standing.note(ExperimentDone(experiment=1, configuration=1, score=2.0, **one))
    standing.note(ScoreRevised(experiment=2, configuration=1, instance=0, score=3.0))
    assert (standing.progress.best.mean, standing.progress.alive) == (3.0, 2)
    standing.note(ScoreRevised(experiment=3, configuration=1, instance=0, score=None, failure="worse"))
    assert standing.progress.best is None
