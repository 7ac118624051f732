"""Rows of cells as lines of text, differences as cells, and notes that fit a terminal."""

import textwrap
from collections.abc import Sequence
from operator import sub

from mercator_design.errors import excerpt, printable
from mercator_design.race.elimination.summary import Scores
from mercator_design.scores import ANY_SCORE, ScoreRange

_NOISE = 1e-9
"""Differences below this part of the largest score are rounding errors."""


def aligned(rows: Sequence[Sequence[object]]) -> list[str]:
    """A line for each row, columns as wide as their widest cell; None is empty."""
    texts = [["" if cell is None else excerpt(printable(str(cell))) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*texts, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in texts]


def narrowed(rows: Sequence[Sequence[object]], dispensable: Sequence[str], width: int | None) -> list[str]:
    """As `aligned`; while a line is wider than a width, dispensable columns are left out, by their names in row 0."""
    lines = aligned(rows)
    for name in dispensable:
        if width is not None and max(map(len, lines)) > width:
            rows = list(zip(*(column for column in zip(*rows, strict=True) if column[0] != name), strict=True))
            lines = aligned(rows)
    return lines


def difference(ours: Sequence[float], theirs: Sequence[float] | None = None, possible: ScoreRange = ANY_SCORE) -> str:
    """The mean difference of scores on the same instances, with half of its confidence interval.

    If the interval exceeds what differences can be, its larger half within that is shown.

    Args:
        ours: Scores. The text is empty for a single score.
        theirs: Other scores, in the same order of instances; None: `ours` are differences.
        possible: The range of the scores.
    """
    found = Scores(tuple(ours if theirs is None else map(sub, ours, theirs)), possible.differences)
    if (interval := found.confidence_interval) is None:
        return ""
    noise = _NOISE * max(map(abs, [*ours, *(theirs or ())]))
    mean, half = (
        figure if abs(figure) > noise else 0.0
        for figure in (found.mean, max(found.mean - interval[0], interval[1] - found.mean))
    )
    return f"{mean:+.3g} ± {half:.2g}"


def with_notes_wrapped(page: str, width: int | None) -> str:
    """Wrap the notes of a page.

    Args:
        page: Its lines; only notes are wrapped, not tables, commands and values.
        width: Width of a line [characters]; None: no wrapping.
    """
    if width is None:
        return page
    notes = textwrap.TextWrapper(width=max(width, 40), subsequent_indent=" " * 11, break_on_hyphens=False)
    return "\n".join(notes.fill(line) if line.startswith("Note ") else line for line in page.split("\n"))
