"""Notched boxes of designs as SVG: a row for each level, in one colour, with every design as a point."""

from collections.abc import Sequence

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.scores import ANY_SCORE, ScoreRange
from mercator_design.show.charts import Axis, Dot, interval_chart
from mercator_design.show.study.verdicts import named, place_of
from mercator_design.studies.analysis import StudyResults
from mercator_design.studies.statistics.comparison import relative_ranks
from mercator_design.studies.statistics.effects import notch
from mercator_design.studies.table import Block, StudyTable

RANK_AXIS = Axis("relative rank among the designs of a mission (0: best)", low=0.0, high=1.0)
BOXES = (
    "Box: quartiles and median; points: designs; waist and line: the notch, 1.57 interquartile ranges / sqrt(n) around "
    "the median. If the notches of two do not overlap, their medians differ at about 5 %, not corrected for the number "
    "of comparisons. A waist ends with its box."
)
"""What a box shows, for a caption."""


def box(name: str, values: Floats, colour: int, possible: ScoreRange = ANY_SCORE) -> Dot:
    """A row of a chart of boxes."""
    low, middle, high = np.percentile(values, [25, 50, 75]).tolist()
    start, end = possible.clipped(*notch(values))
    quartiles = (low, middle, high) if len(values) > 1 else None
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


def ranks_by_level(table: StudyTable, blocks: Sequence[Block]) -> dict[str, Floats]:
    """The relative ranks of all designs of each level, over all blocks that have two levels."""
    several = [relative_ranks(block) for block in blocks if len(block.scores) > 1]
    found = {level: [ranks[level] for ranks in several if level in ranks] for level in table.levels}
    return {level: np.concatenate(parts) for level, parts in found.items() if parts}


def chart_of_ranks(results: StudyResults) -> str:
    """The relative ranks of all designs; empty if nothing is compared."""
    table = results.table
    ranks = ranks_by_level(table, table.blocks(results.findings.reality))
    colours = {level: k for k, level in enumerate(table.levels)}
    possible = ScoreRange(0.0, 1.0)
    rows = [box(named(table, level), found, colours[level], possible) for level, found in ranks.items()]
    return interval_chart(rows, RANK_AXIS) if rows else ""


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
