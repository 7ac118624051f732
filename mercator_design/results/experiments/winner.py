"""The winner of a race at work: its median, best and worst run, simulated again for a report."""

from typing import NamedTuple

from mercator_design.errors import MercatorError
from mercator_design.results.analysis.comparison import winner_tests
from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.results.facts import Facts


class ShownRun(NamedTuple):
    """A run of the winner, to be shown."""

    name: str
    seed: int
    score: float


def chosen_runs(facts: Facts) -> list[ShownRun]:
    """The median, best and worst of the runs whose mean is the headline: on fresh instances, else of the race."""
    known = winner_tests(facts.record) if facts.headline is not None and facts.headline.is_fresh else {}
    if not known:
        results = (one for one in facts.view.results() if one.configuration == facts.best)
        known = {one.seed: one.score for one in results if one.score is not None}
    scores = sorted((score, seed) for seed, score in known.items())
    if not scores or facts.task is None:
        return []
    if not facts.task.maximise:
        scores.reverse()
    places = {"median": (len(scores) - 1) // 2, "best": len(scores) - 1, "worst": 0}
    return [ShownRun(name, scores[place][1], scores[place][0]) for name, place in places.items()]


class WinnerRuns(NamedTuple):
    """Runs of the winner.

    runs: Its median, best and worst run.
    experiments: The same ones, simulated again.
    problem: Why there are no experiments; empty if there are, or if no robots were raced.
    """

    runs: list[ShownRun] = []  # noqa: RUF012 - never changed
    experiments: list[ShownExperiment] = []  # noqa: RUF012
    problem: str = ""


def run_again(facts: Facts) -> WinnerRuns:
    """The winner's runs that a report shows, simulated again; none before the race has ended."""
    runs = chosen_runs(facts) if facts.view.is_complete else []
    designer, software = facts.designer, None if facts.best is None else facts.software(facts.best)
    if designer is None or software is None:
        return WinnerRuns(runs)
    found = []
    for run in runs:
        title = f"{run.name} run: score {0.0 + run.score:.4g}, instance {run.seed}"
        try:
            experiment = ShownExperiment.simulated(designer.simulator, software, run.seed, title=title)
        except MercatorError as error:
            return WinnerRuns(runs, problem=error.messages[0])
        if experiment.score != run.score:
            other = "This version's simulator gives other scores than that of the race, so no replays are shown."
            return WinnerRuns(runs, problem=other)
        found.append(experiment)
    return WinnerRuns(runs, found)
