"""Which modules or parameters explain the scores, from the race's own experiments."""

import shlex

from mercator_design.analysis.analysis import importance as measured
from mercator_design.errors import RaceError
from mercator_design.race.racing.summary import CONFIDENCE
from mercator_design.report.page.facts import Facts
from mercator_design.report.page.markup import Html, command, figure, note, row_of, section
from mercator_design.view.charts import Axis, Dot, interval_chart

_MOST = 12


def importance(facts: Facts) -> Html:
    """The section of importance; it says so if the race was too small for it."""
    if facts.task is None:
        return Html()
    try:
        task, explanation = measured(facts.folder)
    except RaceError as error:
        return section("importance", "What matters", note(error.messages[0]))
    dots = [
        Dot(one.name.replace("_", " "), one.share, one.share - 1.96 * one.error, one.share + 1.96 * one.error)
        for one in explanation.parameters[:_MOST]
    ]
    what = "the number of each module in a PFSM" if facts.designer is not None else "each parameter"
    caption = (
        f"How much {what} explains of the differences between the {explanation.configurations} configurations that "
        f"were raced: share of the variance, with its interval of {CONFIDENCE:.0%}. In all, "
        f"{max(explanation.explained, 0.0):.0%} of it can be predicted. From the race's own experiments."
    )
    folder = shlex.quote(str(facts.folder))
    chart = figure(interval_chart(dots, Axis("share of the variance")), caption, f"mdesign runs importance {folder}")
    parts = note("Which states and transitions the winner needs is measured by more experiments:")
    ablation = f"<div>{parts}{command(f'mdesign runs ablation {folder}')}</div>" if facts.designer is not None else ""
    return section("importance", f"What matters on {task.name}", row_of(chart, ablation) if dots else "")
