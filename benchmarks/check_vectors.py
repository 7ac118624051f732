"""Replay recorded vectors of other programs, and count what agrees.

Each FILE is JSON, gzip'd or not, of one of the formats in benchmarks/vectors/: eliminations, parts, or whole races of
R's irace; frames of the Sphero RVR, the YDLIDAR X4 or the Teraranger Hub Multiflex. For each kind of vector that a file
holds, prints how many agree, and the first few that do not. Ties are means that are equal but for rounding, and that
irace puts in another order; they are counted apart.

Exit code 0: all agree, but for ties; 1: something does not; 2: a file is of none of these formats.
Run: python benchmarks/check_vectors.py FILE ... [--shown N]
"""

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from benchmarks.vectors.checks import Check
from benchmarks.vectors.formats import replay
from mercator_design.errors import MercatorError


def report(checks: Iterable[Check], shown: int) -> bool:
    """Print the table of a file and what differs; whether nothing does but ties."""
    by_kind: dict[str, list[Check]] = {}
    for check in checks:
        by_kind.setdefault(check.kind, []).append(check)
    rows = [(kind, _counts(of_kind)) for kind, of_kind in by_kind.items()]
    total = agreed, of, ties = _counts(check for of_kind in by_kind.values() for check in of_kind)
    print("| kind | agreed | of | ties |")
    print("|---|---|---|---|")
    for name, counts in [*rows, ("all", total)]:
        print(f"| {name} | {' | '.join(map(str, counts))} |")
    for kind, of_kind in by_kind.items():
        differing = [check for check in of_kind if check.difference]
        if differing:
            print(f"\n{kind}: {len(differing)} of {len(of_kind)} differ")
        for check in differing[:shown]:
            print(f"    {check.case}: {'a tie of means; ' if check.is_tie else ''}{check.difference}")
        if len(differing) > shown:
            print(f"    and {len(differing) - shown} more")
    return agreed + ties == of > 0


def _counts(checks: Iterable[Check]) -> tuple[int, int, int]:
    """How many agree, how many there are, and how many differ by ties."""
    checks = list(checks)
    return sum(not check.difference for check in checks), len(checks), sum(check.is_tie for check in checks)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE")
    parser.add_argument("--shown", type=int, default=5, metavar="N", help="disagreements shown of each kind")
    given = parser.parse_args()
    agree, unreadable = True, False
    for file in given.files:
        print(f"# {file}\n")
        try:
            agree &= report(replay(file), given.shown)
        except MercatorError as error:
            print(error, file=sys.stderr)
            unreadable = True
        print()
    return 2 if unreadable else int(not agree)


if __name__ == "__main__":
    sys.exit(main())
