"""A PFSM as an SVG picture: states as boxes, and an arrow for each pair of states, with the conditions on it.

The picture needs nothing else. It is light or dark as its reader prefers, or as the page that it is part of: the
variable --panel is the background, `color` the ink.
"""

import math
from collections.abc import Iterable, Sequence

from mercator_design.config.colours import STATE_COLOURS, hex_of
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.fsm.words.names import state_names
from mercator_design.modules.words import parameters_words
from mercator_design.results.analysis.occupancy import Occupancy
from mercator_design.show.machines.layout import LINE, Arrow, Extent, Layout, laid_out
from mercator_design.show.markup import escaped

_PAD = 12.0
_INITIAL = 34.0
"""Length of the arrow to the initial state."""
_INKS = ("#0072b2", "#c07c00", "#00926a", "#be6496")
"""The colours of states, dark enough for lines on white and light enough for lines on black."""
_STYLE = (
    ".pfsm{--pfsm-back:#fff;color:#15202b;font:12px system-ui,sans-serif}"
    "@media(prefers-color-scheme:dark){.pfsm{--pfsm-back:#11161b;color:#e8edf2}}"
    ".pfsm .back{fill:var(--panel,var(--pfsm-back))}.pfsm text{fill:currentColor;text-anchor:middle;"
    "dominant-baseline:central}"
    ".pfsm .line{fill:none;stroke-width:1.6}.pfsm .edge{fill-opacity:.9;stroke-opacity:.45}"
    ".pfsm .lit{fill:none;stroke-width:0}.pfsm .name{font-weight:600}.pfsm .faint{opacity:.75}"
    ".pfsm .active .box{stroke-width:4}.pfsm .active .lit{stroke-width:3.5}.pfsm .active text{font-weight:700}"
)


def diagram_svg(
    pfsm: Pfsm,
    names: Sequence[str] = (),
    *,
    measured: Occupancy | None = None,
    caption: Sequence[str] = (),
    narrow: bool = False,
) -> str:
    """The picture of a PFSM as SVG text.

    Elements of a state have `data-state`, those of a transition `data-transition` (state-number): the viewer
    highlights them.

    Args:
        pfsm: The PFSM to draw.
        names: The names of its states.
        measured: The measured occupancy, which is shown with the states and transitions.
        caption: Lines below the picture.
        narrow: Whether the states are in a column, for the side of a page.
    """
    names = names or state_names(pfsm)
    texts = [_box_lines(pfsm, k, names, measured) for k in range(len(pfsm.states))]
    layout = laid_out(texts, _arrows(pfsm, measured), narrow=narrow)
    left, top, width, height = _frame(layout, caption)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" class="pfsm" role="img" aria-label="{escaped(_summary(pfsm))}" '
        f'width="{width:.0f}" height="{height:.0f}" viewBox="{left:.1f} {top:.1f} {width:.1f} {height:.1f}">',
        f"<title>{escaped(_summary(pfsm))}</title><style>{_STYLE}</style>",
        f'<rect class="back" fill="#fff" x="{left:.1f}" y="{top:.1f}" width="{width:.1f}" height="{height:.1f}"/>',
    ]
    lines += [_line_svg(arrow) for arrow in layout.arrows]
    lines += [part for arrow in layout.arrows for part in _labels_svg(arrow)]
    for k, box in enumerate(layout.boxes):
        lines += _box_svg(k, box, texts[k])
    for k, line in enumerate(reversed(caption)):
        y = top + height - _PAD - LINE * k
        words = escaped(line)
        lines.append(f'<text class="faint" style="text-anchor:start" x="{left + _PAD:.1f}" y="{y:.1f}">{words}</text>')
    return "\n".join([*lines, "</svg>", ""])


def _summary(pfsm: Pfsm) -> str:
    return f"State machine of {len(pfsm.states)} state{'s' * (len(pfsm.states) != 1)}"


def _box_lines(pfsm: Pfsm, k: int, names: Sequence[str], measured: Occupancy | None) -> list[str]:
    """The lines in a state's box: number and name, behaviour if the name differs from it, parameters, share of time."""
    state = pfsm.states[k]
    lines = [f"{k} {names[k]}"]
    if names[k] != state.behaviour and names[k] != state_names(pfsm)[k]:
        lines.append(state.behaviour)
    if state.parameters:
        lines.append(parameters_words(state.module, state.parameters))
    if measured is not None:
        lines.append(f"{100.0 * measured.shares[k]:.1f} % of time")
    return lines


