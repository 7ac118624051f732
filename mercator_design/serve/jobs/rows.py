"""Rows of lists, made of the file of a job and of its run folder."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from mercator_design.config.yaml_tree import LOADER
from mercator_design.errors import RaceError, excerpt, printable
from mercator_design.race.session.journal import Reading
from mercator_design.race.session.record import OtherVersion
from mercator_design.results.files import read_journal
from mercator_design.results.listing import run_of
from mercator_design.serve.jobs.index import IndexRow
from mercator_design.serve.jobs.job import MAX_SEED, Job, State, state_of
from mercator_design.serve.jobs.races import RaceStatus
from mercator_design.system.files import Unreadable, read_small

_MAX_SIZE = 1024 * 1024  # bytes of a mission
_STATES: dict[str, State] = {"running": "running", "finished": "finished", "stopped": "paused"}
"""States of jobs by those of run folders; others have failed."""


def row_of_job(job: Job, status: RaceStatus, problem: str = "", *, is_running: bool) -> IndexRow:
    """The row of a job, by the last reading of its race, and with what is wrong with its run folder."""
    request = job.request
    state = state_of(job, is_finished=status.is_finished(request.budget), is_running=is_running)
    if problem and state == "queued":
        state = "failed"
    return IndexRow(
        id=job.id, owner=job.owner, name=job.name, state=state, wish=job.wish,
        method=request.method, flavour=request.flavour, message="" if state == "finished" else job.failure or problem,
        seed=request.seed, budget=request.budget, priority=request.priority, direction=job.direction,
        experiments=status.view.n_experiments, best=status.view.best_score, tested=status.view.tested_score,
        submitted=job.submitted, ended=job.ended, seconds=job.seconds, shared=job.shared, key=job.key,
    )  # fmt: skip


def changed_row(row: IndexRow, job: Job, *, is_running: bool) -> IndexRow:
    """The row of a job whose file was changed; its race is as it was."""
    request = job.request
    is_finished = row.state == "finished" and row.budget >= request.budget
    state = state_of(job, is_finished=is_finished, is_running=is_running)
    return replace(
        row, state=state, wish=job.wish, message="" if state == "finished" else job.failure,
        budget=request.budget, priority=request.priority, ended=job.ended, shared=job.shared,
    )  # fmt: skip


def is_of(row: IndexRow, job: Job) -> bool:
    """Whether the row of a job that has ended agrees with the job's file."""
    request = job.request
    same = replace(
        row, owner=job.owner, wish=job.wish, budget=request.budget, priority=request.priority, submitted=job.submitted,
        ended=job.ended, shared=job.shared, key=job.key,
    )  # fmt: skip
    return row == same and (not job.failure or row.message == job.failure)


def row_of_folder(folder: Path, reading: Reading) -> IndexRow | None:
    """The row of a run folder that is of no job, whose journal is read on; None if no race has begun there."""
    try:
        read_journal(folder, reading)
    except RaceError as error:
        what = "of another version: " if isinstance(error, OtherVersion) else ""
        return IndexRow(id=folder.name, owner="", name=folder.name, state="failed", message=what + error.messages[0])
    record, found = reading.record, run_of(folder, reading)
    if not record.start:
        return None
    raced: dict[str, Any] = {"experiments": found["experiments"], "best": found["score"], "tested": found["tested"]}
    return IndexRow(
        id=folder.name, owner="", name=printable(excerpt(str(found["name"]))), method=str(found["method"]),
        flavour=printable(excerpt(str(found["flavour"] or ""))), seed=min(int(found["seed"]), MAX_SEED),
        state=_STATES.get(found["state"], "failed"), message="; ".join(found["notes"]),
        budget=min(record.budget, MAX_SEED), submitted=found["started"] or "", direction=_direction(folder), **raced,
    )  # fmt: skip


def _direction(folder: Path) -> str:
    """Whether the scores of a run folder are maximised, by its mission; others are costs."""
    try:
        mission = yaml.load(read_small(folder / "mission.yaml", _MAX_SIZE), Loader=LOADER)  # noqa: S506 - a safe loader
        return "maximise" if mission["objective"]["direction"] == "maximise" else "minimise"
    except (Unreadable, yaml.YAMLError, KeyError, TypeError, ValueError, RecursionError):
        return "minimise"
