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
from mercator_design.show.machines.parts import INKS, PAD, box, picture, rectangle, text

_INITIAL = 34.0
"""Length of the arrow to the initial state."""


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
    body = [_line_svg(arrow) for arrow in layout.arrows]
    body += [part for arrow in layout.arrows for part in _labels_svg(arrow)]
    for k, one in enumerate(layout.boxes):
        body += _box_svg(k, one, texts[k])
    return picture(_summary(pfsm), _frame(layout), body, caption)


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


def _frame(layout: Layout) -> tuple[float, float, float, float]:
    """Left, top, width and height of the picture."""
    parts = [*layout.parts]
    first = layout.boxes[0]
    left = min(*(one.x - one.width / 2 for one in parts), first.x - first.width / 2 - _INITIAL) - PAD
    top = min(one.y - one.height / 2 for one in parts) - PAD
    width = max(one.x + one.width / 2 for one in parts) + PAD - left
    height = max(one.y + one.height / 2 for one in parts) + PAD - top
    return left, top, width, height


def _line_svg(arrow: Arrow) -> str:
    start, bend, end = arrow.start, arrow.bend, arrow.end
    path = f"M{start.x:.1f} {start.y:.1f}Q{bend.x:.1f} {bend.y:.1f} {end.x:.1f} {end.y:.1f}"
    ink = _ink(arrow)
    lit = "".join(
        f'<g data-transition="{arrow.source}-{number}"><path class="lit" stroke="{ink}" d="{path}"/></g>'
        for number, _ in arrow.labels
        if number is not None
    )
    head = _head(end, math.atan2(end.y - bend.y, end.x - bend.x), ink)
    return f'<path class="line" stroke="{ink}" d="{path}"/>{head}{lit}'


def _ink(arrow: Arrow) -> str:
    return INKS[arrow.source % len(INKS)]


def _head(tip: Iterable[float], angle: float, ink: str) -> str:
    x, y = tip
    corners = [(x, y)] + [(x - 10 * math.cos(angle + side), y - 10 * math.sin(angle + side)) for side in (-0.4, 0.4)]
    return f'<path fill="{ink}" d="M{"L".join(f"{a:.1f} {b:.1f}" for a, b in corners)}z"/>'


def _labels_svg(arrow: Arrow) -> list[str]:
    """The labels on their background."""
    block = arrow.block
    y = block.y - 0.5 * LINE * (sum(len(lines) for _, lines in arrow.labels) - 1)
    parts = [rectangle(block, f'class="back edge" fill="#fff" stroke="{_ink(arrow)}" rx="4"')]
    for number, lines in arrow.labels:
        opened = "<g>" if number is None else f'<g data-transition="{arrow.source}-{number}">'
        parts.append(
            opened + "".join(text(block.x, y + LINE * k, line, k > 0) for k, line in enumerate(lines)) + "</g>"
        )
        y += LINE * len(lines)
    return parts


def _box_svg(k: int, one: Extent, lines: Sequence[str]) -> list[str]:
    parts = [f'<g data-state="{k}">']
    if k == 0:
        x = one.x - one.width / 2
        start = f'<circle fill="currentColor" cx="{x - _INITIAL + 4:.1f}" cy="{one.y:.1f}" r="4"/>'
        line = f'<path class="line" stroke="currentColor" d="M{x - _INITIAL:.1f} {one.y:.1f}H{x - 2:.1f}"/>'
        parts += [start, line, _head((x, one.y), 0.0, "currentColor")]
    return [*parts, *box(one, lines, hex_of(*STATE_COLOURS[k % len(STATE_COLOURS)])), "</g>"]