def _arrows(pfsm: Pfsm, measured: Occupancy | None) -> list[Arrow]:
    """The transitions by source and target, without places."""
    found: dict[tuple[int, int], list[tuple[int | None, tuple[str, ...]]]] = {}
    for i, state in enumerate(pfsm.states):
        for j, edge in enumerate(state.transitions):
            parameters = parameters_words(edge.module, edge.parameters)
            lines = (edge.condition, *([parameters] if parameters else []))
            found.setdefault((i, edge.target), []).append((j, lines))
    if measured is not None:
        for pair, labels in found.items():
            together = " together" * (len(labels) > 1)
            labels.append((None, (f"{measured.rates[pair]:.2g} per s{together}",)))
    return [Arrow(source=i, target=k, labels=tuple(labels)) for (i, k), labels in found.items()]


def _frame(layout: Layout, caption: Sequence[str]) -> tuple[float, float, float, float]:
    """Left, top, width and height of the picture."""
    parts = [*layout.parts]
    first = layout.boxes[0]
    left = min(*(one.x - one.width / 2 for one in parts), first.x - first.width / 2 - _INITIAL) - _PAD
    top = min(one.y - one.height / 2 for one in parts) - _PAD
    width = max(one.x + one.width / 2 for one in parts) + _PAD - left
    height = max(one.y + one.height / 2 for one in parts) + _PAD - top
    return left, top, max(width, *(6.2 * len(line) + 2 * _PAD for line in caption), 0.0), height + LINE * len(caption)


def _line_svg(arrow: Arrow) -> str:
    start, bend, end = arrow.start, arrow.bend, arrow.end
    path = f"M{start.x:.1f} {start.y:.1f}Q{bend.x:.1f} {bend.y:.1f} {end.x:.1f} {end.y:.1f}"
    ink = _INKS[arrow.source]
    lit = "".join(
        f'<g data-transition="{arrow.source}-{number}"><path class="lit" stroke="{ink}" d="{path}"/></g>'
        for number, _ in arrow.labels
        if number is not None
    )
    head = _head(end, math.atan2(end.y - bend.y, end.x - bend.x), ink)
    return f'<path class="line" stroke="{ink}" d="{path}"/>{head}{lit}'


def _head(tip: Iterable[float], angle: float, ink: str) -> str:
    x, y = tip
    corners = [(x, y)] + [(x - 10 * math.cos(angle + side), y - 10 * math.sin(angle + side)) for side in (-0.4, 0.4)]
    return f'<path fill="{ink}" d="M{"L".join(f"{a:.1f} {b:.1f}" for a, b in corners)}z"/>'


def _labels_svg(arrow: Arrow) -> list[str]:
    """The labels on their background."""
    block = arrow.block
    y = block.y - 0.5 * LINE * (sum(len(lines) for _, lines in arrow.labels) - 1)
    parts = [_rectangle(block, f'class="back edge" fill="#fff" stroke="{_INKS[arrow.source]}" rx="4"')]
    for number, lines in arrow.labels:
        opened = "<g>" if number is None else f'<g data-transition="{arrow.source}-{number}">'
        parts.append(
            opened + "".join(_text(block.x, y + LINE * k, line, k > 0) for k, line in enumerate(lines)) + "</g>"
        )
        y += LINE * len(lines)
    return parts


def _box_svg(k: int, box: Extent, lines: Sequence[str]) -> list[str]:
    colour = hex_of(*STATE_COLOURS[k])
    y = box.y - 0.5 * LINE * (len(lines) - 1)
    parts = [f'<g data-state="{k}">']
    if k == 0:
        x = box.x - box.width / 2
        start = f'<circle fill="currentColor" cx="{x - _INITIAL + 4:.1f}" cy="{box.y:.1f}" r="4"/>'
        line = f'<path class="line" stroke="currentColor" d="M{x - _INITIAL:.1f} {box.y:.1f}H{x - 2:.1f}"/>'
        parts += [start, line, _head((x, box.y), 0.0, "currentColor")]
    style = f'rx="9" fill="{colour}" fill-opacity="0.25" stroke="{colour}" stroke-width="2"'
    parts += [_rectangle(box, 'class="back" fill="#fff" rx="9"'), _rectangle(box, f'class="box" {style}')]
    name, *others = lines
    parts.append(f'<text class="name" x="{box.x:.1f}" y="{y:.1f}">{escaped(name)}</text>')
    parts += [_text(box.x, y + LINE * (n + 1), line, faint=False) for n, line in enumerate(others)]
    return [*parts, "</g>"]


def _rectangle(one: Extent, style: str) -> str:
    x, y = one.x - one.width / 2, one.y - one.height / 2
    return f'<rect x="{x:.1f}" y="{y:.1f}" width="{one.width:.1f}" height="{one.height:.1f}" {style}/>'


def _text(x: float, y: float, words: str, faint: bool) -> str:
    style = 'class="faint" ' if faint else ""
    return f'<text {style}x="{x:.1f}" y="{y:.1f}">{escaped(words)}</text>'
