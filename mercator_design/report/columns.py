"""Rows of cells as lines of text."""

from collections.abc import Sequence

from mercator_design.errors import excerpt


def aligned(rows: Sequence[Sequence[object]]) -> list[str]:
    """A line for each row, columns as wide as their widest cell; None is empty."""
    texts = [["" if cell is None else excerpt(str(cell)) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*texts, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in texts]
