"""The winner of a race at work: its median, best and worst run, simulated again for a report."""

from typing import NamedTuple

from mercator_design.errors import MercatorError
from mercator_design.results.analysis.proof import Proof
from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.results.facts import Facts


class ShownRun(NamedTuple):
    """A run of the winner, to be shown."""

    name: str
    seed: int
    score: float


def chosen_runs(facts: Facts, proof: Proof | None) -> list[ShownRun]:
    """The median, best and worst run of the winner: of its tests, else of the proof, else of the race."""
    best = facts.best
    known = {one.seed: one.score for where, one in facts.record.tests.items() if where.configuration == best}
    if not known and proof is not None:
        known = dict(zip(proof.seeds, proof.contestants[0].scores, strict=True))
    if not known:
        known = {one.seed: one.score for one in facts.view.results() if one.configuration == best}
    scores = sorted((score, seed) for seed, score in known.items() if score is not None)
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


def run_again(facts: Facts, proof: Proof | None) -> WinnerRuns:
    """The winner's runs that a report shows, simulated again; none before the race has ended."""
    runs = chosen_runs(facts, proof) if facts.view.is_complete else []
    designer, pfsm = facts.designer, None if facts.best is None else facts.pfsm(facts.best)
    if designer is None or pfsm is None:
        return WinnerRuns(runs)
    found = []
    for run in runs:
        title = f"{run.name} run: score {0.0 + run.score:.4g}, instance {run.seed}"
        try:
            experiment = ShownExperiment.simulated(designer.simulator, pfsm, run.seed, title=title)
        except MercatorError as error:
            return WinnerRuns(runs, problem=error.messages[0])
        if experiment.score != run.score:
            other = "This version's simulator gives other scores than that of the race, so no replays are shown."
            return WinnerRuns(runs, problem=other)
        found.append(experiment)
    return WinnerRuns(runs, found)
