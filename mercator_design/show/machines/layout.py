"""Places the boxes, arrows and labels of a diagram: no label covers a box, the head of an arrow or another label."""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

LINE = 15.0
"""Height of a line of text."""
_LETTER = 6.7
"""Approximate width of a letter at the font size of 12."""
_MARGIN = 6.0
"""Free space around a box or label."""
_ROOM = 44.0
"""Free space between boxes to begin with; it grows until everything has room."""
_GROWTH = 1.15
_MAX_GROWTH = 30
_SHARES = [0.14 + 0.03 * k for k in range(25)]
"""Places on an arrow, from 0 at its start to 1 at its head, at which its labels may be."""


class Point(NamedTuple):
    """A place in the picture, y downwards."""

    x: float
    y: float


class Extent(NamedTuple):
    """The middle, width and height of something."""

    x: float
    y: float
    width: float
    height: float

    def covers(self, other: "Extent") -> float:
        """The area that both cover."""
        across = 0.5 * (self.width + other.width) - abs(self.x - other.x)
        down = 0.5 * (self.height + other.height) - abs(self.y - other.y)
        return across * down if across > 0.0 and down > 0.0 else 0.0

    def holds(self, point: Point) -> bool:
        """Whether a point is inside."""
        return abs(point.x - self.x) < 0.5 * self.width and abs(point.y - self.y) < 0.5 * self.height


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrow:
    """All transitions from one state to another: a quadratic curve, and the block of their labels.

    labels: The lines of each label, by number of the transition; number None is of all together.
    """

    source: int
    target: int
    labels: tuple[tuple[int | None, tuple[str, ...]], ...]
    start: Point = Point(0.0, 0.0)
    bend: Point = Point(0.0, 0.0)
    end: Point = Point(0.0, 0.0)
    block: Extent = Extent(0.0, 0.0, 0.0, 0.0)

    def at(self, share: float) -> Point:
        """A place on the curve."""
        a, b, c = (1.0 - share) ** 2, 2.0 * share * (1.0 - share), share**2
        return Point(
            a * self.start.x + b * self.bend.x + c * self.end.x, a * self.start.y + b * self.bend.y + c * self.end.y
        )


class Layout(NamedTuple):
    """All places: the box of each state, the arrows."""

    boxes: tuple[Extent, ...]
    arrows: tuple[Arrow, ...]

    @property
    def parts(self) -> Iterator[Extent]:
        """Everything that has to be in the picture."""
        yield from self.boxes
        for arrow in self.arrows:
            yield arrow.block
            yield from (Extent(*arrow.at(share), 4.0, 4.0) for share in (0.25, 0.5, 0.75))


def size_of(lines: Sequence[str]) -> tuple[float, float]:
    """Width and height of lines of text with a margin."""
    return _LETTER * max(map(len, lines), default=0) + 2.0 * _MARGIN, LINE * len(lines) + _MARGIN


def laid_out(texts: Sequence[Sequence[str]], arrows: Sequence[Arrow], *, narrow: bool = False) -> Layout:
    """The places of states with these lines in their boxes, and of arrows without places.

    The states are on a grid, or in a column if the layout is to be narrow.
    """
    sizes = [(max(96.0, width + 8.0), height + 8.0) for width, height in map(size_of, texts)]
    blocks = [size_of([line for _, lines in arrow.labels for line in lines]) for arrow in arrows]
    sized = [replace(arrow, block=Extent(0.0, 0.0, *block)) for arrow, block in zip(arrows, blocks, strict=True)]
    corners = _corners(len(texts), sized)
    gap = _ROOM
    for _ in range(_MAX_GROWTH):
        boxes = _column(sizes, gap) if narrow else _boxes(sizes, corners, gap)
        routed = [_routed(arrow, boxes, _away(arrow, boxes, sized, narrow=narrow)) for arrow in sized]
        placed, covered = _labelled(routed, boxes, beside_lines=False)
        if covered == 0.0:
            break
        gap *= _GROWTH
    beside, covered = _labelled(placed, boxes, beside_lines=True)
    return Layout(tuple(boxes), tuple(beside if covered < 1.0 else placed))


