"""Text of users and of files in pages and pictures: it appears as text, whatever it is."""

from html import escape

from mercator_design.errors import printable, printable_lines

MAX_LABEL = 34
"""Maximum length of a label in a picture [characters]."""


def escaped(text: object) -> str:
    """A text as HTML and SVG show it in one line; characters that would change its direction or vanish are spelled."""
    return escape(printable(str(text)))


def escaped_lines(text: object) -> str:
    """A text of several lines as HTML shows it."""
    return escape(printable_lines(str(text)))


def label(text: object, length: int = MAX_LABEL) -> str:
    """The beginning of a text, escaped, short enough for a picture."""
    whole = printable(str(text))
    return escape(whole if len(whole) <= length else whole[: length - 1] + "…")
