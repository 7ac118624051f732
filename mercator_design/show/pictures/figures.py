"""The style of pictures, a chart of lines, and writing them: equal figures give equal files."""

import io
import textwrap
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from mercator_design.errors import printable
from mercator_design.show.charts import COLOURS, Axis, ChartLine
from mercator_design.system.files import write_bytes

_DPI = 160  # of a PNG
_LINES = ("-", "--", ":", "-.")
_CAPTION = 110  # characters in a line
FORMATS = (".png", ".svg", ".pdf")
_NO_METADATA = {
    ".png": {"Software": None},
    ".svg": {"Date": None, "Creator": None},
    ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
_STYLE: dict[Any, Any] = {
    "font.size": 8.0,
    "axes.linewidth": 0.6,
    "svg.hashsalt": "mercator_design",
    "path.simplify": False,
    "text.parse_math": False,
}


@contextmanager
def house_style() -> Iterator[None]:
    """Matplotlib's default style instead of the user's; make and save figures within.

    Letters that the font lacks are boxes, without a warning for each.
    """
    with mpl.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


def save_figure(path: Path, figure: Figure, caption: str = "", dpi: int = _DPI) -> None:
    """Write a figure with a caption below it; the suffix of the path, of FORMATS, is the format.

    Raises:
        OSError: The picture cannot be written.
    """
    write_bytes(path, file_of(figure, path.suffix, caption, dpi))


def file_of(figure: Figure, suffix: str, caption: str = "", dpi: int = _DPI) -> bytes:
    """The contents of the file of a figure with a caption below it; the suffix, of FORMATS, is the format."""
    suffix, file = suffix.lower(), io.BytesIO()
    if caption:
        draw_caption(figure, caption, -0.01, "top")
    box = "tight" if caption else None
    figure.savefig(file, format=suffix[1:], metadata=_NO_METADATA[suffix], dpi=dpi, bbox_inches=box, pad_inches=0.06)
    return file.getvalue()


def draw_caption(figure: Figure, caption: str, y: float, align: str) -> None:
    """Draw a caption in at most three lines: its `align`, top or bottom, is at y (0 to 1) of the figure's height."""
    lines = textwrap.wrap(printable(caption), round(18 * figure.get_figwidth()), max_lines=3, placeholder=" ...")
    figure.text(0.5, y, "\n".join(lines), ha="center", va=align, size=6.0, family="monospace")


def save_curves(
    path: Path, lines: Sequence[ChartLine], x: Axis, y: Axis, *, title: str, caption: str, groups: Sequence[str] = ()
) -> None:
    """Draw lines with their bands; a caption with long lines is wrapped.

    Lines of one group, of which there is a name for each line, have one colour, and styles of their own; by default
    each line is a group.

    Raises:
        OSError: The picture cannot be written.
    """
    with house_style():
        figure = Figure(figsize=(6.4, 4.0), layout="constrained")
        axes = figure.add_subplot()
        names = groups or [str(k) for k in range(len(lines))]
        places = {name: k for k, name in enumerate(dict.fromkeys(names))}
        for k, (line, name) in enumerate(zip(lines, names, strict=True)):
            colour = COLOURS[places[name] % len(COLOURS)]
            style = _LINES[(places[name] // len(COLOURS) + names[:k].count(name)) % len(_LINES)]
            axes.plot(line.x, line.y, marker="o", ms=3.5, color=colour, linestyle=style, label=line.name)
            if line.low and len(line.x) == 1:
                axes.vlines(line.x, line.low, line.high, color=colour, linewidth=1.0)
            elif line.low:
                axes.fill_between(line.x, line.low, line.high, color=colour, alpha=0.15, linewidth=0)
        axes.grid(linewidth=0.4)
        axes.set_xlabel(x.title)
        axes.set_ylabel(y.title)
        axes.set_title(title)
        axes.legend(fontsize=7)
        figure.supxlabel("\n".join(textwrap.fill(part, _CAPTION) for part in caption.split("\n")), fontsize=6)
        save_figure(path, figure)
