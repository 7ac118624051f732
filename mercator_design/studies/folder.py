"""The folder of a study: its files, whose it is, and which processes work in it.

study.yaml         the plan, with all defaults and with paths from here, so that folders may be given to others
files/             copies of the missions and control software that it names, if it needs no other files
study.json         names and definitions of all that the cells are made of; a changed definition is refused
cells/MISSION/METHOD/BUDGET/REPETITION/
                   a run folder of its own (results/folder.py), and assessment.json (assessment.py)
locks/             one for the whole study, one for each part

A lock ends with its process, whatever ends it. Processes that run parts of a study share the lock of the whole.
"""

import contextlib
import fcntl
import json
import os
import socket
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

from mercator_design import __version__
from mercator_design.config.json_data import read_json
from mercator_design.config.schema import Range
from mercator_design.config.writing import dump, plain
from mercator_design.config.yaml_tree import text_of
from mercator_design.errors import MissionError, StudyError, excerpt
from mercator_design.missions.mission import parse_mission
from mercator_design.results.files import is_same
from mercator_design.studies.layout import Cell, StudyLayout, alike_on_disk
from mercator_design.studies.plan import StudyMission, StudyPlan
from mercator_design.studies.resolving import Study
from mercator_design.system.files import remove_drafts, write_bytes, write_text, writing

FACTS, PLAN, CELLS = "study.json", "study.yaml", "cells"
_FILES, _LOCKS, _WHOLE, _FACTS_LOCK = "files", "locks", "study", "facts"
_FORMAT = 1
_MAX_CHANGES = 10
_MAX_WAIT = 30.0
"""Seconds to wait for another part that is writing the facts of the study."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyFacts:
    """The contents of study.json.

    program: The simulator and plugins: the same for all cells.
    definition: All that has ever been in the study, by kind and name.
    layout: The cells of the study as it is now.
    """

    format: Annotated[int, Range(1)] = _FORMAT
    name: str
    mercator_design: str
    program: Mapping[str, object]
    definition: Mapping[str, Mapping[str, object]]
    layout: StudyLayout


@dataclass(frozen=True, slots=True)
class Part:
    """One of several processes that share the cells of a study; numbered from 1."""

    number: int
    n_parts: int

    def __str__(self) -> str:
        return f"{self.number}/{self.n_parts}"


class StudyFolder:
    """The folder of a study, locked for this process; a context manager that ends the lock."""

    def __init__(self, path: Path, facts: StudyFacts, locks: contextlib.ExitStack) -> None:
        self.path, self.facts = path, facts
        self._locks = locks

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._locks.close()

    def cell(self, cell: Cell) -> Path:
        """The run folder of a cell."""
        return self.path / CELLS / cell.path

    @classmethod
    def open(cls, path: Path, study: Study, part: Part | None = None) -> Self:
        """Create or continue the folder of a study.

        Raises:
            StudyError: It has another study, other files, or other definitions; another process works on the same
                cells; or it cannot be written.
        """
        with writing(path, StudyError):
            is_known = (path / FACTS).exists()
            if not is_known and path.exists() and any(one.name != _LOCKS for one in path.iterdir()):
                raise StudyError(
                    f"{path}: expected a new or empty folder, or that of this study, found other files in it"
                )
            (path / _LOCKS).mkdir(parents=True, exist_ok=True)
            with contextlib.ExitStack() as locks:
                _lock_cells(path, part, locks)
                with contextlib.ExitStack() as writing_facts:
                    _wait_for_lock(path, writing_facts)
                    facts = _facts_of(path, study)
                    for name in (FACTS, PLAN):
                        remove_drafts(path / name)
                    write_text(path / FACTS, json.dumps(plain(facts), indent=1) + "\n")
                    write_text(path / PLAN, dump(study.plan.seen_from(path, _copied(path, study.plan))))
                return cls(path, facts, locks.pop_all())


def lock_file(path: Path) -> Path:
    """The file that is locked while a process runs a study."""
    return path / _LOCKS / _WHOLE


def read_facts(path: Path) -> StudyFacts:
    """Read what a study's folder says of itself.

    Raises:
        StudyError: It is no study's folder, or of another version, or damaged.
    """
    file = path / FACTS
    if not file.exists():
        raise StudyError(f"{path}: not the folder of a study: {FACTS} is missing")
    with contextlib.suppress(OSError, ValueError, TypeError, KeyError):
        found = json.loads(file.read_text())
        if found["format"] != _FORMAT:
            by = excerpt(str(found.get("mercator_design")))
            raise StudyError(
                f"{file}: expected format {_FORMAT}, found {found['format']}: mercator_design {by} can read it"
            )
    facts: StudyFacts = read_json(file, StudyFacts, error=StudyError)
    return facts


def _facts_of(path: Path, study: Study) -> StudyFacts:
    """The facts of a study with what its folder has already.

    Raises:
        StudyError: The folder has another study, or something in it has another definition.
    """
    program, definition = study.program, study.definition
    if (path / FACTS).exists():
        before = read_facts(path)
        found, now = (before.name, before.layout.seed), (study.plan.name, study.plan.seed)
        if found != now:
            raise StudyError(
                f"{path}: expected the study {now[0]} with seed {now[1]}, found the study {found[0]} with seed "
                f"{found[1]}: give another folder (-o)"
            )
        changed = [*_changes(program, before.program, "program", grows=False)]
        if changed:
            raise StudyError(
                f"{path}: mercator_design {__version__} cannot add to this study of {before.mercator_design}: "
                + "; ".join(changed)
            )
        wrong = [
            f"{path}: {what}: give it another name, or begin another study"
            for kind in definition
            for what in _changes(definition[kind], before.definition.get(kind, {}), kind, grows=True)
        ]
        wrong += [
            f"{path}: {kind}: {what}"
            for kind in ("missions", "methods")
            if (what := alike_on_disk([*before.definition.get(kind, {}), *definition[kind]]))
        ]
        if wrong:
            raise StudyError(*wrong[:_MAX_CHANGES])
        definition = {kind: _grown(before.definition.get(kind, {}), now_) for kind, now_ in definition.items()}
    return StudyFacts(
        name=study.plan.name,
        mercator_design=__version__,
        program=program,
        definition=definition,
        layout=study.layout,
    )


def _copied(path: Path, plan: StudyPlan) -> dict[str, Path]:
    """Copy the files of a plan to its study's folder. Returns the copies, by the paths in the plan.

    Nothing is copied if the folder would still need other files. What is in the folder stays where it is. A copy keeps
    the name of its file, of which its mission may have its own.
    """
    named = dict.fromkeys(plan.files.values())
    if plan.other_files or not all(_is_whole(one) for one in plan.mission_entries if one.mission in named):
        return {}
    taken = {file: Path(file).resolve() for file in named if Path(file).resolve().is_relative_to(path.resolve())}
    copies: dict[str, Path] = {}
    for file in (one for one in named if one not in taken):
        folders = (path / _FILES / below for below in ("", *map(str, range(2, len(named) + 2))))
        copies[file] = next(
            to for to in (one / Path(file).name for one in folders) if to.resolve() not in taken.values()
        )
        taken[file] = copies[file].resolve()
        copies[file].parent.mkdir(parents=True, exist_ok=True)
        remove_drafts(copies[file])
        write_bytes(copies[file], Path(file).read_bytes())
    return copies


def _is_whole(entry: StudyMission) -> bool:
    """Whether a mission's file names no other files."""
    try:
        parse_mission(text_of(Path(entry.mission or ""), error=MissionError), files=False, overrides=entry.set)
    except MissionError:
        return False
    return True


