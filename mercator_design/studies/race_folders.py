"""A study of races that exist: the winner of each run folder, with its scores on fresh instances, is a design."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from mercator_design.designer import GIVEN_OPTIONS
from mercator_design.errors import RaceError, StudyError
from mercator_design.results.analysis.comparison import winner_tests
from mercator_design.results.files import JOURNAL, possible_scores, read_journal
from mercator_design.scores import ScoreRange
from mercator_design.studies.table import DESIGN_MODEL, StudyTable

_DIGESTS = {"mission": "mission_digest", "robot_model": "robot_model_digest"}
"""The digests that tell missions and robot models of one name apart."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RaceDesign:
    """The winner of a race.

    place: The factors of its race, and their digests.
    scores: On fresh instances, by their seeds.
    """

    folder: Path
    place: Mapping[str, Any]
    seed: int
    scores: Mapping[int, float]
    possible: ScoreRange


def run_folders(paths: Sequence[Path]) -> list[Path]:
    """Run folders, or those within other folders.

    Raises:
        StudyError: There is none in a folder.
    """
    found = []
    for path in paths:
        folders = [path] if (path / JOURNAL).is_file() else sorted(file.parent for file in path.glob(f"*/{JOURNAL}"))
        if not folders:
            raise StudyError(f"{path}: expected a run folder, or a folder of run folders, found none")
        found += folders
    return list(dict.fromkeys(found))


def table_of_races(name: str, folders: Sequence[Path], by: str) -> StudyTable:
    """The table of the winners of run folders.

    Races that are equal in all factors are repetitions, numbered by their seeds.

    Args:
        name: Of the study.
        folders: Run folders of missions.
        by: The factor to compare, of `table.COMPARED`.

    Raises:
        StudyError: A race has not ended, is not of a mission, was not tested on fresh instances, or is in two folders;
            or nothing can be compared.
    """
    designs = _labelled([_design_of(folder) for folder in folders])
    cells: dict[tuple[Any, ...], dict[int, RaceDesign]] = {}
    for design in designs:
        cell = cells.setdefault(tuple(design.place.values()), {})
        if design.seed in cell:
            raise StudyError(
                f"{design.folder}: expected a race that differs from that in {cell[design.seed].folder} in mission, "
                "robot model, method, flavour, budget or seed, found the same: a design counts once"
            )
        cell[design.seed] = design
    table = StudyTable(
        name=name,
        runs=pd.DataFrame([row for cell in cells.values() for row in _rows(cell)]),
        directions={one.place["mission"]: "maximise" if one.possible.maximise else "minimise" for one in designs},
        limits={one.place["mission"]: _finite(one.possible) for one in designs},
        by=by,
    )
    if not any(len(block.scores) > 1 for block in table.blocks()):
        same = ", ".join(name for name in ("mission", "robot_model", "method", "flavour", "budget") if name != by)
        raise StudyError(
            f"expected races with different values of {by} that are equal in {same}, found none: {by} is "
            f"{' or '.join(table.levels)}"
        )
    return table


def _design_of(folder: Path) -> RaceDesign:
    try:
        record = read_journal(folder).record
    except RaceError as error:
        raise StudyError(*error.messages) from None
    start = record.start
    if start and start["task"] != "mission":
        raise StudyError(f"{folder}: expected the race of a mission, found that of a {start['task']}")
    if record.view.winner is None:
        raise StudyError(f"{folder}: expected a race that has ended, found one that has no winner yet")
    scores = winner_tests(record)
    if not scores:
        raise StudyError(
            f"{folder}: expected a winner that was tested on fresh instances, found none; race with --test-runs 100"
        )
    return RaceDesign(
        folder=folder,
        place={
            "mission": start["name"],
            "robot_model": start["robot_model"],
            "method": _method_of(start),
            "flavour": start["flavour"],
            "budget": record.budget,
            **{digest: start.get(digest) for digest in _DIGESTS.values()},
        },
        seed=start["seed"],
        scores=scores,
        possible=possible_scores(folder),
    )


def _method_of(start: Mapping[str, Any]) -> str:
    """The method of a race with the options that were given."""
    options = start.get(GIVEN_OPTIONS)
    return f"{start['method']} ({', '.join(f'{k}={v}' for k, v in options.items())})" if options else start["method"]


def _labelled(designs: Sequence[RaceDesign]) -> list[RaceDesign]:
    """Designs whose missions and robot models of one name, but different contents, have names of their own."""
    contents: dict[tuple[str, str], set[object]] = {}
    for one in designs:
        for factor, digest in _DIGESTS.items():
            contents.setdefault((factor, one.place[factor]), set()).add(one.place[digest])

    def named(one: RaceDesign) -> dict[str, Any]:
        ambiguous = {factor for factor in _DIGESTS if len(contents[factor, one.place[factor]]) > 1}
        ends = {factor: f" {str(one.place[_DIGESTS[factor]])[:6]}" for factor in ambiguous}
        return {
            key: f"{value}{ends[key]}" if key in ends else value
            for key, value in one.place.items()
            if key not in _DIGESTS.values()
        }

    return [
        RaceDesign(folder=one.folder, place=named(one), seed=one.seed, scores=one.scores, possible=one.possible)
        for one in designs
    ]


def _rows(cell: Mapping[int, RaceDesign]) -> Iterator[dict[str, Any]]:
    for repetition, seed in enumerate(sorted(cell), start=1):
        design = cell[seed]
        for instance, score in design.scores.items():
            start = {"repetition": repetition, "seed": seed, "reality": DESIGN_MODEL}
            yield {**design.place, **start, "instance": instance, "score": score}


def _finite(possible: ScoreRange) -> tuple[float | None, float | None]:
    low, high = (limit if abs(limit) < float("inf") else None for limit in (possible.low, possible.high))
    return low, high
