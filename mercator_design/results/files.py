"""Reads a run folder: its journal, its task and its provenance."""

import json
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from mercator_design import __version__
from mercator_design.config.json_data import from_json
from mercator_design.config.schema import Kind, Range
from mercator_design.designer import GOAL, Designer
from mercator_design.errors import RaceError, excerpt
from mercator_design.missions.mission import load_mission
from mercator_design.race import Space
from mercator_design.race.irace.tuner import Tuner
from mercator_design.race.methods.table import METHODS
from mercator_design.race.session.journal import Reading
from mercator_design.race.session.record import OtherVersion, Record
from mercator_design.race.session.task import Task
from mercator_design.results.provenance import PROVENANCE, Provenance, not_a_run_folder
from mercator_design.results.provenance import read as read_provenance_file
from mercator_design.scores import ANY_SCORE, ScoreRange

JOURNAL = "journal.jsonl"
TASKS: Mapping[str, type[Task[Any]]] = {"mission": Designer, "scenario": Tuner}
"""The tasks, by their names in the start of a race."""
_VERBS: Mapping[str, str] = {"mission": "race", "scenario": "tune"}
_START: Mapping[str, Kind] = {
    "mercator_design": str,
    "name": str,
    "method": str,
    "budget": Annotated[int, Range(1)],
    "seed": Annotated[int, Range(0)],
}


def resume_command(path: Path, task: str, *options: str) -> str:
    """The command that resumes the race of a run folder, for a shell; `task` is a key of TASKS."""
    return shlex.join(["mdesign", _VERBS[task], "--resume", str(path), *options])


def task_of(path: Path) -> Task[Any]:
    """Restore the task of a run folder, for reports.

    Raises:
        RaceError: if there is no race.
        MissionError: if its mission, robot model or plugins cannot be read.
    """
    start = read_provenance(path).race
    return TASKS[str(start["task"])].restore(path, start)


def restored(path: Path) -> Task[Any]:
    """Restore the task of a run folder, to run its experiments again.

    Raises:
        RaceError: if there is no race, or the same race cannot be run by this program.
        MissionError: if its mission, robot model or plugins cannot be read.
    """
    task, start = task_of(path), read_provenance(path).race
    raced, now = flat(start), flat(task.start())
    for key in {**now, **raced}:
        # Another version may give the same results.
        if key != "mercator_design" and not is_same(now.get(key), raced.get(key)):
            raise RaceError(
                f"{path}: {key}: raced with {excerpt(str(raced.get(key, 'nothing')))} "
                f"by mercator_design {start['mercator_design']}, "
                f"found {excerpt(str(now.get(key, 'nothing')))} in mercator_design {__version__}: "
                "this version cannot continue, verify or ablate the race"
            )
    return task


def flat(start: Mapping[str, Any]) -> Mapping[str, Any]:
    """A start with a key for each option."""
    options = start.get("options")
    if not isinstance(options, Mapping):
        return start
    return {key: value for key, value in start.items() if key != "options"} | {
        f"options.{name}": value for name, value in options.items()
    }


def is_same(one: object, other: object) -> bool:
    """Whether two values are equal as JSON, where 1 differs from 1.0 and from true."""
    return json.dumps(one, sort_keys=True) == json.dumps(other, sort_keys=True)


def read_provenance(path: Path) -> Provenance:
    """Read the provenance of a run folder.

    Raises:
        OtherVersion: see there.
        RaceError: if it is not a run folder, or its provenance is damaged.
    """
    if unfinished := without_provenance(path):
        raise RaceError(unfinished)
    found = read_provenance_file(path)
    _check_start(found.race, f"{path / PROVENANCE}: race")
    return found


def goal_of(start: Mapping[str, Any]) -> str:
    """The objectives of a race by several, in words; empty for others."""
    return str(start.get(GOAL, ""))


def possible_scores(path: Path) -> ScoreRange:
    """The range of the scores in a run folder; all scores if its provenance does not tell it."""
    try:
        return read_provenance(path).possible_scores
    except RaceError:
        return ANY_SCORE