def cells(n: int) -> list[tuple[int, int]]:
    """Column and row of each of n states, row by row: two in a row, or more if there are more than four."""
    columns = max(2, math.isqrt(n - 1) + 1)
    return [(k % columns, k // columns) for k in range(n)]


def _corners(n: int, arrows: Sequence[Arrow]) -> tuple[int, ...]:
    """For each state its cell; of four (0 and 1 above, 2 and 3 below) with as little as possible on the diagonals."""
    if n != 4:
        return tuple(range(n))

    def crossing(corners: tuple[int, ...]) -> float:
        return sum(
            arrow.block.width * arrow.block.height
            for arrow in arrows
            if corners[arrow.source] + corners[arrow.target] == 3  # 0 and 3, or 1 and 2
        )

    return min(((0, *rest) for rest in itertools.permutations((1, 2, 3))), key=crossing)


def _boxes(sizes: Sequence[tuple[float, float]], corners: Sequence[int], gap: float) -> list[Extent]:
    """The boxes of states on a grid; three states are a triangle."""
    across = max(width for width, _ in sizes) + 1.4 * gap
    down = max(height for _, height in sizes) + gap
    places = [(across * column, down * row) for column, row in cells(len(sizes))]
    if len(sizes) == 3:
        places[2] = (0.5 * across, down)
    return [Extent(*places[corner], *size) for corner, size in zip(corners, sizes, strict=True)]


def _column(sizes: Sequence[tuple[float, float]], gap: float) -> list[Extent]:
    """The boxes of states one below the other."""
    down = max(height for _, height in sizes) + gap
    return [Extent(0.0, k * down, *size) for k, size in enumerate(sizes)]


def _right(a: Extent, b: Extent) -> Point:
    """The direction to the right of the line from one box to another."""
    length = math.dist(a[:2], b[:2])
    return Point(-(b.y - a.y) / length, (b.x - a.x) / length)


def _away(arrow: Arrow, boxes: Sequence[Extent], arrows: Sequence[Arrow], *, narrow: bool) -> float:
    """Distance of the bend of an arrow to the right of the straight line, so that the labels of there and back fit."""
    a, b = boxes[arrow.source], boxes[arrow.target]
    if narrow:  # beside all boxes between the two
        between = abs(arrow.source - arrow.target) - 1
        return max(arrow.block.width + 10.0, (1.5 * max(box.width for box in boxes) + 30.0 * between) * (between > 0))
    right = _right(a, b)
    if not any((other.target, other.source) == (arrow.source, arrow.target) for other in arrows):
        return 24.0
    is_slanted = min(abs(right.x), abs(right.y)) > 0.3  # then labels find room along the arrow
    across = abs(right.x) * arrow.block.width + abs(right.y) * arrow.block.height
    return min(60.0 if is_slanted else across + 10.0, 0.9 * math.dist(a[:2], b[:2]))


def _routed(arrow: Arrow, boxes: Sequence[Extent], away: float) -> Arrow:
    """An arrow with its path."""
    a, b = boxes[arrow.source], boxes[arrow.target]
    right = _right(a, b)
    bend = Point(0.5 * (a.x + b.x) + away * right.x, 0.5 * (a.y + b.y) + away * right.y)
    return replace(arrow, start=_border(a, bend), bend=bend, end=_border(b, bend))


def _border(box: Extent, towards: Point) -> Point:
    """The point where the line from a box's middle towards another point leaves the box."""
    dx, dy = towards.x - box.x, towards.y - box.y
    share = min(box.width / 2 / abs(dx) if dx else math.inf, box.height / 2 / abs(dy) if dy else math.inf)
    return Point(box.x + share * dx, box.y + share * dy)


def _labelled(arrows: Sequence[Arrow], boxes: Sequence[Extent], *, beside_lines: bool) -> tuple[list[Arrow], float]:
    """The arrows with their labels on them, and the area that labels cover of what they must not cover.

    With `beside_lines`, labels also keep off other arrows, where they can.
    """
    fixed = [box._replace(width=box.width + _MARGIN, height=box.height + _MARGIN) for box in boxes]
    fixed += [Extent(*arrow.at(0.96), 16.0, 16.0) for arrow in arrows]
    lines = [[arrow.at(0.05 * k) for k in range(1, 20)] if beside_lines else [] for arrow in arrows]
    order = sorted(range(len(arrows)), key=lambda k: -arrows[k].block.width * arrows[k].block.height)
    blocks: dict[int, Extent] = {}
    covered = dict.fromkeys(order, 0.0)
    for _, k in itertools.product(range(3), order):  # each again when the others have a place
        others = [*fixed, *(block for other, block in blocks.items() if other != k)]
        best = math.inf
        for share in _SHARES:
            block = arrows[k].block._replace(x=arrows[k].at(share).x, y=arrows[k].at(share).y)
            wide = block._replace(width=block.width + _MARGIN, height=block.height + _MARGIN)
            area = sum(map(wide.covers, others))
            hidden = sum(block.holds(point) for other, line in enumerate(lines) if other != k for point in line)
            cost = 1000.0 * area + 10.0 * hidden + 20.0 * abs(share - 0.5)
            if cost < best:
                best, blocks[k], covered[k] = cost, block, area
    return [replace(arrow, block=blocks[k]) for k, arrow in enumerate(arrows)], sum(covered.values())
