"""The winner at work: its median, best and worst run, as replays."""

from collections.abc import Sequence

from mercator_design.results.experiments.winner import WinnerRuns
from mercator_design.results.facts import Facts
from mercator_design.show.charts import number
from mercator_design.show.markup import escaped
from mercator_design.show.page import script_json
from mercator_design.show.replay import Replay
from mercator_design.show.report.markup import Html, note, section


def winner_at_work(facts: Facts, shown: WinnerRuns, replays: Sequence[Replay]) -> Html:
    """The section of the winner's runs, with a tab for each replay; there may be fewer replays than runs."""
    if not replays:
        return section("replays", "The winner at work", note(shown.problem) if shown.problem else "")
    tabs = "".join(
        f'<button type="button" aria-pressed="{str(k == 0).lower()}" data-replay="{k}" '
        f'data-seed="{run.seed}" data-score="{run.score:.6g}">{escaped(run.name)}: '
        f"{', '.join(map(number, run.scores or [run.score]))}</button>"
        for k, run in enumerate(shown.runs[: len(replays)])
    )
    player = (
        f'<div class="tabs" role="group" aria-label="Runs">{tabs}</div><div id="replay"></div>'
        f'<script type="application/json" id="sources">{script_json(list(replays))}</script>'
    )
    left_out = [run.name for run in shown.runs[len(replays) :]]
    about = f"The page would be too large with the {' and the '.join(left_out)} run, too." if left_out else ""
    assert facts.headline is not None  # noqa: S101 - there are runs of the winner
    is_front = bool(shown.runs[0].scores)
    where = note(
        "Each design of the front on the same instance: its scores by each objective."
        if is_front
        else f"Median, best and worst of its runs {facts.headline.where}."
    )
    made = facts.command("replay", file=facts.winner_file, options=["--seed", str(shown.runs[0].seed)])
    title = "The front at work" if is_front else "The winner at work"
    return section("replays", title, where, Html(player), note(about) if about else "", command=made)
