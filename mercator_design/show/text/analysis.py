"""The results of an analysis as text, tables and pictures."""

import csv
import math
from collections.abc import Iterator
from operator import sub
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

from mercator_design.errors import RaceError
from mercator_design.fsm.space.grammar import module_of
from mercator_design.race.analysis.importance import Explanation, Importance
from mercator_design.race.elimination.summary import ALPHA, CONFIDENCE, Scores
from mercator_design.race.session.task import Task
from mercator_design.results.analysis.ablation import Ablation
from mercator_design.show.text.columns import aligned, difference
from mercator_design.system.csv_text import csv_text
from mercator_design.system.files import Unreadable, read_small

ABLATION = "ablation.csv"
"""The path of removals from a winner, in its run folder."""
_MAX_SHOWN = 20
"""Maximum number of parameters on a page."""
_COLOUR = "#0072b2"
_MAX_SIZE = 1024 * 1024  # bytes of a table
_WIDE = 120
"""Width of all columns of an ablation [characters]."""


def importance_page(task: Task[Any], explanation: Explanation) -> str:
    """The importance of parameters or modules, as text."""
    flavour = task.start().get("flavour")
    rows: list[tuple[object, ...]] = [("", "share of variance", "active in", "favours", "gain")]
    rows += [
        (
            one.name,
            f"{one.share:.1%} ± {one.error:.1%}",
            f"{one.active:.0%}",
            _value(flavour, one),
            f"{one.gain:.3g}",
        )
        for one in explanation.parameters[:_MAX_SHOWN]
    ]
    others = explanation.parameters[_MAX_SHOWN:]
    return "\n".join(
        [
            f"{task.name}: from {explanation.configurations} configurations that were raced, "
            f"{max(explanation.explained, 0.0):.0%} of the variance between new ones can be predicted",
            *(
                []
                if explanation.explained > 0
                else ["Note       no better than the mean: there are too few results for exact shares"]
            ),
            "",
            *aligned(rows),
            *([f"and {len(others)} more, of at most {others[0].share:.1%}: --csv has all"] if others else []),
            "",
        ]
    )


def importance_csv(explanation: Explanation) -> str:
    """The same as CSV: name, share, error, active, favours, gain."""
    names = Importance.__slots__
    return csv_text([names, *([getattr(one, name) for name in names] for one in explanation.parameters)])


def _value(flavour: str | None, one: Importance) -> str:
    if not isinstance(one.favours, str):
        return f"{one.favours:.3g}"
    if flavour is not None:
        return f"{one.favours} ({module_of(one.name, one.favours, flavour).name})"
    return one.favours


def ablation_page(ablation: Ablation, width: int | None = None) -> str:
    """A path of changes as text, with the last step before one that is significantly worse.

    Args:
        ablation: The result of the ablation.
        width: Width of a line; below 120 characters there is no column of differences from the step before.
    """
    rows: list[tuple[object, ...]] = [
        ("step", "change", "mean", f"at {CONFIDENCE:.0%}", "against the step before", "against the start", "p")
    ]
    steps = list(_rows(ablation))
    for number, row in enumerate(steps):
        low, high = row.scores.interval
        cells = (number, row.change, f"{row.scores.mean:.4g}", f"{low:.4g} to {high:.4g}")
        before = [steps[max(number - 1, 0)], steps[0]]
        against = [difference(row.scores.values, one.scores.values, row.scores.possible) for one in before]
        rows.append((*cells, *((*against, f"{row.p_value:.2g}") if number else (None, None, None))))
    if width is not None and width < _WIDE:
        rows = [(*row[:4], *row[5:]) for row in rows]
    return "\n".join(
        [
            f"{ablation.task.name}: on {len(ablation.steps[0].costs)} fresh instances that no change was chosen on; "
            "p: of no difference from the start, corrected for all steps",
            "",
            *aligned(rows),
            *(_what_suffices(ablation) if ablation.simplifies else []),
            "",
        ]
    )


def _what_suffices(ablation: Ablation) -> list[str]:
    """The last step before one that is significantly worse than the start."""
    steps, mean = ablation.steps, fmean(ablation.steps[0].costs)
    worse = (number for number, step in enumerate(steps) if step.p_value < ALPHA and fmean(step.costs) > mean)
    last = next(worse, len(steps)) - 1
    columns = ablation.task.columns(ablation.task.start(), [ablation.configurations[last]])
    return [
        "",
        f"The last step that is not significantly worse than the winner is step {last}:",
        *(str(value) for [value] in columns.values()),
    ]


