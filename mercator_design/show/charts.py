"""Charts as SVG text: lines with bands, bars, dots with intervals, heat maps, parallel coordinates.

A page that shows them includes `STYLE`, which gives their colours for light and dark screens: those of Okabe and Ito,
and viridis for scales. Marks have tooltips, and their values as `data-` attributes.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import unescape
from typing import NamedTuple

from mercator_design.config.colours import hex_of
from mercator_design.show.markup import escaped, label

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7a7a7a")
"""Colours of lines and bars on white."""
STYLE = """
.chart{--ink:#1c2430;--faint:#667180;--grid:#dfe4ea;SERIESwidth:100%;height:auto;display:block;
font:12px system-ui,sans-serif;color:var(--ink)}
@media (prefers-color-scheme:dark){.chart{--ink:#e6e9ee;--faint:#9aa5b1;--grid:#333b45;--k0:#4aa8e0;--k1:#f0803c;
--k2:#2fc49a;--k6:#a0a7b0}.chart .shade{filter:brightness(1.6)}}
@media print{.chart{--ink:#000;--faint:#444;--grid:#ddd;--k0:#0072b2;--k1:#d55e00;--k2:#009e73}}
.chart text{fill:var(--ink)}.chart .tick{fill:var(--faint);font-size:11px}.chart .grid{stroke:var(--grid)}
.chart .axis{stroke:var(--faint)}
""".replace("SERIES", "".join(f"--k{k}:{colour};" for k, colour in enumerate(COLOURS)))
WIDTH, WIDE = 460.0, 940.0
_LETTER = 6.3  # approximate width of a letter
_ROW = 24.0
_SHADE = ' class="shade"'  # brighter on dark screens
_VIRIDIS = ((68, 1, 84), (71, 45, 123), (59, 82, 139), (44, 114, 142), (33, 145, 140), (40, 174, 128), (94, 201, 98),
            (173, 220, 48), (253, 231, 37))  # fmt: skip


class Axis(NamedTuple):
    """The quantity on an axis: its name, unit, limits and ticks."""

    name: str
    unit: str = ""
    whole: bool = False  # whether only whole numbers are marked
    low: float | None = None  # limits; by default those of the data
    high: float | None = None
    categories: tuple[str, ...] = ()  # the names of the values 0, 1, ...

    @property
    def title(self) -> str:
        """The name with the unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


class ChartLine(NamedTuple):
    """A line of a chart; low and high are the borders of its band."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    low: Sequence[float] = ()
    high: Sequence[float] = ()


class Bars(NamedTuple):
    """The values of one kind, a value for each bar; kinds are stacked."""

    name: str
    values: Sequence[float]


class Dot(NamedTuple):
    """A row: a mean or other value with its interval, the single values with their quartiles, and a remark."""

    name: str
    middle: float
    low: float
    high: float
    values: Sequence[float] = ()
    remark: str = ""
    colour: int = 0
    quartiles: tuple[float, float, float] | None = None
    is_pale: bool = False  # whether its marks are hollow, where they can be


class Thread(NamedTuple):
    """A line across parallel axes; NaN where it has no value."""

    name: str
    values: Sequence[float]
    share: float  # of the colour scale
    is_bold: bool = False


def ticks(low: float, high: float, *, whole: bool = False) -> list[float]:
    """At most six round numbers between two."""
    step = max(rounded_up((high - low or 1.0) / 5), float(whole))
    return [k * step for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]


def rounded_up(step: float) -> float:
    """The next of ..., 0.1, 0.2, 0.5, 1, 2, 5, ... that is not less, but for rounding errors."""
    power = 10.0 ** math.floor(math.log10(step))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= step * (1 - 1e-9))


def number(value: float) -> str:
    """A number with four digits, without an exponent unless it is very large or small."""
    return f"{0.0 + float(f'{value:.4g}'):.7g}"


def line_chart(lines: Sequence[ChartLine], x: Axis, y: Axis) -> str:
    """Lines with points, and bands around them."""
    frame = ChartFrame(
        x=x,
        y=y,
        xs=[value for line in lines for value in line.x],
        ys=[value for line in lines for value in (*line.y, *line.low, *line.high)],
        legend=[line.name for line in lines],
    )
    drawn = []
    for k, line in enumerate(lines):
        colour = colour_of(k)
        if line.low:
            there = [frame.at(*point) for point in zip(line.x, line.high, strict=True)]
            back = [frame.at(*point) for point in zip(line.x, line.low, strict=True)]
            drawn.append(f'<path d="M{_path([*there, *reversed(back)])}z" fill="{colour}" fill-opacity=".18"/>')
        drawn.append(
            f'<path d="M{_path([frame.at(*point) for point in zip(line.x, line.y, strict=True)])}" fill="none" '
            f'stroke="{colour}" stroke-width="2" stroke-linejoin="round"/>'
        )
        for place, (a, b) in enumerate(zip(line.x, line.y, strict=True)):
            around = f", {number(line.low[place])} to {number(line.high[place])}" if line.low else ""
            cx, cy = frame.at(a, b)
            drawn.append(
                f'<circle cx="{cx:.1f}" cy="{cy:.1f}" r="3" fill="{colour}" data-x="{a:.6g}" data-y="{b:.6g}">'
                f"<title>{escaped(line.name)}: {number(b)}{around} at {escaped(x.name)} {number(a)}</title></circle>"
            )
    return frame.svg(drawn)


def bar_chart(names: Sequence[str], kinds: Sequence[Bars], x: Axis, y: Axis) -> str:
    """Stacked bars, a name below each."""
    sums = [sum(values) for values in zip(*(kind.values for kind in kinds), strict=True)]
    frame = ChartFrame(
        x=x._replace(low=-0.5, high=len(names) - 0.5, categories=tuple(names)),
        y=y,
        ys=[0.0, *sums],
        legend=[kind.name for kind in kinds],
    )
    drawn = []
    below = [0.0] * len(names)
    for k, kind in enumerate(kinds):
        for place, value in enumerate(kind.values):
            left, top = frame.at(place - 0.36, below[place] + value)
            right, bottom = frame.at(place + 0.36, below[place])
            below[place] += value
            drawn.append(
                f'<rect x="{left:.1f}" y="{top:.1f}" width="{right - left:.1f}" height="{bottom - top:.1f}" '
                f'fill="{colour_of(k)}" data-name="{escaped(names[place])}" data-value="{value:.6g}">'
                f"<title>{escaped(names[place])}, {escaped(kind.name)}: {number(value)}</title></rect>"
            )
    return frame.svg(drawn)


def interval_chart(rows: Sequence[Dot], x: Axis, draw: Callable[..., Iterable[str]] | None = None) -> str:
    """A row for each value, with its mark: by default a dot with its interval, over the single values and their box."""
    left = 14.0 + 7.0 * max(len(unescape(label(row.name))) for row in rows)
    right = 16.0 + 7.0 * max(len(row.remark) for row in rows)
    frame = ChartFrame(
        x=x,
        y=Axis(""),
        xs=[value for row in rows for value in (row.low, row.high, *row.values)],
        width=max(WIDTH, left + right + 240.0),
        height=_ROW * len(rows) + 56.0,
        left=left,
        right=right,
    )
    drawn: list[str] = []
    for k, row in enumerate(rows):
        y = frame.top + _ROW * (k + 0.5)
        drawn += [
            f'<g data-name="{escaped(row.name)}" data-mean="{row.middle:.6g}" data-low="{row.low:.6g}" '
            f'data-high="{row.high:.6g}"><title>{escaped(row.name)}: {number(row.middle)}, {number(row.low)} to '
            f"{number(row.high)}</title>{''.join((draw or _interval_mark)(frame, row, y))}</g>",
            _text(frame.left - 8, y + 4, label(row.name), "end"),
            _text(frame.width - frame.right + 8, y + 4, escaped(row.remark), is_tick=True),
        ]
    return frame.svg(drawn)


def _interval_mark(frame: "ChartFrame", row: Dot, y: float) -> Iterator[str]:
    """A dot with its interval, before its single values and the box of their quartiles."""
    colour = colour_of(row.colour)
    x_low, x_middle, x_high = (frame.at(value, 0.0)[0] for value in (row.low, row.middle, row.high))
    for value in row.values:
        yield f'<circle cx="{frame.at(value, 0.0)[0]:.1f}" cy="{y:.1f}" r="2.2" fill="{colour}" fill-opacity=".22"/>'
    if row.quartiles is not None:
        lower, median, upper = (frame.at(value, 0.0)[0] for value in row.quartiles)
        yield (
            f'<path d="M{lower:.1f} {y - 8:.1f}H{upper:.1f}v16H{lower:.1f}zM{median:.1f} {y - 8:.1f}v16" '
            f'fill="{colour}" fill-opacity=".14" stroke="{colour}" stroke-opacity=".6"/>'
        )
    yield (
        f'<path d="M{x_low:.1f} {y:.1f}H{x_high:.1f}M{x_low:.1f} {y - 4:.1f}v8M{x_high:.1f} {y - 4:.1f}v8" '
        f'stroke="{colour}" stroke-width="2" fill="none"/><circle cx="{x_middle:.1f}" cy="{y:.1f}" r="4.5" '
        f'fill="{colour}"/>'
    )


def heat_map(
    values: Sequence[Sequence[float]], rows: Sequence[str], columns: Sequence[str], x: Axis, scale: Axis
) -> str:
    """Coloured cells; NaN is left out."""
    known = [value for row in values for value in row if not math.isnan(value)]
    low, high = min(known, default=0.0), max(known, default=1.0)
    left = 14.0 + 7.0 * max(len(unescape(label(row))) for row in rows)
    top, height = 46.0, 20.0
    width = (WIDE - left - 12.0) / max(len(columns), 1)
    total = top + height * len(rows) + 40.0
    drawn = []
    for i, row in enumerate(values):
        y = top + height * i
        drawn.append(_text(left - 8, y + 14, label(rows[i]), "end"))
        for j, value in enumerate(row):
            if not math.isnan(value):
                drawn.append(
                    f'<rect x="{left + width * j:.2f}" y="{y:.1f}" width="{max(width - 0.6, 0.6):.2f}" '
                    f'height="{height - 1}" fill="{viridis((value - low) / (high - low or 1.0))}" '
                    f'data-value="{value:.6g}"><title>'
                    f"{escaped(rows[i])}, {escaped(x.name)} {escaped(columns[j])}: {number(value)}</title></rect>"
                )
    every = math.ceil(34.0 / width)
    drawn += [
        _text(left + width * (j + 0.5), total - 24, label(columns[j], 8), "middle", is_tick=True)
        for j in range(0, len(columns), every)
    ]
    drawn.append(_text(left + (WIDE - left) / 2, total - 6, label(x.title, 60), "middle"))
    drawn += _colour_bar(left, scale.title, number(low), number(high))
    return _svg(WIDE, total, drawn, f"{scale.title}, {len(rows)} rows by {len(columns)} columns")


def parallel_chart(axes: Sequence[Axis], threads: Sequence[Thread], scale: Axis) -> str:
    """A line for each thread across several axes; the bold ones are drawn last."""
    top, bottom, left, right = 64.0, 236.0, 90.0, 70.0
    step = (WIDE - left - right) / max(len(axes) - 1, 1)
    ranges = [_limits(axis, [thread.values[k] for thread in threads]) for k, axis in enumerate(axes)]
    drawn = []
    for k, (axis, (low, high)) in enumerate(zip(axes, ranges, strict=True)):
        x = left + step * k
        drawn.append(f'<path class="axis" d="M{x:.1f} {top}V{bottom}"/>')
        if not axis.categories:
            drawn.append(_text(x, top - 8, number(high), "middle", is_tick=True))
            drawn.append(_text(x, bottom + 16, number(low), "middle", is_tick=True))
        for mark, name in enumerate(axis.categories):
            drawn.append(_text(x + 5, _between(mark, low, high, bottom, top) + 4, label(name, 12), is_tick=True))
        drawn.append(_text(x + 4, bottom + 32, label(axis.title, 26), "end", turn=-32))
    for place, thread in enumerate(sorted(threads, key=lambda one: one.is_bold)):
        shift = 1.6 * (place % 5 - 2) * (not thread.is_bold)  # equal values stay apart
        points = [
            (left + step * k, _between(value, *ranges[k], bottom, top) + shift)
            for k, value in enumerate(thread.values)
            if not math.isnan(value)
        ]
        colour = "var(--k1)" if thread.is_bold else viridis(thread.share)
        drawn.append(
            f'<path d="M{_path(points)}" fill="none" stroke="{colour}" stroke-width="{3 if thread.is_bold else 1.6}" '
            f'stroke-opacity="{1 if thread.is_bold else 0.75}"{"" if thread.is_bold else _SHADE} '
            f'data-name="{escaped(thread.name)}"><title>{escaped(thread.name)}</title></path>'
        )
    drawn += _colour_bar(left, scale.title, number(scale.low or 0.0), number(scale.high or 0.0), _SHADE)
    bold = [thread.name for thread in threads if thread.is_bold]
    if bold:
        drawn.append(f'<path d="M{WIDE - 330} 16h24" stroke="var(--k1)" stroke-width="3"/>')
        drawn.append(_text(WIDE - 300, 20, label(bold[0], 44)))
    return _svg(WIDE, bottom + 128.0, drawn, f"Parallel coordinates of {len(threads)} configurations")


def viridis(share: float) -> str:
    """The colour of a place in 0 .. 1 of the scale viridis."""
    place = min(max(share, 0.0), 1.0) * (len(_VIRIDIS) - 1)
    k = min(int(place), len(_VIRIDIS) - 2)
    return hex_of(*(a + (b - a) * (place - k) for a, b in zip(_VIRIDIS[k], _VIRIDIS[k + 1], strict=True)))


@dataclass(kw_only=True)
class ChartFrame:
    """Axes with their ticks and titles, and the legend above; without an axis at the left if y has no name."""

    x: Axis
    y: Axis
    xs: Sequence[float] = ()
    ys: Sequence[float] = ()
    legend: Sequence[str] = ()  # names of lines or kinds, whose colours are in this order
    width: float = WIDTH
    height: float = 270.0
    left: float = 58.0
    right: float = 14.0

    def __post_init__(self) -> None:
        self.places = list(_legend_places(self.legend, self.left, self.width))
        self.top = 10.0 + (self.places[-1][1] + 12.0 if self.places else 0.0)
        self.bottom = self.height - 42.0
        self.x_range, self.y_range = _range(self.x, self.xs), _range(self.y, self.ys)

    def at(self, x: float, y: float) -> tuple[float, float]:
        """The place of a point in the picture."""
        across = _between(x, *self.x_range, self.left, self.width - self.right)
        return across, _between(y, *self.y_range, self.bottom, self.top)

    def svg(self, drawn: Sequence[str]) -> str:
        """The whole picture."""
        about = f"{self.y.title} by {self.x.title}" if self.y.name else self.x.title
        return _svg(self.width, self.height, [*self._axes(), *drawn, *self._legend()], about)

    def _axes(self) -> Iterator[str]:
        end = self.width - self.right
        marks = range(len(self.x.categories)) if self.x.categories else ticks(*self.x_range, whole=self.x.whole)
        every = math.ceil(len(marks) * 26.0 / (end - self.left)) if self.x.categories else 1
        for mark in marks[::every]:
            x = self.at(mark, 0.0)[0]
            name = self.x.categories[int(mark)] if self.x.categories else number(mark)
            if not self.x.categories:
                yield f'<path class="grid" d="M{x:.1f} {self.top:.1f}V{self.bottom:.1f}"/>'
            yield _text(x, self.bottom + 16, label(name, 9), "middle", is_tick=True)
        if self.y.name:
            for mark in ticks(*self.y_range, whole=self.y.whole):
                y = self.at(0.0, mark)[1]
                yield f'<path class="grid" d="M{self.left} {y:.1f}H{end}"/>'
                yield _text(self.left - 6, y + 4, number(mark), "end", is_tick=True)
            middle = (self.top + self.bottom) / 2
            yield _text(14, middle, label(self.y.title, 44), "middle", turn=-90)
            yield f'<path class="axis" fill="none" d="M{self.left} {self.top:.1f}V{self.bottom:.1f}"/>'
        yield f'<path class="axis" d="M{self.left} {self.bottom:.1f}H{end}"/>'
        centre = (self.left + end) / 2
        yield _text(centre, self.height - 8, label(self.x.title, 60), "middle")

    def _legend(self) -> Iterator[str]:
        for k, (name, (x, y)) in enumerate(zip(self.legend, self.places, strict=True)):
            yield f'<rect x="{x:.1f}" y="{y - 9:.1f}" width="12" height="10" rx="2" fill="{colour_of(k)}"/>'
            yield _text(x + 17, y, label(name, 60))


def _legend_places(names: Sequence[str], left: float, width: float) -> Iterator[tuple[float, float]]:
    x, y = left, 14.0
    for name in names:
        needed = 34.0 + _LETTER * min(len(name), 60)
        if x > left and x + needed > width:
            x, y = left, y + 18.0
        yield x, y
        x += needed


def _colour_bar(left: float, title: str, low: str, high: str, style: str = "") -> Iterator[str]:
    for k in range(24):
        yield f'<rect{style} x="{left + 60 + 5 * k:.1f}" y="10" width="5.3" height="12" fill="{viridis(k / 23)}"/>'
    yield _text(left + 54, 20, low, "end", is_tick=True)
    yield _text(left + 186, 20, high, is_tick=True)
    yield _text(left + 240, 20, label(title, 60))


def _range(axis: Axis, values: Sequence[float]) -> tuple[float, float]:
    """The interval that an axis covers: its own limits, or the range of the data with a margin."""
    if axis.categories and axis.low is None:
        return 0.0, max(len(axis.categories) - 1.0, 1.0)
    low, high = min(values, default=0.0), max(values, default=1.0)
    room = 0.06 * (high - low) or 0.06 * abs(high) or 1.0
    low = (low if low == 0.0 else low - room) if axis.low is None else axis.low
    high = high + room if axis.high is None else axis.high
    return low, high if high > low else low + 1.0


def _limits(axis: Axis, values: Sequence[float]) -> tuple[float, float]:
    """The interval that an axis of its own values covers, without a margin."""
    known = [value for value in values if not math.isnan(value)]
    low, high = min(known, default=0.0), max(known, default=1.0)
    return _range(axis if axis.categories else axis._replace(low=low, high=high), [])


def colour_of(k: int) -> str:
    """The colour of the k-th line or kind."""
    return f"var(--k{k % len(COLOURS)})"


def _between(value: float, low: float, high: float, start: float, end: float) -> float:
    return start + (value - low) / (high - low or 1.0) * (end - start)


def _text(x: float, y: float, words: str, anchor: str = "start", *, is_tick: bool = False, turn: float = 0.0) -> str:
    """A text whose words are escaped already."""
    turned = f" rotate({turn:g})" if turn else ""
    style = ' class="tick"' if is_tick else ""
    return f'<text{style} transform="translate({x:.1f} {y:.1f}){turned}" text-anchor="{anchor}">{words}</text>'


def _path(points: Sequence[tuple[float, float]]) -> str:
    return "L".join(f"{x:.1f} {y:.1f}" for x, y in points)


def _svg(width: float, height: float, drawn: Sequence[str], about: str) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" class="chart" viewBox="0 0 {width:.0f} {height:.0f}" role="img" '
        f'aria-label="{escaped(about)}">{"".join(drawn)}</svg>'
    )
