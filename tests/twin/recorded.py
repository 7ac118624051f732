"""Logs of three robots on a twin, and of the twin, as `benchmarks/twin_perception.py` has left them."""

import zipfile
from pathlib import Path

ROBOTS = 3
_ARCHIVE = Path(__file__).parents[1] / "data" / "twin_runs.zip"


def unpack(folder):
    """Put them in a folder: run0.jsonl, ..., twin.jsonl."""
    with zipfile.ZipFile(_ARCHIVE) as archive:
        archive.extractall(folder)
    return folder
