"""Notched boxes of designs as SVG: a row for each level, in one colour, with every design as a point."""

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.scores import ANY_SCORE, ScoreRange
from mercator_design.show.charts import Axis, Dot, interval_chart
from mercator_design.show.study.verdicts import named, place_of
from mercator_design.studies.analysis import StudyResults
from mercator_design.studies.statistics.comparison import ranks_by_objective
from mercator_design.studies.statistics.effects import notch
from mercator_design.studies.table import Block, StudyTable

RANK = "relative rank among the designs of a mission (0: best)"
ONE_OBJECTIVE = "missions with one objective"
BOXES = (
    "Box: quartiles and median; points: designs; waist and line: the notch, 1.57 interquartile ranges / sqrt(n) around "
    "the median. If the notches of two do not overlap, their medians differ at about 5 %, not corrected for the number "
    "of comparisons. A waist ends with its box. Fewer than five designs have a median and no box."
)
"""What a box shows, for a caption."""
MIN_BOXED = 5
"""Designs of which quartiles and notches say something."""


def box(name: str, values: Floats, colour: int, possible: ScoreRange = ANY_SCORE) -> Dot:
    """A row of a chart of boxes."""
    low, middle, high = np.percentile(values, [25, 50, 75]).tolist()
    is_boxed = len(values) >= MIN_BOXED
    start, end = possible.clipped(*notch(values)) if is_boxed else (middle, middle)
    quartiles = (low, middle, high) if is_boxed else None
    return Dot(name, middle, start, end, values.tolist(), f"n = {len(values)}", colour, quartiles, is_notched=True)


def chart_of_scores(table: StudyTable, block: Block) -> str:
    """The designs of a block."""
    colours = {level: k for k, level in enumerate(table.levels)}
    rows = [
        box(named(table, level), scores.to_numpy(float), colours[level], block.possible)
        for level, scores in block.scores.items()
    ]
    return interval_chart(rows, score_axis(block))


def score_axis(block: Block) -> Axis:
    """The axis of the scores of a block."""
    return Axis(f"{block.name}: score, {'maximised' if block.possible.maximise else 'minimised'}")


def charts_of_ranks(results: StudyResults) -> list[str]:
    """The relative ranks of all designs, a chart for each objective; none if nothing is compared."""
    table = results.table
    colours = {level: k for k, level in enumerate(table.levels)}
    possible = ScoreRange(0.0, 1.0)
    found = ranks_by_objective(table, table.blocks(results.findings.reality))
    return [
        interval_chart(
            [box(named(table, level), ranks, colours[level], possible) for level, ranks in by_level.items()],
            Axis(f"{objective or ONE_OBJECTIVE}: {RANK}" if len(found) > 1 else RANK, low=0.0, high=1.0),
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
        box(f"{named(table, level)}, {place_of(reality)}", scores.to_numpy(float), colours[level], block.possible)
        for (level, reality), (block, scores) in sorted(found.items(), key=lambda item: colours[item[0][0]])
    ]
    block, _ = next(iter(found.values()))
    return interval_chart(rows, score_axis(block))
