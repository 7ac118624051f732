"""A chart of lines with bands, as a picture file."""

import textwrap
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from mercator_design.view.charts import COLOURS, Axis, Line
from mercator_design.view.pictures.figures import house_style, save_figure

_STYLES = ("-", "--", ":", "-.")
_CAPTION = 110  # characters in a line


def save_curves(path: Path, lines: Sequence[Line], x: Axis, y: Axis, *, title: str, caption: str) -> None:
    """Draw lines with their bands.

    Args:
        path: The picture; its suffix is the format.
        lines: The lines; names are shown as text.
        x: The horizontal axis.
        y: The vertical axis.
        title: Above the chart.
        caption: Below it; long lines are wrapped.

    Raises:
        OSError: The picture cannot be written.
    """
    with house_style():
        figure = Figure(figsize=(6.4, 4.0), layout="constrained")
        axes = figure.add_subplot()
        for place, line in enumerate(lines):
            colour = COLOURS[place % len(COLOURS)]
            style = _STYLES[place // len(COLOURS) % len(_STYLES)]
            axes.plot(line.x, line.y, marker="o", ms=3.5, color=colour, linestyle=style, label=line.name)
            if line.low:
                axes.fill_between(line.x, line.low, line.high, color=colour, alpha=0.15, linewidth=0)
        axes.grid(linewidth=0.4)
        axes.set_xlabel(x.title)
        axes.set_ylabel(y.title)
        axes.set_title(title)
        axes.legend(fontsize=7)
        figure.supxlabel("\n".join(textwrap.fill(part, _CAPTION) for part in caption.split("\n")), fontsize=6)
        save_figure(path, figure)
