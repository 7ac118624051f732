"""Notched boxes of designs as SVG: a row for each level, in one colour, with every design as a point.

A box looks as in the figures (`figures.py`), turned: whiskers to the extremes, a waist, a bold median, hollow marks for
other realities than the design model.
"""

from collections.abc import Iterator

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.scores import ANY_SCORE, ScoreRange
from mercator_design.show.charts import Axis, ChartFrame, Dot, colour_of, interval_chart
from mercator_design.show.study.verdicts import named, place_of
from mercator_design.studies.analysis import StudyResults
from mercator_design.studies.statistics.comparison import ranks_by_objective
from mercator_design.studies.statistics.effects import notch
from mercator_design.studies.table import Block, StudyTable

RANK = "relative rank in a mission (0: best)"
ONE_OBJECTIVE = "missions with one objective"
MIN_BOXED = 5
"""Designs of which quartiles say something."""
MIN_NOTCHED = 10
"""Designs from which on scores have a notch: with fewer it holds the median too seldom, and is longer than its box."""
BOXES = (
    "Box: quartiles and median; whiskers: extremes; points: designs. Fewer than five designs have a median and no box."
)
"""What a box shows, for a caption."""
NOTCHES = (
    f" Waist, from {MIN_NOTCHED} designs on: the notch, 1.57 interquartile ranges / sqrt(n) around the median. If the "
    "notches of two do not overlap, their medians differ at about 5 %, not corrected for the number of comparisons. A "
    "waist ends with its box."
)
"""What is said of boxes of scores, too; ranks are bounded and depend on each other, so they have no notches."""


_MAX_TITLE = 60
"""Letters of the title of an axis; the rest is cut."""
_HALF, WIDE = 8.0, 0.62
"""Half of the width of a box; its width in distances of boxes."""


def box(
    name: str,
    values: Floats,
    colour: int,
    possible: ScoreRange = ANY_SCORE,
    *,
    is_elsewhere: bool = False,
    has_notch: bool = True,
) -> Dot:
    """A row of a chart of boxes."""
    low, middle, high = np.percentile(values, [25, 50, 75]).tolist()
    is_boxed = len(values) >= MIN_BOXED
    has_notch = has_notch and len(values) >= MIN_NOTCHED
    start, end = possible.clipped(*notch(values)) if has_notch else (middle, middle)
    quartiles = (low, middle, high) if is_boxed else None
    return Dot(name, middle, start, end, values.tolist(), f"n = {len(values)}", colour, quartiles, is_elsewhere)


def _mark(frame: ChartFrame, row: Dot, y: float) -> Iterator[str]:
    """A box with its waist, whiskers and median, and its designs."""
    colour = colour_of(row.colour)
    low, middle, high = (frame.at(value, 0.0)[0] for value in (row.low, row.middle, row.high))
    top, bottom, drawn, reach = y - _HALF, y + _HALF, "", _HALF
    if row.quartiles is not None:
        lower, _, upper = (frame.at(value, 0.0)[0] for value in row.quartiles)
        least, most = (frame.at(value, 0.0)[0] for value in (min(row.values), max(row.values)))
        a, b = max(low, lower), min(high, upper)
        reach = _HALF / 2 if row.low < row.high else _HALF
        drawn = (
            f'<path d="M{lower:.1f} {top:.1f}H{a:.1f}L{middle:.1f} {y - reach:.1f}L{b:.1f} {top:.1f}H{upper:.1f}'
            f"V{bottom:.1f}H{b:.1f}L{middle:.1f} {y + reach:.1f}L{a:.1f} {bottom:.1f}H{lower:.1f}z"
            f"M{lower:.1f} {y:.1f}H{least:.1f}M{upper:.1f} {y:.1f}H{most:.1f}"
            f'M{least:.1f} {y - 4:.1f}v8M{most:.1f} {y - 4:.1f}v8" '
            f'fill="{colour}" fill-opacity="{0.08 if row.is_pale else 0.28}" stroke="{colour}"/>'
        )
    drawn += f'<path d="M{middle:.1f} {y - reach:.1f}v{2 * reach:.0f}" stroke="{colour}" stroke-width="2"/>'
    yield drawn
    for value, aside in zip(row.values, moved_aside(np.array(row.values)), strict=True):
        yield (
            f'<circle cx="{frame.at(value, 0.0)[0]:.1f}" cy="{y + 2 * _HALF / WIDE * aside:.1f}" r="2.2" '
            f'fill="{"none" if row.is_pale else colour}" fill-opacity=".75" stroke="{colour}" stroke-width=".7"/>'
        )


def moved_aside(values: Floats) -> Floats:
    """How far each point is moved aside, so that points of near values do not hide each other [distances of boxes].

    The mean is 0: few points lie on both sides of the middle.
    """
    order = np.argsort(np.argsort(values, kind="stable"), kind="stable")
    aside: Floats = np.array([-0.16, 0.08, -0.08, 0.16, 0.0])[order % 5]
    centred: Floats = aside - aside.mean()
    return centred


def chart_of_scores(table: StudyTable, block: Block) -> str:
    """The designs of a block."""
    colours = {level: k for k, level in enumerate(table.levels)}
    rows = [
        box(named(table, level), scores.to_numpy(float), colours[level], block.possible)
        for level, scores in block.scores.items()
    ]
    return interval_chart(rows, score_axis(block), _mark)


def score_axis(block: Block) -> Axis:
    """The axis of the scores of a block."""
    direction = "maximised" if block.possible.maximise else "minimised"
    whole = f"{block.name}: score, {direction}"
    return Axis(whole if len(whole) <= _MAX_TITLE else f"{block.name}, {direction}")


def charts_of_ranks(results: StudyResults) -> list[str]:
    """The relative ranks of all designs, a chart for each objective; none if nothing is compared."""
    table = results.table
    colours = {level: k for k, level in enumerate(table.levels)}
    found = ranks_by_objective(table, table.blocks(results.findings.reality))
    return [
        interval_chart(
            [box(named(table, level), ranks, colours[level], has_notch=False) for level, ranks in by_level.items()],
            Axis(
                f"{objective or ONE_OBJECTIVE}: relative rank (0: best)" if len(found) > 1 else RANK, low=0.0, high=1.0
            ),
            _mark,
        )
        for objective, by_level in found.items()
    ]


def chart_of_realities(table: StudyTable, name: str) -> str:
    """The designs of a block in each reality, level by level."""
    colours = {level: k for k, level in enumerate(table.levels)}
    found = {
        (level, reality): (block, scores)
        for reality in table.realities
        for block in table.blocks(reality)
        if block.name == name
        for level, scores in block.scores.items()
    }
    rows = [
        box(
            f"{named(table, level)}, {place_of(reality)}",
            scores.to_numpy(float),
            colours[level],
            block.possible,
            is_elsewhere=reality != table.realities[0],
        )
        for (level, reality), (block, scores) in sorted(found.items(), key=lambda item: colours[item[0][0]])
    ]
    block, _ = next(iter(found.values()))
    return interval_chart(rows, score_axis(block), _mark)
