"""A network as an SVG picture: inputs on the left, wheels on the right, a line for each weight.

The width of a line is its weight; positive ones are blue, negative ones orange and dashed. The picture is light or dark
as that of a PFSM (diagram.py).
"""

from collections.abc import Sequence
from typing import NamedTuple

from mercator_design.network.network import Gene, Network
from mercator_design.show.markup import escaped

_ROW, _PAD, _RADIUS = 26.0, 12.0, 6.0
_LABEL = 165.0
"""Width of the names of the inputs."""
_COLUMN = 260.0
_END = 80.0
"""Width of the names of the wheels."""
_LINE = 15.0
_MAX_WIDTH = 6.0
_STYLE = (
    ".network{--network-back:#fff;color:#15202b;font:12px system-ui,sans-serif}"
    "@media(prefers-color-scheme:dark){.network{--network-back:#11161b;color:#e8edf2}}"
    ".network .back{fill:var(--panel,var(--network-back))}.network text{fill:currentColor;dominant-baseline:central;"
    "paint-order:stroke;stroke:var(--panel,var(--network-back));stroke-width:3px}"
    ".network .plus,.network .minus{fill:none;stroke-opacity:.75}"
    ".network .plus{stroke:#0072b2}.network .minus{stroke:#c07c00;stroke-dasharray:7 4}"
    ".network circle{fill:var(--panel,var(--network-back));stroke:currentColor;stroke-width:1.5}"
    ".network .faint{opacity:.75}"
)


class _Place(NamedTuple):
    x: float
    y: float
    layer: int


def network_svg(
    network: Network,
    names: Sequence[str] = (),  # noqa: ARG001 - as diagram_svg
    *,
    caption: Sequence[str] = (),
    narrow: bool = False,
) -> str:
    """The picture of a network as SVG text; weights are shown where the pointer rests on a line.

    A node has `data-node`, its place in the tables of the network: the viewer fills it as far as it is active.

    Args:
        network: The network to draw; links that are disabled are left out.
        names: Of its parts, which have none.
        caption: Lines below the picture.
        narrow: Whether columns are closer together, for the side of a page.
    """
    places, named = _places(network, 0.5 * _COLUMN if narrow else _COLUMN), network.names
    genes = sorted(network.enabled, key=lambda gene: abs(gene.weight))  # the strongest are on top
    heaviest = max((abs(gene.weight) for gene in genes), default=1.0) or 1.0
    legend = ["Solid blue: positive, dashed orange: negative;", f"the widest line is a weight of {heaviest:.3g}"]
    below = [*(legend if narrow else [" ".join(legend)]), *caption]
    width = max(max(place.x for place in places.values()) + _END, *(6.2 * len(line) + 2 * _PAD for line in below))
    bottom = max(place.y for place in places.values()) + _ROW
    height = bottom + _LINE * len(below) + _PAD
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" class="network" role="img" aria-label="{escaped(network.summary)}" '
        f'width="{width:.0f}" height="{height:.0f}" viewBox="0 0 {width:.1f} {height:.1f}">',
        f"<title>{escaped(network.summary)}</title><style>{_STYLE}</style>",
        f'<rect class="back" fill="#fff" width="{width:.1f}" height="{height:.1f}"/>',
    ]
    lines += [_line_svg(gene, places, named, heaviest) for gene in genes]
    order = {number: k for k, number in enumerate(network.order)}
    for node in network.all_nodes:
        x, y, layer = places[node.number]
        output = f' data-output="{network.outputs[node.number]}"' if node.kind == "output" else ""
        place = f'data-node="{order[node.number]}" data-name="{escaped(named[node.number])}"{output}'
        lines.append(
            f'<circle {place} cx="{x:.1f}" cy="{y:.1f}" r="{_RADIUS}">'
            f"<title>{escaped(named[node.number])}</title></circle>"
        )
        if node.kind == "hidden":
            lines.append(f'<text class="faint" text-anchor="middle" x="{x:.1f}" y="{y - 14:.1f}">{node.number}</text>')
            continue
        side, anchor = (-12.0, "end") if layer == 0 else (12.0, "start")
        name = escaped(named[node.number])
        lines.append(f'<text text-anchor="{anchor}" x="{x + side:.1f}" y="{y:.1f}">{name}</text>')
    for k, line in enumerate(below):
        y = bottom + _LINE * k
        lines.append(f'<text class="faint" x="{_PAD:.1f}" y="{y:.1f}">{escaped(line)}</text>')
    return "\n".join([*lines, "</svg>", ""])


def _places(network: Network, column_width: float) -> dict[int, _Place]:
    """The place of each node: inputs in a column, hidden nodes by their distance from these, then the wheels."""
    layers = _layers(network)
    last = max(layers.values())
    columns = {layer: [number for number in layers if layers[number] == layer] for layer in range(last + 1)}
    middle = 0.5 * (len(columns[0]) - 1)
    found = {}
    for layer, column in columns.items():
        gap = 1.0 if layer == 0 else max(1.6, (len(columns[0]) - 1) / max(len(column), 2) * 0.8)
        across = _LABEL + layer * (column_width if last == 1 else 0.75 * column_width)
        for k, number in enumerate(column):
            row = middle + gap * (k - 0.5 * (len(column) - 1))
            shift = 0.0 if layer in {0, last} else 22.0 * (k % 2)  # so that lines within a column can be seen
            found[number] = _Place(across + shift, _PAD + _ROW * (row + 0.5), layer)
    top = min(place.y for place in found.values())
    return {number: place._replace(y=place.y - min(0.0, top - _PAD - _ROW)) for number, place in found.items()}


def _layers(network: Network) -> dict[int, int]:
    """The column of each node: 0 of inputs; of a hidden node the fewest links from one; the last of the wheels."""
    layers = dict.fromkeys(network.inputs, 0)
    hidden = {*network.hidden}
    depth = 0
    while reached := {g.target for g in network.enabled if g.source in layers and g.target in hidden - {*layers}}:
        depth += 1
        layers |= dict.fromkeys(sorted(reached), depth)
    depth = max(depth, 1) if hidden else 0
    layers |= {number: depth for number in network.hidden if number not in layers}  # that no input reaches
    return {**layers, **dict.fromkeys(network.outputs, depth + 1)}


def _line_svg(gene: Gene, places: dict[int, _Place], names: dict[int, str], heaviest: float) -> str:
    start, end = places[gene.source], places[gene.target]
    width = max(_MAX_WIDTH * abs(gene.weight) / heaviest, 0.4)
    if gene.source == gene.target:
        path = f"M{start.x:.1f} {start.y:.1f}c-24 -34 24 -34 0 0"
    elif end.layer > start.layer:
        path = f"M{start.x:.1f} {start.y:.1f}L{end.x:.1f} {end.y:.1f}"
    else:  # back, or within a column: an arc to the right of it
        bend = max(start.x, end.x) + 40.0
        path = f"M{start.x:.1f} {start.y:.1f}Q{bend:.1f} {0.5 * (start.y + end.y):.1f} {end.x:.1f} {end.y:.1f}"
    kind = "minus" if gene.weight < 0 else "plus"
    words = f"{names[gene.source]} to {names[gene.target]}: {gene.weight:.4g}"
    return f'<path class="{kind}" stroke-width="{width:.2f}" d="{path}"><title>{escaped(words)}</title></path>'
