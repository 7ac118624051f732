"""Importance: the modules or parameters that explain the scores, and the parts that the winner needs."""

from typing import Any

from mercator_design.errors import RaceError
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.fsm.text import to_text
from mercator_design.network.network import Network
from mercator_design.race.analysis.importance import Importance
from mercator_design.race.elimination.summary import ALPHA, CONFIDENCE
from mercator_design.race.session.task import Task
from mercator_design.results.analysis.importance import importance_of
from mercator_design.results.facts import Facts
from mercator_design.show.charts import Axis, Dot, interval_chart
from mercator_design.show.report.markup import Html, command, figure, made_by, note, p_text, row_of, section
from mercator_design.show.text.analysis import ABLATION, read_ablation
from mercator_design.tree.tree import Tree

_MAX_SHOWN = 12
_NORMAL = 1.96  # standard errors of half an interval


def importance(facts: Facts) -> Html:
    """The section on importance, or a note that the race was too small for it."""
    if facts.task is None:
        return Html()
    explained, taken_apart = _importance(facts, facts.task), _ablation(facts)
    parts = row_of(explained, taken_apart) if taken_apart else Html(f'<div class="narrow">{explained}</div>')
    return section("importance", "What matters", parts)


def _importance(facts: Facts, task: Task[Any]) -> Html:
    try:
        explanation = importance_of(task, facts.record)
    except RaceError as error:
        return note(error.messages[0])
    dots = [_dot(one) for one in explanation.parameters[:_MAX_SHOWN]]
    if not dots:
        return Html()
    software = None if facts.best is None else facts.software(facts.best)
    what = "the number of each module in a PFSM" if isinstance(software, Pfsm) else "each parameter"
    caption = (
        f"How much {what} explains of the differences between the {explanation.configurations} configurations that "
        f"were raced: share of the variance, with its interval of {CONFIDENCE:.0%}. In all, "
        f"{max(explanation.explained, 0.0):.0%} of it can be predicted. From the race's own experiments."
    )
    if isinstance(software, Tree):
        caption += " C0x0 is the condition of branch 0, A0 its action; the others are parameters of these."
    if isinstance(software, Network):
        caption += " left1 is the weight from the first input to the left wheel."
    chart = interval_chart(dots, Axis("share of the variance"))
    return Html(f"<div>{figure(chart, caption)}{made_by(facts.command('runs', 'importance'))}</div>")


def _dot(one: Importance) -> Dot:
    half = _NORMAL * one.error
    return Dot(one.name.replace("_", " "), one.share, max(0.0, one.share - half), min(1.0, one.share + half))


def _ablation(facts: Facts) -> Html:
    """The scores of the winner without its parts, if they were measured; else the command that measures them."""
    pfsm = None if facts.best is None or not facts.view.is_complete else facts.pfsm(facts.best)
    if pfsm is None or (facts.mission is not None and facts.mission.is_ranked_by_all):  # an ablation needs one cost
        return Html()
    verb = facts.command("runs", "ablation")
    rows = read_ablation(facts.folder / ABLATION, to_text(pfsm))
    if not rows:
        about = note("Which states and transitions the winner needs is measured by more experiments:")
        return Html(f"<div>{about}{command(verb)}</div>")
    dots = [
        Dot(
            row.change,
            row.mean,
            row.low,
            row.high,
            remark="" if row.p_value is None else p_text(row.p_value),
            colour=int(row.p_value is not None and row.p_value < ALPHA),
        )
        for row in rows
    ]
    caption = (
        "The winner taken apart, on fresh instances: each row is without the parts of the rows above it, too. Mean "
        f"score and interval of {CONFIDENCE:.0%}; p: of no difference from the winner."
    )
    return Html(f"<div>{figure(interval_chart(dots, Axis(facts.score_name)), caption)}{made_by(verb)}</div>")
