"""What an analysis of a race has found, as pages, tables and pictures."""

import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from mercator_design.analysis import Ablation
from mercator_design.files import write_bytes
from mercator_design.race.importance import Explanation, Importance
from mercator_design.race.summary import CONFIDENCE, Scores
from mercator_design.race.task import Task
from mercator_design.report.columns import aligned

_ALPHA = 0.05


def importance_page(task: Task[Any], explanation: Explanation) -> str:
    """What a race tells of its parameters or modules, as text."""
    rows: list[tuple[object, ...]] = [("", "share of variance", f"at {CONFIDENCE:.0%}", "active in", "favours", "gain")]
    rows += [
        (
            one.name,
            f"{one.share:.1%}",
            f"{one.low:.1%} to {one.high:.1%}",
            f"{one.active:.0%}",
            _value(one),
            f"{one.gain:.3g}",
        )
        for one in explanation.parameters
    ]
    return "\n".join(
        [
            f"{task.name}: from {explanation.configurations} configurations that were raced, "
            f"{max(explanation.explained, 0.0):.0%} of the variance between new ones can be predicted",
            *([] if explanation.explained > 0 else ["Note       so nothing can be said of what matters"]),
            "",
            *aligned(rows),
            "",
        ]
    )


def importance_csv(_: Task[Any], explanation: Explanation) -> str:
    """The same as CSV: name, share, low, high, active, favours, gain."""
    names = Importance.__slots__
    return _csv([names, *([getattr(one, name) for name in names] for one in explanation.parameters)])


def _value(one: Importance) -> str:
    return one.favours if isinstance(one.favours, str) else f"{one.favours:.3g}"


def ablation_page(ablation: Ablation) -> str:
    """A path of changes as text, and what is left of the start as far as no difference was found."""
    rows: list[tuple[object, ...]] = [("step", "change", "mean", f"at {CONFIDENCE:.0%}", "against the start", "p")]
    for number, row in enumerate(_rows(ablation)):
        words, scores, difference, p_value = row
        low, high = scores.confidence_interval or (scores.mean, scores.mean)
        interval = f"{low:.4g} to {high:.4g}"
        if number == 0:
            rows.append((number, words, f"{scores.mean:.4g}", interval, None, None))
        else:
            half = (difference.confidence_interval or (0.0, difference.mean))[1] - difference.mean
            rows.append(
                (
                    number,
                    words,
                    f"{scores.mean:.4g}",
                    interval,
                    f"{difference.mean:+.3g} ± {half:.2g}",
                    f"{p_value:.2g}",
                )
            )
    same = 0
    while same + 1 < len(ablation.steps) and ablation.steps[same + 1].p_value >= _ALPHA:
        same += 1
    columns = ablation.task.columns(ablation.task.start(), [ablation.configurations[same]])
    runs = len(ablation.steps[0].costs)
    return "\n".join(
        [
            f"{ablation.task.name}: on {runs} fresh instances that no change was chosen on; p corrected for all steps",
            "",
            *aligned(rows),
            "",
            f"Up to step {same} no difference from the start was found; there it is",
            *(f"{name} = {value}" if len(columns) > 1 else str(value) for name, [value] in columns.items()),
            "",
        ]
    )


def ablation_csv(ablation: Ablation) -> str:
    """The same as CSV."""
    start = ablation.task.start()
    columns = ablation.task.columns(start, list(ablation.configurations))
    head = [
        "step",
        "change",
        "mean",
        "low",
        "high",
        "difference",
        "difference_low",
        "difference_high",
        "p_value",
        *columns,
    ]
    rows: list[list[object]] = [list(head)]
    for number, (words, scores, difference, p_value) in enumerate(_rows(ablation)):
        figures = [scores.mean, *(scores.confidence_interval or ("", ""))]
        apart = [difference.mean, *(difference.confidence_interval or ("", "")), p_value] if number else [""] * 4
        rows.append([number, words, *figures, *apart, *(column[number] for column in columns.values())])
    return _csv(rows)


def save_ablation(path: Path, ablation: Ablation) -> None:
    """Draw a path of changes: mean scores with their confidence intervals.

    Args:
        path: With the suffix .png or .svg, which says what is written.
        ablation: What to draw.

    Raises:
        OSError: It cannot be written.
    """
    from matplotlib.figure import Figure

    rows = list(_rows(ablation))
    figure = Figure(figsize=(7.0, 1.0 + 0.25 * len(rows)), layout="constrained")
    axes = figure.add_subplot()
    for number, (_, scores, _, p_value) in enumerate(rows):
        low, high = scores.confidence_interval or (scores.mean, scores.mean)
        error = [[scores.mean - low], [high - scores.mean]]
        filled = "tab:blue" if not p_value < _ALPHA else "white"
        axes.errorbar(scores.mean, number, xerr=error, fmt="o", color="tab:blue", mfc=filled, capsize=2.5)
    axes.set_yticks(range(len(rows)), [words for words, *_ in rows])
    axes.invert_yaxis()
    axes.grid(axis="x", linewidth=0.4)
    axes.set_xlabel(f"mean score at {CONFIDENCE:.0%}; hollow: differs from the start")
    axes.set_title(ablation.task.name)
    file = io.BytesIO()
    figure.savefig(file, format=path.suffix.lower()[1:], dpi=150)
    write_bytes(path, file.getvalue())


def _rows(ablation: Ablation) -> Iterable[tuple[str, Scores, Scores, float]]:
    """Of each step: the change, the scores, their differences from those of the start, and the p-value."""
    score = ablation.task.score
    first = [score(cost) for cost in ablation.steps[0].costs]
    for step in ablation.steps:
        scores = [score(cost) for cost in step.costs]
        apart = tuple(own - other for own, other in zip(scores, first, strict=True))
        yield step.change or ablation.start, Scores(tuple(scores)), Scores(apart), step.p_value


def _csv(rows: Iterable[Iterable[object]]) -> str:
    import csv

    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
