"""A study of races that exist: the winner of each run folder, with its scores on fresh instances, is a design."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from mercator_design.designer import GIVEN_OPTIONS
from mercator_design.errors import MissionError, RaceError, StudyError
from mercator_design.race.session.record import Record
from mercator_design.results.analysis.comparison import winner_tests
from mercator_design.results.analysis.front import file_on_front
from mercator_design.results.files import JOURNAL, read_journal, scores_by_objective
from mercator_design.scores import ScoreRange
from mercator_design.studies.assessment import front_scores, read_assessment
from mercator_design.studies.statistics.fronts import front_rows
from mercator_design.studies.table import DESIGN_MODEL, StudyTable

_DIGESTS = {"mission": "mission_digest", "robot_model": "robot_model_digest"}
"""The digests that tell missions and robot models of one name apart."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RaceDesign:
    """The winner of a race.

    place: The factors of its race, and their digests.
    tests: The scores by each objective on fresh instances, by their seeds or numbers; of the winner first, then of the
        others that were tested for the front, by their files.
    possible: The range of the scores by each objective; one without a name, if there are not several.
    """

    folder: Path
    place: Mapping[str, Any]
    seed: int
    tests: Mapping[str, Mapping[int, tuple[float, ...]]]
    possible: Mapping[str, ScoreRange]


def run_folders(paths: Sequence[Path]) -> list[Path]:
    """Run folders, or those within other folders: the next level of folders that has any, else all levels.

    Raises:
        StudyError: There is none in a folder.
    """
    found = []
    for path in paths:
        within = (sorted(path.glob(f"{below}{JOURNAL}")) for below in ("", "*/", "**/"))
        folders = [file.parent for file in next(filter(None, within), [])]
        if not folders:
            what = f"found no {JOURNAL} in it or below" if path.is_dir() else "found no such folder"
            raise StudyError(f"{path}: expected a run folder, or a folder of run folders, {what}")
        found += folders
    return list(dict.fromkeys(found))


def table_of_races(name: str, folders: Sequence[Path], by: str) -> StudyTable:
    """The table of the winners of run folders.

    Races that are equal in all factors are repetitions, numbered by their seeds among those of all races: two races of
    equal seeds are a pair.

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
    numbers = {seed: k for k, seed in enumerate(sorted({design.seed for design in designs}), start=1)}
    runs = pd.DataFrame([row for cell in cells.values() for row in _rows(cell, numbers)])
    ranges = {
        (one.place["mission"], objective) if objective else one.place["mission"]: possible
        for one in designs
        for objective, possible in one.possible.items()
    }
    table = StudyTable(
        name=name,
        runs=runs if runs["objective"].any() else runs.drop(columns="objective"),
        directions={place: "maximise" if one.maximise else "minimise" for place, one in ranges.items()},
        limits={place: _finite(one) for place, one in ranges.items()},
        by=by,
        fronts=pd.DataFrame([row for cell in cells.values() for row in _front_rows(cell, numbers)]),
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
    possible = _possible(folder, start)
    tests = _tests(record, len(possible)) if winner_tests(record) else _assessed(folder, len(possible))
    if not tests:
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
        tests=tests,
        possible=possible,
    )


def _tests(record: Record, n_objectives: int) -> dict[str, dict[int, tuple[float, ...]]]:
    """What a race tested in its end, of which the winner comes first."""
    found: dict[str, dict[int, tuple[float, ...]]] = {file_on_front(record.view.leader): {}}
    for where in sorted(record.tests):
        if (one := record.tests[where]).score is not None:
            scores = (one.score,) if n_objectives == 1 else one.scores
            found.setdefault(file_on_front(one.configuration), {})[one.seed] = scores
    return found


def _assessed(folder: Path, n_objectives: int) -> dict[str, dict[int, tuple[float, ...]]]:
    """What a study assessed in the design model, if the race is a cell of one."""
    known = read_assessment(folder)
    found = {} if known is None else front_scores(folder, known, DESIGN_MODEL, n_objectives)
    return {file: dict(enumerate(own)) for file, own in found.items()}


def _possible(folder: Path, start: Mapping[str, Any]) -> Mapping[str, ScoreRange]:
    try:
        return scores_by_objective(folder, start)
    except MissionError as error:
        raise StudyError(*error.messages) from None


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

    return [replace(one, place=named(one)) for one in designs]


def _rows(cell: Mapping[int, RaceDesign], numbers: Mapping[int, int]) -> Iterator[dict[str, Any]]:
    for seed, design in sorted(cell.items()):
        start = {**design.place, "repetition": numbers[seed], "seed": seed, "reality": DESIGN_MODEL}
        for instance, scores in next(iter(design.tests.values())).items():
            for objective, score in zip(design.possible, scores, strict=True):
                yield {**start, "instance": instance, "objective": objective, "score": score}


def _front_rows(cell: Mapping[int, RaceDesign], numbers: Mapping[int, int]) -> Iterator[dict[str, Any]]:
    """Rows of the fronts of races by several objectives."""
    for seed, design in sorted(cell.items()):
        if len(design.possible) > 1:
            place = {**design.place, "repetition": numbers[seed], "seed": seed, "reality": DESIGN_MODEL}
            scores = {file: [*own.values()] for file, own in design.tests.items()}
            yield from front_rows(place, scores, {name: one.maximise for name, one in design.possible.items()})


def _finite(possible: ScoreRange) -> tuple[float | None, float | None]:
    low, high = (limit if abs(limit) < float("inf") else None for limit in (possible.low, possible.high))
    return low, high
