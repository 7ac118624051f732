"""The iterations of a race as a table; the race may be running."""

from collections.abc import Sequence
from itertools import accumulate

from mercator_design.race.elimination.stagnation import stagnates
from mercator_design.race.elimination.summary import Scores
from mercator_design.race.session.events import IterationEnded
from mercator_design.race.session.record import Record
from mercator_design.race.session.view import Incumbent, RaceView
from mercator_design.scores import ANY_SCORE, ScoreRange
from mercator_design.show.charts import ChartLine, number
from mercator_design.show.text.columns import aligned, difference

FEW = 4
"""Scores whose interval a chart shows, at least."""
_FIRST, _LAST = 10, 20
"""Numbers of iterations that are shown, if there are more."""
COLUMNS = ("iteration", "budget", "used", "raced", "instances", "alive", "best", "race mean", "runs")
_HEAD = (*COLUMNS, "against the best before")


def best_line(name: str, found: Sequence[Incumbent], possible: ScoreRange) -> ChartLine:
    """The mean of the best of each iteration over the experiments until its end, with its interval.

    Fewer scores than FEW have intervals so wide that little else would be seen: these are cut off.
    """
    ends = accumulate(one.ended.used for one in found)
    points = [
        (end, Scores(tuple(one.scores.values()), possible)) for end, one in zip(ends, found, strict=True) if one.scores
    ]
    x, y = [end for end, _ in points], [of.mean for _, of in points]
    usual = [*y, *(value for _, of in points if len(of.values) >= FEW for value in of.interval)]
    low, high = min(usual, default=0.0), max(usual, default=0.0)
    bands = [(max(of.interval[0], low), min(of.interval[1], high)) for _, of in points]
    return ChartLine(name, x, y, [low for low, _ in bands], [high for _, high in bands])


def iterations_table(view: RaceView, possible: ScoreRange = ANY_SCORE) -> list[str]:
    """A line for each iteration that has ended.

    The mean in the race is that of the best configuration over the runs that it had by the end of the iteration. The
    last column is the mean difference to the best of the iteration before, on the instances that both have seen by
    then, with its confidence interval.
    """
    rows: list[tuple[object, ...]] = [
        _HEAD,
        *((*iteration_cells(one), _difference(one, possible)) for one in view.incumbents),
    ]
    if len(rows) > 1 + _FIRST + _LAST:
        rows[1 + _FIRST : -_LAST] = [("...", *[None] * (len(_HEAD) - 1))]
    return aligned(rows)


def iteration_notes(record: Record) -> list[str]:
    """The notes of iterations, a line each, after one on the last gain."""
    notes = [f"Note       iteration {one.iteration}: {one.note}" for one in record.view.iterations if one.note]
    return [f"Gain       {found}", *notes] if (found := last_gain(record)) else notes


def last_gain(record: Record) -> str:
    """From when on a race has gained nothing, and what its early end has saved; empty if its last iteration gained.

    The comparison of elites at the end of a race counts as no iteration.
    """
    view, raced = record.view, [one for one in record.view.iterations if not one.postselection]
    if not raced or not (n := raced[-1].stagnant):
        return ""
    idle = sum(one.used for one in raced[-n:])
    found = f"none since iteration {raced[-n - 1].iteration} of {len(raced)}: {idle} experiments"
    stops = view.is_complete and record.start.get("options", {}).get("stop_when_stagnant", False)
    if stops and stagnates(raced, view.budget):
        found += f"; the race stopped there, which saved {view.budget - view.n_experiments} of {view.budget}"
    return found


def iteration_cells(incumbent: Incumbent) -> tuple[object, ...]:
    """An iteration in a table: its name, its counts, its best, and the best's mean and number of scores."""
    ended, own = incumbent.ended, Scores(tuple(incumbent.scores.values()))
    numbers = (ended.budget, ended.used, ended.configurations, ended.instances, ended.alive, ended.elites[0])
    return (iteration_name(ended), *numbers, number(own.mean) if own.values else None, len(own.values))


def iteration_name(ended: IterationEnded) -> str:
    """The number of an iteration; that of the last comparison is "final"."""
    return "final" if ended.postselection else str(ended.iteration)


def _difference(incumbent: Incumbent, possible: ScoreRange) -> str:
    scores, before = incumbent.scores, incumbent.before
    if before is None:
        return "" if incumbent.ended.iteration == 1 else "the same"
    common = sorted(scores.keys() & before.keys())
    found = difference([scores[one] for one in common], [before[one] for one in common], possible)
    return f"{found} (n={len(common)})" if found else ""
