"""The parts of a page: sections, figures, tables."""

import re
from collections.abc import Iterable, Sequence

from mercator_design.show.markup import escaped, escaped_lines

_HEADING = re.compile(r'<section id="(\w+)"><h2>(.*?)</h2>')


class Html(str):
    """Text that is HTML already."""

    __slots__ = ()


def html(text: object) -> str:
    """Text as HTML; HTML stays as it is."""
    return text if isinstance(text, Html) else escaped(text)


def section(name: str, title: str, *parts: str, command: str = "") -> Html:
    """A section with a heading, for a link to #name; nothing if it has no parts.

    Args:
        name: The id of the section.
        title: Its heading, and the text of the link to it.
        parts: Its contents.
        command: The command that makes its figures, shown at its end.
    """
    if not any(parts):
        return Html()
    shown = "\n".join(filter(None, [*parts, made_by(command) if command else ""]))
    return Html(f'<section id="{name}"><h2>{escaped(title)}</h2>\n{shown}</section>\n')


def made_by(command: str) -> Html:
    """The command that makes the figures above."""
    return Html(f'<p class="made">Made by <code>{escaped(command)}</code></p>')


def contents(body: str) -> Html:
    """Links to the sections of a page, with their headings."""
    return Html("".join(f'<a href="#{name}">{title}</a>' for name, title in _HEADING.findall(body)))


def note(*texts: object) -> Html:
    """A paragraph."""
    return Html(f"<p>{''.join(map(html, texts))}</p>")


def figure(svg: str, caption: object, *, is_wide: bool = False) -> Html:
    """A picture with its caption."""
    wide = ' class="wide"' if is_wide else ""
    return Html(
        f'<figure{wide}><div class="scroll" tabindex="0">{svg}</div><figcaption>{html(caption)}</figcaption></figure>'
    )


def row_of(*figures: str) -> Html:
    """Figures side by side where there is space."""
    return Html(f'<div class="row">{"".join(figures)}</div>') if any(figures) else Html()


def facts_list(facts: Iterable[tuple[str, object]]) -> Html:
    """Names with their values; None is left out."""
    rows = [f'<dt>{escaped(name)}</dt><dd dir="auto">{html(value)}</dd>' for name, value in facts if value is not None]
    return Html(f"<dl>{''.join(rows)}</dl>")


def table(head: Sequence[object], rows: Iterable[Sequence[object]], *, name: str = "") -> Html:
    """A table; columns of numbers are at the right."""
    cells = [[html("" if cell is None else cell) for cell in row] for row in rows]
    lines = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in cells)
    titles = "".join(f"<th>{html(title)}</th>" for title in head)
    data = f' data-table="{name}"' if name else ""
    whole = f"<table{data}><thead><tr>{titles}</tr></thead><tbody>{lines}</tbody></table>"
    return Html(f'<div class="scroll" tabindex="0">{whole}</div>')


def p_text(value: float) -> str:
    """A p-value in words."""
    return "p < 0.001" if value < 0.001 else f"p = {value:.2g}"


def folded(title: str, *parts: str) -> Html:
    """Parts that are shown when the title is clicked."""
    return Html(f"<details><summary>{escaped(title)}</summary>{''.join(parts)}</details>")


def text(lines: str) -> Html:
    """A text of several lines."""
    return Html(f"<pre>{escaped_lines(lines)}</pre>")


def command(text: str, name: str = "") -> Html:
    """Text to copy, with a button that does it."""
    data = f' data-text="{name}"' if name else ""
    shown = f'<pre tabindex="0"{data}>{escaped(text)}</pre>'  # a long text scrolls, also by keys
    return Html(f'<div class="copy">{shown}<button type="button" data-copy>Copy</button></div>')