def ablation_csv(ablation: Ablation) -> str:
    """The same as CSV."""
    columns = ablation.task.columns(ablation.task.start(), list(ablation.configurations))
    against = ("difference", "difference_low", "difference_high", "p_value")
    rows: list[list[object]] = [["step", "change", "mean", "low", "high", *against, *columns]]
    for number, row in enumerate(_rows(ablation)):
        interval = row.against_start.confidence_interval or ("", "")
        apart = [row.against_start.mean, *interval, row.p_value] if number else [""] * len(against)
        rows.append(
            [
                number,
                row.change,
                row.scores.mean,
                *row.scores.interval,
                *apart,
                *(column[number] for column in columns.values()),
            ]
        )
    return csv_text(rows)


class AblationRow(NamedTuple):
    """A step of a path, as `ablation_csv` writes it."""

    change: str
    mean: float
    low: float
    high: float
    p_value: float | None  # None for the start


def read_ablation(path: Path, fsm: str) -> list[AblationRow]:
    """The path of removals from a PFSM, from its CSV; empty if there is none, or it is of another PFSM.

    Raises:
        RaceError: It is damaged.
    """
    if not path.exists():
        return []
    try:
        rows = list(csv.DictReader(read_small(path, _MAX_SIZE).decode().splitlines()))
        found = [
            AblationRow(
                change=row["change"],
                mean=_finite(row["mean"]),
                low=_finite(row["low"]),
                high=_finite(row["high"]),
                p_value=_finite(row["p_value"]) if row["p_value"] else None,
            )
            for row in rows
        ]
        return found if rows and rows[0]["fsm"] == fsm else []
    except (Unreadable, ValueError, KeyError, TypeError, csv.Error) as error:
        expected = "expected the table of mdesign runs ablation, found another"
        raise RaceError(f"{path}: {expected}: {error}; delete it to go on without it") from None


def _finite(text: str) -> float:
    if not math.isfinite(value := float(text)):
        raise ValueError(f"expected a number, found {text}")
    return value


def save_ablation(path: Path, ablation: Ablation, *, caption: str) -> None:
    """Draw a path of changes: mean scores with their confidence intervals, with a caption below.

    The suffix of the path, .png or .svg, is the format.

    Raises:
        OSError: The picture cannot be written.
    """
    from matplotlib.figure import Figure

    from mercator_design.show.pictures.figures import house_style, save_figure

    rows = list(_rows(ablation))
    with house_style():
        figure = Figure(figsize=(6.0, 0.8 + 0.2 * len(rows)), layout="constrained")
        axes = figure.add_subplot()
        for number, row in enumerate(rows):
            low, high = row.scores.interval
            error = [[row.scores.mean - low], [high - row.scores.mean]]
            inside = "white" if row.p_value < ALPHA else _COLOUR
            axes.errorbar(row.scores.mean, number, xerr=error, fmt="o", ms=4, color=_COLOUR, mfc=inside, capsize=2)
        axes.set_yticks(range(len(rows)), [row.change for row in rows])
        axes.invert_yaxis()
        axes.grid(axis="x", linewidth=0.4)
        axes.set_xlabel(f"mean score, interval of {CONFIDENCE:.0%}; hollow: differs from the start")
        what = "the winner taken apart" if ablation.simplifies else f"from {ablation.start} to the winner"
        axes.set_title(f"{ablation.task.name}: {what}, n={len(rows[0].scores.values)}")
        save_figure(path, figure, caption)


class _Row(NamedTuple):
    """A step, in scores."""

    change: str
    scores: Scores
    against_start: Scores
    p_value: float


def _rows(ablation: Ablation) -> Iterator[_Row]:
    task, possible = ablation.task, ablation.task.possible_scores
    table = [[task.score(cost) for cost in step.costs] for step in ablation.steps]
    for step, own in zip(ablation.steps, table, strict=True):
        yield _Row(
            change=step.change or ablation.start,
            scores=Scores(tuple(own), possible),
            against_start=Scores(tuple(map(sub, own, table[0])), possible.differences),
            p_value=step.p_value,
        )
