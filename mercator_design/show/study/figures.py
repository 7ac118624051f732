"""The figures of a study for a paper: boxes of the width of a column (80 mm, as of LaTeX's article), as PDF and PNG.

One colour and one mark for each level, in all figures: the colours of Okabe and Ito, which colour-blind people can
distinguish. Letters are embedded as TrueType, as publishers demand.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from mercator_design.arrays import Floats
from mercator_design.errors import printable
from mercator_design.scores import ScoreRange
from mercator_design.show.charts import COLOURS
from mercator_design.show.pictures.figures import house_style, save_figure
from mercator_design.show.study.boxes import MIN_BOXED, MIN_NOTCHED, ONE_OBJECTIVE, WIDE, moved_aside
from mercator_design.show.study.verdicts import named, place_of
from mercator_design.studies.analysis import StudyResults
from mercator_design.studies.statistics.comparison import ranks_by_objective
from mercator_design.studies.statistics.effects import notch
from mercator_design.studies.table import Block, StudyTable

WIDTH = 80.0 / 25.4
"""Width of a column [inches]."""
SUFFIXES = (".pdf", ".png")
MAX_AXES = 12
"""Axes of a figure; more missions have several figures."""
_MARKS = "osD^vP*X"
_ROW, _LEGEND = 1.25, 0.16
"""Heights of a row of axes, and of a line of the legend [inches]."""
_LETTERS = 60
"""Letters that the width of a figure has space for, in a title of 7 points."""
_MIN_SIZE = 5.0
"""Points of the smallest letters."""
_DPI = 300
_STYLE = {"font.size": 7.0, "pdf.fonttype": 42, "axes.titlesize": 7.0, "xtick.labelsize": 6.5, "ytick.labelsize": 6.5}


class DrawnBox(NamedTuple):
    """Designs to draw: their level, their place on the axis, and whether they are in another reality."""

    level: str
    place: float
    values: Floats
    is_elsewhere: bool = False


def save_figures(folder: Path, results: StudyResults) -> list[Path]:
    """Write the figures of a study to a folder, and return their paths.

    Raises:
        OSError: A figure cannot be written.
    """
    table = results.table
    blocks = table.blocks(results.findings.reality)
    with house_style(), mpl.rc_context(_STYLE):  # type: ignore[arg-type]
        figures = {
            f"scores{suffix}": _of_blocks(table, part, results.findings.reality) for suffix, part in _parts(blocks)
        }
        if ranks := ranks_by_objective(table, blocks):
            figures["ranks"] = _of_ranks(table, ranks)
        if len(table.realities) > 1:
            figures |= {f"gap{suffix}": _of_blocks(table, part, *table.realities) for suffix, part in _parts(blocks)}
        paths = [folder / f"{name}{suffix}" for name in figures for suffix in SUFFIXES]
        for path in paths:
            save_figure(path, figures[path.stem], dpi=_DPI)
    return paths


def _parts(blocks: Sequence[Block]) -> list[tuple[str, Sequence[Block]]]:
    """Blocks of a figure each, with the ends of the figures' names."""
    parts = [blocks[k : k + MAX_AXES] for k in range(0, len(blocks), MAX_AXES)]
    return [(f"-{k}" if len(parts) > 1 else "", part) for k, part in enumerate(parts, start=1)]


