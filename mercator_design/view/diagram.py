"""A PFSM as an SVG picture: states as boxes, and an arrow for each pair of states, with the conditions on it."""

import math
from collections.abc import Mapping
from html import escape
from typing import NamedTuple

from mercator_design.config.colours import STATE_COLOURS
from mercator_design.fsm.conditions import COLOUR_LABELS
from mercator_design.fsm.modules import ModuleParameter
from mercator_design.fsm.pfsm import Pfsm

_BOX = (150.0, 52.0)  # width and height of a state
_LINE = 15.0  # height of a line of text
_LETTER = 6.4  # width of a letter of the labels, about
_BEND = 34.0  # by which an arrow keeps to the right of the straight line
_PAD = 14.0


class Point(NamedTuple):
    """A place in the picture, y downwards."""

    x: float
    y: float


class Arrow(NamedTuple):
    """All transitions from one state to another: their labels, and the path from box to box."""

    source: int
    target: int
    labels: tuple[tuple[int, str], ...]  # number of the transition, its words
    start: Point
    bend: Point
    end: Point
    place: Point  # of the middle of the labels


def words(name: str, parameters: tuple[ModuleParameter, ...], values: tuple[float, ...]) -> str:
    """A module with its parameters, as `white-floor (beta 0.3)`."""
    shown = ", ".join(
        f"{p.name} {COLOUR_LABELS[int(value)] if p.name == 'label' else format(value, 'g')}"
        for p, value in zip(parameters, values, strict=True)
    )
    spelled = name.replace("_", "-")
    return f"{spelled} ({shown})" if shown else spelled


def diagram_svg(pfsm: Pfsm, rates: Mapping[tuple[int, int], float] | None = None) -> str:
    """The picture of a PFSM as SVG text.

    Elements of a state have `data-state`, those of a transition `data-transition` (state-number): the viewer
    highlights them.

    Args:
        pfsm: To be drawn.
        rates: How often [1/s] a robot takes a transition, by state and number; shown with its label.
    """
    arrows = _arrows(pfsm, rates or {})
    boxes = _places(len(pfsm.states), _gap(arrows))
    arrows = _labelled([_routed(arrow, boxes) for arrow in arrows], boxes)
    xs = [box.x + side * _BOX[0] / 2 for box in boxes for side in (-1, 1)]
    ys = [box.y + side * _BOX[1] / 2 for box in boxes for side in (-1, 1)]
    for arrow in arrows:
        width, high = _size(arrow)
        xs += [arrow.place.x - 0.5 * width, arrow.place.x + 0.5 * width, arrow.bend.x]
        ys += [arrow.place.y - 0.5 * high, arrow.place.y + 0.5 * high]
    left, top = min(xs) - _PAD - 16.0, min(ys) - _PAD
    width, height = max(xs) + _PAD - left, max(ys) + _PAD - top
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{left:.1f} {top:.1f} {width:.1f} {height:.1f}" '
        f'font-family="system-ui, sans-serif" font-size="12" role="img" aria-label="{escape(_summary(pfsm))}">',
        f"<title>{escape(_summary(pfsm))}</title>",
        "<style>.label{paint-order:stroke;stroke:var(--panel,#fff);stroke-width:5px;stroke-linejoin:round}"
        ".active rect{stroke-width:4}.active path{stroke-width:3.5}.active text{font-weight:700}</style>",
        '<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path d="M0 0L8 4L0 8z" fill="currentColor"/></marker></defs>',
    ]
    lines += [_line_svg(arrow) for arrow in arrows]
    lines += [label for arrow in arrows for label in _labels_svg(arrow)]
    for k, box in enumerate(boxes):
        lines += _box_svg(pfsm, k, box)
    return "\n".join([*lines, "</svg>", ""])


def _summary(pfsm: Pfsm) -> str:
    return f"State machine of {len(pfsm.states)} state{'s' * (len(pfsm.states) != 1)}"


def _arrows(pfsm: Pfsm, rates: Mapping[tuple[int, int], float]) -> list[Arrow]:
    """The transitions by source and target, not routed yet."""
    found: dict[tuple[int, int], list[tuple[int, str]]] = {}
    for i, state in enumerate(pfsm.states):
        for j, transition in enumerate(state.transitions):
            text = words(transition.condition, transition.module.parameters, transition.parameters)
            if (i, j) in rates:
                text += f" {rates[i, j]:.2g}/s"
            found.setdefault((i, transition.target), []).append((j, text))
    nowhere = Point(0.0, 0.0)
    return [Arrow(i, k, tuple(labels), nowhere, nowhere, nowhere, nowhere) for (i, k), labels in found.items()]


def _gap(arrows: list[Arrow]) -> tuple[float, float]:
    """Space between boxes, across and down, in which the labels have room."""
    longest = max((len(text) for arrow in arrows for _, text in arrow.labels), default=0)
    most = max((len(arrow.labels) for arrow in arrows), default=0)
    return max(90.0, _LETTER * longest + 40.0), max(120.0, 2.0 * _LINE * most + 90.0)


def _places(n: int, gap: tuple[float, float]) -> list[Point]:
    """The middles of the boxes: in a row of at most two, the first at the top left."""
    across, down = _BOX[0] + gap[0], _BOX[1] + gap[1]
    places = {
        1: [(0.0, 0.0)],
        2: [(0.0, 0.0), (across, 0.0)],
        3: [(0.0, 0.0), (across, 0.0), (0.5 * across, down)],
        4: [(0.0, 0.0), (across, 0.0), (0.0, down), (across, down)],
    }
    return [Point(*place) for place in places[n]]