def scores_by_objective(path: Path, start: Mapping[str, Any]) -> Mapping[str, ScoreRange]:
    """The ranges of the scores of a race by each of its objectives; one without a name, if there are not several.

    Raises:
        MissionError: It has several, and its mission, which tells them, cannot be read.
    """
    return load_mission(path / "mission.yaml").compared_by() if GOAL in start else {"": possible_scores(path)}


def without_provenance(path: Path) -> str:
    """Advice for a folder with a journal, but without provenance; empty for others.

    Raises:
        RaceError: Its journal cannot be read.
    """
    journal = path / JOURNAL
    if (path / PROVENANCE).exists() or not journal.is_file():
        return ""
    if not journal.stat().st_size:
        return f"{path}: the race was interrupted before it began; begin it again with -o {path}"
    if not (start := read_journal(path).record.start):
        return ""
    command = TASKS[start["task"]].command(start, path)
    return (
        f"{path}: a race has begun here, but its {PROVENANCE} is missing, so it cannot be resumed: restore a copy, "
        f"or begin the race again in another folder with: {command} -o ANOTHER"
    )


def read_journal(path: Path, before: Reading | None = None) -> Reading:
    """Read the journal of a run folder, which another process may be writing; continue an earlier reading, if given.

    Raises:
        OtherVersion: see there.
        RaceError: if there is no journal, or it is corrupt.
    """
    if before is None and not (path / JOURNAL).exists() and not (path / PROVENANCE).exists():
        raise not_a_run_folder(path)
    reading = before or Reading(path / JOURNAL)
    reading.read_on()
    if reading.record.start:
        _check_start(reading.record.start, f"{path / JOURNAL}, line 1: start")
    return reading


def wrong_end(path: Path, record: Record) -> str:
    """Compare the end of a journal with the provenance; return what is wrong, or nothing.

    This finds missing lines at the end, which the checksums do not show.

    Raises:
        RaceError: if the folder's provenance cannot be read.
    """
    provenance = read_provenance(path)
    found = {end.budget: end.digest for end in record.ends}
    expected, budget = provenance.journal, provenance.budget
    if expected is None or expected in found.values():
        return ""
    if budget in found:
        return f"{path / JOURNAL}: expected the digest {expected[:64]}, as {PROVENANCE} says, found {found[budget]}"
    return (
        f"{path / JOURNAL}: expected the end of the race after {provenance.experiments} experiments, as {PROVENANCE} "
        f"says, found none after {len(record.experiments)} experiments: lines are missing at its end; --resume runs "
        "their experiments again"
    )


def check_same(path: Path, record: Record, provenance: Provenance) -> None:
    """Check that the journal of a run folder is of the race in its provenance.

    Raises:
        RaceError: It is of another race.
    """
    if not is_same({**record.start, "format": None}, {**provenance.race, "format": None}):
        raise RaceError(f"{path}: expected {JOURNAL} to be of the race in {PROVENANCE}, found another race")


def check_configurations(path: Path, record: Record, space: Space) -> None:
    """Check that the configurations of a journal belong to a space.

    Raises:
        RaceError: with the first that does not.
    """
    for number, configuration in record.configurations.items():
        try:
            space.check(configuration)
        except RaceError as error:
            raise RaceError(f"{path / JOURNAL}: configuration {number}: {error}") from None


def _check_start(start: Mapping[str, Any], label: str) -> None:
    """Check that the start of a race has all keys that reports and `Task.restore` read."""
    task = start.get("task")
    wanted = {**_START, **TASKS[task].START} if isinstance(task, str) and task in TASKS else None
    if wanted is None or not wanted.keys() <= start.keys():
        by = excerpt(str(start.get("mercator_design", "another version")))
        raise OtherVersion(
            f"{label}: expected the start of a race as mercator_design {__version__} writes it, found that of another "
            f"build ({by}), which can read it"
        )
    for key, kind in wanted.items():
        from_json(start[key], kind, error=RaceError, label=label, path=key)
    if start["method"] not in METHODS:
        raise OtherVersion(
            f"{label}: method: expected {', '.join(METHODS)}, found {excerpt(start['method'])}, a method of another "
            f"version: mercator_design {excerpt(str(start['mercator_design']))} can read it"
        )