def _of_blocks(table: StudyTable, blocks: Sequence[Block], *realities: str) -> Figure:
    """Axes for each block; with several realities, those of a level are side by side."""
    columns = min(2, len(blocks))
    rows = -(-len(blocks) // columns)
    figure, legend = _figure(
        table, _ROW * rows + 0.2 * (len(realities) > 1) + 0.12 * rows * any(block.setting for block in blocks)
    )
    signs = dict(zip(realities, "MABCDEFGHIJKLNOPQRSTUVWXYZ" + " " * len(realities), strict=False))
    there = {reality: {block.name: block for block in table.blocks(reality)} for reality in realities}
    for k, block in enumerate(blocks):
        last = rows * columns if k + 1 == len(blocks) else k + 1  # which fills its row
        axes = figure.add_subplot(rows, columns, (k + 1, last))
        boxes = [
            DrawnBox(level, place, found.scores[level].to_numpy(float), reality != realities[0])
            for level, reality, place in _places(table.levels, realities)
            if (found := there[reality].get(block.name)) is not None and level in found.scores
        ]
        _draw(axes, table, boxes, block.possible)
        lines = [printable(line) for line in (block.mission, block.setting) if line]
        size = min(7.0, 7.0 * _LETTERS / columns / max(map(len, lines)))
        axes.set_title("\n".join(lines), pad=3.0, fontsize=size)
        if not block.possible.maximise:
            axes.set_ylabel("score (minimised)", labelpad=2.0)
        elif k % columns == 0:
            axes.set_ylabel("score (maximised)", labelpad=2.0)
        if len(realities) == 1:
            _name_levels(axes, table, boxes, _LETTERS / columns)
        else:
            places = _places(table.levels, realities)
            axes.set_xticks([place for _, _, place in places], [signs[reality] for _, reality, _ in places])
    if len(realities) > 1:
        figure.supxlabel(", ".join(f"{sign}: {place_of(name)}" for name, sign in signs.items()), fontsize=6.5)
    figure.legend(
        handles=legend, loc="outside upper center", ncols=3, frameon=False, handletextpad=0.3, columnspacing=1.0
    )
    return figure


def _of_ranks(table: StudyTable, ranks: Mapping[str, Mapping[str, Floats]]) -> Figure:
    """Axes for each objective."""
    figure, legend = _figure(table, 1.7 * len(ranks))
    for k, (objective, by_level) in enumerate(ranks.items()):
        axes = figure.add_subplot(len(ranks), 1, k + 1)
        boxes = [
            DrawnBox(level, place, by_level[level])
            for level, _, place in _places(table.levels, ("",))
            if level in by_level
        ]
        _draw(axes, table, boxes, None)
        _name_levels(axes, table, boxes, _LETTERS)
        axes.set_title(printable(objective) if objective or len(ranks) == 1 else ONE_OBJECTIVE, pad=3.0)
        axes.set_ylabel("relative rank in a mission\n(0: best)", labelpad=2.0)
        axes.set_ylim(1.03, -0.03)
    figure.legend(
        handles=legend, loc="outside upper center", ncols=3, frameon=False, handletextpad=0.3, columnspacing=1.0
    )
    return figure


def _name_levels(axes: Axes, table: StudyTable, boxes: Sequence[DrawnBox], letters: float) -> None:
    """Names below boxes, if axes as wide as these letters of 7 points have space; else the legend tells."""
    names = [printable(named(table, box.level)) for box in boxes]
    size = 7.0 * 0.85 * letters / len(boxes) / max(map(len, names))
    if size >= _MIN_SIZE:
        axes.set_xticks([box.place for box in boxes], names, fontsize=min(6.5, size))


def _places(levels: Sequence[str], realities: Sequence[str]) -> list[tuple[str, str, float]]:
    """The place of each level and reality on the axis: realities of a level are neighbours."""
    step = len(realities) + (0.6 if len(realities) > 1 else 0.0)
    return [(level, reality, step * k + j) for k, level in enumerate(levels) for j, reality in enumerate(realities)]


def _figure(table: StudyTable, height: float) -> tuple[Figure, list[Line2D]]:
    """An empty figure with space for its legend, and the marks of that."""
    handles = [
        Line2D(
            [],
            [],
            color=_colour(k),
            marker=_MARKS[k % len(_MARKS)],
            markersize=3.5,
            linestyle="",
            label=printable(named(table, level)),
        )
        for k, level in enumerate(table.levels)
    ]
    lines = -(-len(handles) // 3)
    return Figure(figsize=(WIDTH, height + _LEGEND * lines + 0.1), layout="constrained"), handles


def _draw(axes: Axes, table: StudyTable, boxes: Sequence[DrawnBox], possible: ScoreRange | None) -> None:
    """Boxes, with waists if the possible scores are given, and every design as a point beside the others of its box."""
    numbers = {level: k for k, level in enumerate(table.levels)}
    for box in boxes:
        k = numbers[box.level]
        colour = _colour(k)
        if len(box.values) < MIN_BOXED:
            axes.hlines(
                np.median(box.values), box.place - WIDE / 2, box.place + WIDE / 2, colors=[colour], linewidth=1.3
            )
        else:
            axes.boxplot(
                [box.values],
                positions=[box.place],
                widths=WIDE,
                notch=possible is not None and len(box.values) >= MIN_NOTCHED,
                conf_intervals=None if possible is None else [_waist(box.values, possible)],
                whis=(0, 100),
                patch_artist=True,
                manage_ticks=False,
                boxprops={
                    "facecolor": (colour, 0.08 if box.is_elsewhere else 0.28),
                    "edgecolor": colour,
                    "linewidth": 0.7,
                },
                medianprops={"color": colour, "linewidth": 1.3},
                whiskerprops={"color": colour, "linewidth": 0.7},
                capprops={"color": colour, "linewidth": 0.7},
            )
        axes.scatter(
            box.place + moved_aside(box.values),
            box.values,
            s=5.0,
            marker=_MARKS[k % len(_MARKS)],
            facecolors="none" if box.is_elsewhere else colour,
            edgecolors=colour,
            linewidths=0.5,
            alpha=0.75,
            zorder=3,
        )
    axes.set_xticks([])
    axes.yaxis.set_major_locator(MaxNLocator(5))
    axes.tick_params(length=2.0, pad=1.5)
    places = [box.place for box in boxes]
    axes.set_xlim(min(places) - 0.6, max(places) + 0.6)
    axes.grid(axis="y", linewidth=0.3, alpha=0.6)
    axes.set_axisbelow(True)


def _waist(values: Floats, possible: ScoreRange) -> tuple[float, float]:
    """The interval of the median as far as the box reaches, beyond which matplotlib folds a box."""
    low, high = possible.clipped(*notch(values))
    start, end = np.percentile(values, [25, 75]).tolist()
    return max(low, start), min(high, end)


def _colour(k: int) -> str:
    return COLOURS[k % len(COLOURS)]
