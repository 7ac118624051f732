"""Parts of pictures of control software: their style, boxes and texts."""

from collections.abc import Iterable, Sequence

from mercator_design.show.machines.layout import LINE, Extent
from mercator_design.show.markup import escaped

PAD = 12.0
INKS = ("#0072b2", "#c07c00", "#00926a", "#be6496")
"""The colours of states, dark enough for lines on white and light enough for lines on black."""
_STYLE = (
    ".pfsm{--pfsm-back:#fff;color:#15202b;font:12px system-ui,sans-serif}"
    "@media(prefers-color-scheme:dark){.pfsm{--pfsm-back:#11161b;color:#e8edf2}}"
    ".pfsm .back{fill:var(--panel,var(--pfsm-back))}.pfsm text{fill:currentColor;text-anchor:middle;"
    "dominant-baseline:central}"
    ".pfsm .line{fill:none;stroke-width:1.6}.pfsm .edge{fill-opacity:.9;stroke-opacity:.45}"
    ".pfsm .lit{fill:none;stroke-width:0}.pfsm .name{font-weight:600}.pfsm .faint{opacity:.75}"
    ".pfsm .active .box{stroke-width:4}.pfsm .active .lit{stroke-width:3.5}.pfsm .active text{font-weight:700}"
    ".pfsm .branch .box{stroke-width:4}.pfsm .branch .lit{stroke-width:3.5}.pfsm .idle{opacity:.45}"
    ".pfsm .mark{text-anchor:end;font-weight:700}"
)


def picture(title: str, frame: tuple[float, float, float, float], body: Iterable[str], caption: Sequence[str]) -> str:
    """An SVG text: a picture in a frame of left, top, width and height, with lines below it."""
    left, top, width, height = frame
    width = max(width, *(6.2 * len(line) + 2 * PAD for line in caption), 0.0)
    height += LINE * len(caption)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" class="pfsm" role="img" aria-label="{escaped(title)}" '
        f'width="{width:.0f}" height="{height:.0f}" viewBox="{left:.1f} {top:.1f} {width:.1f} {height:.1f}">',
        f"<title>{escaped(title)}</title><style>{_STYLE}</style>",
        f'<rect class="back" fill="#fff" x="{left:.1f}" y="{top:.1f}" width="{width:.1f}" height="{height:.1f}"/>',
        *body,
    ]
    for k, line in enumerate(reversed(caption)):
        y = top + height - PAD - LINE * k
        words = escaped(line)
        lines.append(f'<text class="faint" style="text-anchor:start" x="{left + PAD:.1f}" y="{y:.1f}">{words}</text>')
    return "\n".join([*lines, "</svg>", ""])


def box(one: Extent, lines: Sequence[str], colour: str) -> list[str]:
    """A box with lines of text, of which the first is its name."""
    y = one.y - 0.5 * LINE * (len(lines) - 1)
    style = f'rx="9" fill="{colour}" fill-opacity="0.25" stroke="{colour}" stroke-width="2"'
    name, *others = lines
    return [
        rectangle(one, 'class="back" fill="#fff" rx="9"'),
        rectangle(one, f'class="box" {style}'),
        f'<text class="name" x="{one.x:.1f}" y="{y:.1f}">{escaped(name)}</text>',
        *(text(one.x, y + LINE * (n + 1), line, faint=False) for n, line in enumerate(others)),
    ]


def rectangle(one: Extent, style: str) -> str:
    x, y = one.x - one.width / 2, one.y - one.height / 2
    return f'<rect x="{x:.1f}" y="{y:.1f}" width="{one.width:.1f}" height="{one.height:.1f}" {style}/>'


def text(x: float, y: float, words: str, faint: bool) -> str:
    style = 'class="faint" ' if faint else ""
    return f'<text {style}x="{x:.1f}" y="{y:.1f}">{escaped(words)}</text>'
