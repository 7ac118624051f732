"""A behaviour tree as an SVG picture, from the root down, or as an outline for the side of a page.

It is light or dark as diagram.py says.
"""

from collections.abc import Sequence
from typing import NamedTuple

from mercator_design.config.colours import STATE_COLOURS, hex_of
from mercator_design.modules.words import parameters_words
from mercator_design.show.machines.layout import Extent, size_of
from mercator_design.show.machines.parts import INKS, PAD, box, picture
from mercator_design.tree.architecture import acting_nodes
from mercator_design.tree.tree import Tree, TreeNode, children_of

SYMBOLS = {"selector": "?", "selector*": "?*", "sequence": "→", "sequence*": "→*", "negation": "¬"}
"""What pictures of behaviour trees usually have for inner nodes."""
_GRAY = "#8a949e"
_BESIDE, _BELOW = 14.0, 34.0
"""Free space between siblings, and between a node and its children."""
_STEP, _BETWEEN = 24.0, 8.0
"""In an outline: how much further to the right children are, and the free space between rows."""


class _Placed(NamedTuple):
    """The box of each node in preorder, and the path of the line to each but the root."""

    boxes: list[Extent]
    lines: list[str]


def tree_svg(
    tree: Tree,
    names: Sequence[str] = (),  # noqa: ARG001 - boxes have no names
    *,
    caption: Sequence[str] = (),
    narrow: bool = False,
) -> str:
    """The picture of a tree as SVG text.

    The elements of a node and of the line to it have `data-state`, its number in preorder: the viewer highlights the
    branch to the acting one, and fills in the outline's texts of class `mark`.

    Args:
        tree: The tree to draw.
        names: The names of its nodes, which the picture does not show.
        caption: Lines below the picture.
        narrow: Whether it is an outline, with a node on each row, for the viewer.
    """
    nodes = [node for _, node in tree.preorder]
    texts = [node_lines(node) for node in nodes]
    parents, ends = tree.links
    sizes = [(max(64.0, width + 20.0), height + 8.0) for width, height in map(size_of, texts)]
    placed = (_outline if narrow else _top_down)(sizes, parents, ends)
    body = []
    acting = {k: i % len(INKS) for i, k in enumerate(acting_nodes(tree))}
    for k, path in enumerate(placed.lines, start=1):
        ink = INKS[acting[k]] if k in acting else "currentColor"
        lit = f'<path class="lit" stroke="{ink}" d="{path}"/>'
        body.append(f'<path class="line" stroke="{_GRAY}" d="{path}"/><g data-state="{k}">{lit}</g>')
    for k, one in enumerate(placed.boxes):
        colour = hex_of(*STATE_COLOURS[acting[k]]) if k in acting else _GRAY
        mark = f'<text class="mark" x="{one.x + one.width / 2 - 5:.1f}" y="{one.y - one.height / 2 + 9:.1f}"></text>'
        body += [f'<g data-state="{k}">', *box(one, texts[k], colour), *([mark] if narrow else []), "</g>"]
    return picture(_title(nodes), _frame(placed.boxes), body, caption)


def node_lines(node: TreeNode) -> list[str]:
    """The lines in a node's box: its kind; of a leaf its module, its parameters, and p if it is not 0."""
    if not node.is_leaf:
        return [f"{SYMBOLS[node.kind]} {node.kind}"]
    parameters = parameters_words(node.module, node.parameters)
    return [node.name if node.kind == "action" else f"{node.name}?", *filter(None, [parameters, success_words(node)])]


def success_words(node: TreeNode) -> str:
    """The probability that an action succeeds instead of acting; empty if it never does."""
    return f"p {node.p:g} per cycle" if node.p else ""


def _title(nodes: Sequence[TreeNode]) -> str:
    n = len(nodes)
    return f"Behaviour tree of {n} node{'s' * (n != 1)}"


def _top_down(sizes: Sequence[tuple[float, float]], parents: Sequence[int], ends: Sequence[int]) -> _Placed:
    """A node above the middle of its children; those of one level side by side, with their upper edges in line."""
    n = len(sizes)
    widths = [width for width, _ in sizes]
    for k in reversed(range(n)):
        spans = [widths[child] for child in children_of(k, ends)]
        widths[k] = max(widths[k], sum(spans) + _BESIDE * (len(spans) - 1))
    levels = [0] * n
    for k in range(1, n):
        levels[k] = levels[parents[k]] + 1
    heights = [max(sizes[k][1] for k in range(n) if levels[k] == level) for level in range(max(levels) + 1)]
    lefts = [0.0] * n
    for k in range(n):
        below = [*children_of(k, ends)]
        span = sum(widths[child] for child in below) + _BESIDE * (len(below) - 1)
        left = lefts[k] + 0.5 * (widths[k] - span)
        for child in below:
            lefts[child] = left
            left += widths[child] + _BESIDE
    boxes = []
    for k, (width, height) in enumerate(sizes):
        top = sum(heights[: levels[k]]) + _BELOW * levels[k]
        boxes.append(Extent(lefts[k] + 0.5 * widths[k], top + 0.5 * height, width, height))
    lines = []
    for k in range(1, n):
        above, one = boxes[parents[k]], boxes[k]
        begin, end = above.y + 0.5 * above.height, one.y - 0.5 * one.height
        middle = end - 0.5 * _BELOW
        lines.append(f"M{above.x:.1f} {begin:.1f}V{middle:.1f}H{one.x:.1f}V{end:.1f}")
    return _Placed(boxes, lines)


def _outline(sizes: Sequence[tuple[float, float]], parents: Sequence[int], ends: Sequence[int]) -> _Placed:  # noqa: ARG001 - as _top_down
    """A node on each row, further to the right than its parent."""
    boxes: list[Extent] = []
    lines = []
    lefts = [0.0] * len(sizes)
    top = 0.0
    for k, (width, height) in enumerate(sizes):
        if k > 0:
            lefts[k] = lefts[parents[k]] + _STEP
        boxes.append(Extent(lefts[k] + 0.5 * width, top + 0.5 * height, width, height))
        top += height + _BETWEEN
        if k > 0:
            above = boxes[parents[k]]
            begin = lefts[parents[k]] + 0.5 * _STEP
            lines.append(f"M{begin:.1f} {above.y + 0.5 * above.height:.1f}V{boxes[k].y:.1f}H{lefts[k]:.1f}")
    return _Placed(boxes, lines)


def _frame(boxes: Sequence[Extent]) -> tuple[float, float, float, float]:
    """Left, top, width and height of the picture."""
    left = min(one.x - one.width / 2 for one in boxes) - PAD
    top = min(one.y - one.height / 2 for one in boxes) - PAD
    width = max(one.x + one.width / 2 for one in boxes) + PAD - left
    height = max(one.y + one.height / 2 for one in boxes) + PAD - top
    return left, top, width, height
