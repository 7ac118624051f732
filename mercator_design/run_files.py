"""What a run folder says, read: its provenance, its journal, and the task that both are about."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mercator_design import __version__
from mercator_design.design import Designer
from mercator_design.errors import RaceError, excerpt
from mercator_design.files import Unreadable, read_small
from mercator_design.race.journal import Reading, read
from mercator_design.race.task import Task
from mercator_design.race.tuner import Tuner

JOURNAL = "journal.jsonl"
PROVENANCE = "provenance.json"
TASKS: Mapping[str, type[Task[Any]]] = {"mission": Designer, "scenario": Tuner}
"""What can be raced, by the name that a race's start has for it."""
_LARGEST_PROVENANCE = 1024 * 1024  # bytes
_START: Mapping[str, type] = {"mercator_design": str, "name": str, "method": str, "budget": int, "seed": int}


def task_of(path: Path) -> Task[Any]:
    """The task of a run folder, as this program understands it.

    Raises:
        RaceError: if there is none.
        MissionError: if its mission, robot model or plugins cannot be read.
    """
    start = read_provenance(path)["race"]
    return TASKS[start["task"]].restore(path, start)


def restored(path: Path) -> Task[Any]:
    """The task of a run folder, whose experiments this program runs as they were run.

    Raises:
        RaceError: if there is none, or this program would run another race.
        MissionError: if its mission, robot model or plugins cannot be read.
    """
    task, start = task_of(path), read_provenance(path)["race"]
    here = json.loads(json.dumps(task.start()))
    for key in here:
        if key != "mercator_design" and here[key] != start.get(key):  # another version may do all the same
            raise RaceError(
                f"{path}: {key}: raced with {excerpt(str(start.get(key)))} by mercator_design "
                f"{start['mercator_design']}, found {excerpt(str(here[key]))} in mercator_design {__version__}: "
                "the race cannot be continued, verified or ablated by this"
            )
    return task


def read_provenance(path: Path) -> dict[str, Any]:
    """What a run folder says of where it comes from.

    Raises:
        RaceError: if it is none.
    """
    file = path / PROVENANCE
    try:
        provenance = json.loads(read_small(file, _LARGEST_PROVENANCE))
        valid = isinstance(provenance["request"], dict) and _is_start(provenance["race"])
    except Unreadable as error:
        raise RaceError(f"{path}: expected the folder of a race, found that {file.name}: {error}") from None
    except (ValueError, KeyError, TypeError, RecursionError):
        valid = False
    if not valid:
        raise RaceError(f"{file}: expected what mdesign race writes, found something else")
    found: dict[str, Any] = provenance
    return found


class OtherVersion(RaceError):  # noqa: N818 - nothing is wrong with it
    """A journal was written by another version of this program, which says other things of races."""


def read_journal(path: Path) -> Reading:
    """The journal of a run folder as it is; others may be writing it.

    Raises:
        OtherVersion: see there.
        RaceError: if there is none, or it is corrupt.
    """
    reading = read(path / JOURNAL)
    start = reading.record.start
    if start and not _is_start(start):
        found = excerpt(str(start.get("mercator_design", "another version")))
        raise OtherVersion(
            f"{path / JOURNAL}, line 1: expected the start of a race as mercator_design {__version__} writes it, found "
            f"that of another build ({found}), which can read it"
        )
    return reading


def _is_start(start: object) -> bool:
    """Whether it has what reports and `Task.restore` read."""
    if not isinstance(start, dict) or str(start.get("task")) not in TASKS:
        return False
    wanted = {**_START, **TASKS[str(start["task"])].START}
    return all(isinstance(start.get(key), kind) for key, kind in wanted.items())
