"""The winner of a race at work: its median, best and worst run, simulated again for a report.

Of several objectives, it is each design of the front, all on the same instance.
"""

from typing import TYPE_CHECKING, NamedTuple

from mercator_design.designer import Designer
from mercator_design.errors import MercatorError
from mercator_design.results.analysis.comparison import winner_tests
from mercator_design.results.analysis.front import front_of
from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.results.facts import Facts

if TYPE_CHECKING:
    from mercator_design.race.session.events import ExperimentDone, TestDone


class ShownRun(NamedTuple):
    """A run of a configuration, to be shown."""

    name: str
    seed: int
    score: float
    configuration: int
    scores: tuple[float, ...] = ()  # by each of several objectives


def chosen_runs(facts: Facts) -> list[ShownRun]:
    """The median, best and worst of the runs whose mean is the headline: on fresh instances, else of the race.

    Of several objectives, it is a run of each design of the front, the winner first.
    """
    if facts.designer is not None and facts.designer.n_objectives > 1:
        return _front_runs(facts, facts.designer)
    known = winner_tests(facts.record) if facts.headline is not None and facts.headline.is_fresh else {}
    if not known:
        results = (one for one in facts.view.results() if one.configuration == facts.best)
        known = {one.seed: one.score for one in results if one.score is not None}
    scores = sorted((score, seed) for seed, score in known.items())
    if not scores or facts.task is None or facts.best is None:
        return []
    if not facts.task.maximise:
        scores.reverse()
    places = {"median": (len(scores) - 1) // 2, "best": len(scores) - 1, "worst": 0}
    return [ShownRun(name, scores[place][1], scores[place][0], facts.best) for name, place in places.items()]


def _front_runs(facts: Facts, designer: Designer) -> list[ShownRun]:
    """A run of each design of the front on the first instance on which it was measured."""
    numbers = [one.configuration for one in front_of(designer, facts.record) if one.is_on_front]
    found = list[ShownRun]()
    for number in sorted(numbers, key=lambda one: one != facts.best):
        results: list[ExperimentDone | TestDone] = [
            *(one for where, one in sorted(facts.record.tests.items()) if where.configuration == number),
            *(one for one in facts.view.results() if one.configuration == number),
        ]
        first = next(one for one in results if one.score is not None)
        name = f"winner, {number}" if number == facts.best else f"design {number}"
        found.append(ShownRun(name, first.seed, first.score or 0.0, number, first.scores))
    return found


class WinnerRuns(NamedTuple):
    """Runs of the winner.

    runs: Its median, best and worst run; or those of a front.
    experiments: The same ones, simulated again.
    problem: Why there are no experiments; empty if there are, or if no robots were raced.
    """

    runs: list[ShownRun] = []  # noqa: RUF012 - never changed
    experiments: list[ShownExperiment] = []  # noqa: RUF012
    problem: str = ""


def run_again(facts: Facts) -> WinnerRuns:
    """The winner's runs that a report shows, simulated again; none before the race has ended."""
    runs = chosen_runs(facts) if facts.view.is_complete else []
    designer = facts.designer
    if designer is None:
        return WinnerRuns(runs)
    found = []
    for run in runs:
        software = facts.software(run.configuration)
        if software is None:
            return WinnerRuns(runs)
        title = f"{run.name} run: score {0.0 + run.score:.4g}, instance {run.seed}"
        if run.scores:
            each = zip(designer.simulator.mission.objective_names, run.scores, strict=True)
            title = ", ".join([run.name, *(f"{name} {0.0 + score:.4g}" for name, score in each)])
        try:
            experiment = ShownExperiment.simulated(designer.simulator, software, run.seed, title=title)
        except MercatorError as error:
            return WinnerRuns(runs, problem=error.messages[0])
        if experiment.score != run.score:
            other = "This version's simulator gives other scores than that of the race, so no replays are shown."
            return WinnerRuns(runs, problem=other)
        found.append(experiment)
    return WinnerRuns(runs, found)