def _routed(arrow: Arrow, boxes: list[Point]) -> Arrow:
    """An arrow with its path: a curve to the right of the straight line, so that there and back do not meet."""
    a, b = boxes[arrow.source], boxes[arrow.target]
    length = math.dist(a, b)
    right = (-(b.y - a.y) / length, (b.x - a.x) / length)
    bend = Point(0.5 * (a.x + b.x) + _BEND * right[0], 0.5 * (a.y + b.y) + _BEND * right[1])
    return arrow._replace(start=_border(a, bend), bend=bend, end=_border(b, bend))


def _labelled(arrows: list[Arrow], boxes: list[Point]) -> list[Arrow]:
    """The arrows with places for their labels on the curves, where they cover least of boxes and other labels."""
    taken = [(box.x, box.y, _BOX[0] + 8.0, _BOX[1] + 8.0) for box in boxes]
    found = {}
    for arrow in sorted(arrows, key=_size, reverse=True):
        width, height = _size(arrow)

        def cost(share: float, arrow: Arrow = arrow, width: float = width, height: float = height) -> float:
            place = _on_curve(arrow, share)
            covered = sum(_overlap((*place, width, height), other) for other in taken)
            return covered + 20.0 * abs(share - 0.5)

        place = _on_curve(arrow, min((0.02 * k for k in range(8, 43)), key=cost))
        taken.append((*place, width, height))
        found[arrow.source, arrow.target] = arrow._replace(place=place)
    return [found[arrow.source, arrow.target] for arrow in arrows]


def _size(arrow: Arrow) -> tuple[float, float]:
    """Width and height of an arrow's labels."""
    return _LETTER * max(len(text) for _, text in arrow.labels), _LINE * len(arrow.labels) + 4.0


def _on_curve(arrow: Arrow, share: float) -> Point:
    weights = (1.0 - share) ** 2, 2.0 * share * (1.0 - share), share**2
    points = arrow.start, arrow.bend, arrow.end
    x, y = (sum(w * point[k] for w, point in zip(weights, points, strict=True)) for k in (0, 1))
    return Point(x, y)


def _overlap(one: tuple[float, float, float, float], other: tuple[float, float, float, float]) -> float:
    """The area that two rectangles share, each given by its middle, width and height."""
    across = 0.5 * (one[2] + other[2]) - abs(one[0] - other[0])
    down = 0.5 * (one[3] + other[3]) - abs(one[1] - other[1])
    return max(across, 0.0) * max(down, 0.0)


def _border(box: Point, towards: Point) -> Point:
    """Where the line from a box's middle towards a point leaves the box."""
    dx, dy = towards.x - box.x, towards.y - box.y
    share = min(_BOX[0] / 2 / abs(dx) if dx else math.inf, _BOX[1] / 2 / abs(dy) if dy else math.inf)
    return Point(box.x + share * dx, box.y + share * dy)


def _path(arrow: Arrow) -> str:
    start, bend, end = arrow.start, arrow.bend, arrow.end
    return f"M{start.x:.1f} {start.y:.1f}Q{bend.x:.1f} {bend.y:.1f} {end.x:.1f} {end.y:.1f}"


def _line_svg(arrow: Arrow) -> str:
    line = f'<path d="{_path(arrow)}" fill="none" stroke="currentColor"'
    lit = "".join(
        f'<g data-transition="{arrow.source}-{number}">{line} stroke-width="0"/></g>' for number, _ in arrow.labels
    )
    return f'{line} stroke-width="1.3" marker-end="url(#head)"/>{lit}'


def _labels_svg(arrow: Arrow) -> list[str]:
    """The labels, which cover the lines below them."""
    top = arrow.place.y - 0.5 * _LINE * (len(arrow.labels) - 1)
    return [
        f'<g data-transition="{arrow.source}-{number}"><text class="label" x="{arrow.place.x:.1f}" '
        f'y="{top + k * _LINE:.1f}" text-anchor="middle" dominant-baseline="middle" fill="currentColor">'
        f"{escape(text)}</text></g>"
        for k, (number, text) in enumerate(arrow.labels)
    ]


def _box_svg(pfsm: Pfsm, k: int, box: Point) -> list[str]:
    state, (width, height) = pfsm.states[k], _BOX
    red, green, blue = STATE_COLOURS[k]
    x, y = box.x - width / 2, box.y - height / 2
    name, _, parameters = words(state.behaviour, state.module.parameters, state.parameters).partition(" (")
    initial = (
        f'<path d="M{x - 22:.1f} {box.y:.1f}H{x - 2:.1f}" stroke="currentColor" stroke-width="1.3" '
        'marker-end="url(#head)"/>'
    )
    lines = [
        f'<g data-state="{k}">',
        *([initial] if k == 0 else []),
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:g}" height="{height:g}" rx="9" '
        f'fill="rgb({red},{green},{blue})" fill-opacity="0.25" stroke="rgb({red},{green},{blue})" stroke-width="2"/>',
        f'<text x="{box.x:.1f}" y="{box.y - (7 if parameters else 0):.1f}" text-anchor="middle" '
        f'dominant-baseline="middle" fill="currentColor" font-weight="600">{k} {escape(name)}</text>',
    ]
    if parameters:
        lines.append(
            f'<text x="{box.x:.1f}" y="{box.y + 11:.1f}" text-anchor="middle" dominant-baseline="middle" '
            f'fill="currentColor">{escape(parameters.removesuffix(")"))}</text>'
        )
    return [*lines, "</g>"]
