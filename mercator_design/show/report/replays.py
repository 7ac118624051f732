"""The winner at work: its median, best and worst run, as replays."""

from collections.abc import Sequence
from typing import NamedTuple

from mercator_design.errors import MercatorError
from mercator_design.results.analysis.proof import Proof
from mercator_design.show.charts import number
from mercator_design.show.experiment import ShownExperiment
from mercator_design.show.markup import escaped
from mercator_design.show.page import script_json
from mercator_design.show.replay import Replay
from mercator_design.show.report.facts import Facts
from mercator_design.show.report.markup import Html, note, section


class ShownRun(NamedTuple):
    """A run of the winner that is shown."""

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


def run_again(facts: Facts, runs: Sequence[ShownRun]) -> tuple[list[ShownExperiment], str]:
    """The runs again, to be shown; or none, and why."""
    designer, pfsm = facts.designer, None if facts.best is None else facts.pfsm(facts.best)
    if designer is None or pfsm is None:
        return [], ""
    found = []
    for run in runs:
        title = f"{run.name} run: score {number(run.score)}, instance {run.seed}"
        try:
            experiment = ShownExperiment.simulated(designer.simulator, pfsm, run.seed, title=title)
        except MercatorError as error:
            return [], error.messages[0]
        if experiment.score != run.score:
            return [], "This version's simulator gives other scores than that of the race, so no replays are shown."
        found.append(experiment)
    return found, ""


def replays(runs: Sequence[ShownRun], shown: Sequence[Replay], without: str) -> Html:
    """The section of the replays, a tab for each."""
    if not shown:
        return section("replays", "The winner at work", note(without) if without else "")
    tabs = "".join(
        f'<button type="button" aria-pressed="{str(k == 0).lower()}" data-replay="{k}" '
        f'data-seed="{run.seed}" data-score="{run.score:.6g}">{escaped(run.name)}: {number(run.score)}</button>'
        for k, run in enumerate(runs[: len(shown)])
    )
    player = (
        f'<div class="tabs" role="group" aria-label="Runs">{tabs}</div><div id="replay"></div>'
        f'<script type="application/json" id="sources">{script_json(list(shown))}</script>'
    )
    left_out = [run.name for run in runs[len(shown) :]]
    about = f"The page would be too large with the {' and the '.join(left_out)} run, too." if left_out else ""
    return section("replays", "The winner at work", Html(player), note(about) if about else "")
