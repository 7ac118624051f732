"""The formats of recorded vectors that can be replayed, found by what a file holds.

Each is a module with two functions: `recognises(document)`, whether the content of a file is of this format, and
`checks(document)`, which replays it. Its docstring begins with its name and a colon.
"""

from collections.abc import Iterator
from pathlib import Path

from benchmarks.json_file import read_json
from benchmarks.vectors import irace_parts, irace_races, irace_tests, multiflex_frames, rvr_frames, ydlidar_scans
from benchmarks.vectors.checks import Check
from mercator_design.errors import MercatorError

FORMATS = (irace_tests, irace_parts, irace_races, rvr_frames, ydlidar_scans, multiflex_frames)


class VectorError(MercatorError):
    """A file holds no vectors of a known format."""

    exit_code = 2


def replay(file: Path) -> Iterator[Check]:
    """Compare all that a file holds.

    Raises:
        VectorError: naming the file and the known formats.
    """
    document = read_json(file, VectorError)
    for form in FORMATS:
        if form.recognises(document):
            checks: Iterator[Check] = form.checks(document)
            return checks
    known = "; ".join((form.__doc__ or "").split(":")[0] for form in FORMATS)
    raise VectorError(f"{file}: expected recorded vectors of a known format ({known})")