def _changes(now: Any, before: Any, place: str, *, grows: bool) -> Iterator[str]:  # noqa: ANN401 - JSON
    """The differences of plain data; a map that grows may have keys that others lack, and so may `files` in it."""
    if isinstance(now, Mapping) and isinstance(before, Mapping):
        for key in now if grows else {**before, **now}:
            if key in before or not grows:
                yield from _changes(now.get(key), before.get(key), f"{place}.{key}", grows=key == "files")
    elif isinstance(now, list) and isinstance(before, list) and len(now) == len(before):
        for index, (one, other) in enumerate(zip(now, before, strict=True)):
            yield from _changes(one, other, f"{place}[{index}]", grows=False)
    elif not is_same(now, before):
        yield (
            f"{place}: expected {excerpt(json.dumps(before))}, as in the cells that have run, "
            f"found {excerpt(json.dumps(now))}"
        )


def _grown(before: Mapping[str, Any], now: Mapping[str, Any]) -> dict[str, Any]:
    """Definitions of before and now; of hand-made files all that there were."""
    merged = {**before, **now}
    for name in before.keys() & now.keys():
        if isinstance(before[name], Mapping) and "files" in before[name]:
            merged[name] = {**now[name], "files": {**before[name]["files"], **now[name]["files"]}}
    return merged


def _lock_cells(path: Path, part: Part | None, locks: contextlib.ExitStack) -> None:
    """Lock the whole study, or share it and lock a part.

    Raises:
        StudyError: Another process has the lock.
    """
    if part is None:
        _lock(path, _WHOLE, locks, fcntl.LOCK_EX)
        return
    _lock(path, _WHOLE, locks, fcntl.LOCK_SH)
    _lock(path, f"part-{part.number}-of-{part.n_parts}", locks, fcntl.LOCK_EX)
    for file in (path / _LOCKS).glob("part-*-of-*"):
        if not file.name.endswith(f"-of-{part.n_parts}"):
            # Of another number of parts, which shares cells with this one. Other parts try it at the same time.
            with contextlib.ExitStack() as tried:
                _lock(path, file.name, tried, fcntl.LOCK_SH)


def _wait_for_lock(path: Path, locks: contextlib.ExitStack) -> None:
    end = time.monotonic() + _MAX_WAIT
    while True:
        try:
            return _lock(path, _FACTS_LOCK, locks, fcntl.LOCK_EX)
        except StudyError:
            if time.monotonic() > end:
                raise
            time.sleep(0.05)


def _lock(path: Path, name: str, locks: contextlib.ExitStack, how: int) -> None:
    """Lock a file until the stack is closed; file systems without locks are not checked."""
    number = os.open(path / _LOCKS / name, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    locks.callback(os.close, number)
    try:
        fcntl.flock(number, how | fcntl.LOCK_NB)
    except BlockingIOError:
        holder = os.pread(number, 200, 0).decode(errors="replace").strip() or "another process"
        what = "" if name == _WHOLE else f", {name.replace('-', ' ')}"
        raise StudyError(
            f"{path}: {excerpt(holder)} is working on this study{what}; several processes share one by --part K/N"
        ) from None
    except OSError:  # some network file systems have no locks
        return
    if how == fcntl.LOCK_EX:
        os.ftruncate(number, 0)
    os.pwrite(number, f"process {os.getpid()} on {socket.gethostname()}\n".encode(), 0)
