"""Rows of cells as CSV."""

import codecs
import csv
import io
from collections.abc import Iterable
from pathlib import Path

from mercator_design.system.files import replacing


def csv_text(rows: Iterable[Iterable[object]]) -> str:
    """Rows of cells as CSV; None is an empty cell."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def write_csv(path: Path, rows: Iterable[Iterable[object]]) -> None:
    """Write the rows as they come into a file, atomically."""
    with replacing(path) as file:
        csv.writer(codecs.getwriter("utf-8")(file), lineterminator="\n").writerows(rows)
