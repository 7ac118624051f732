"""Rows of the index, from the file of a job and its run folder."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from mercator_design.config.yaml_tree import LOADER
from mercator_design.errors import RaceError, excerpt, printable
from mercator_design.race.session.journal import Reading
from mercator_design.race.session.record import OtherVersion
from mercator_design.race.session.view import RaceView
from mercator_design.results.files import read_journal
from mercator_design.results.listing import run_of
from mercator_design.serve.jobs.index import IndexRow
from mercator_design.serve.jobs.job import MAX_SEED, Job, RaceRequest, State, state_of
from mercator_design.serve.jobs.races import RaceStatus
from mercator_design.serve.jobs.work import WorkStatus
from mercator_design.system.files import Unreadable, read_small

_MAX_SIZE = 1024 * 1024  # bytes of a mission
_STATES: dict[str, State] = {"running": "running", "finished": "finished", "stopped": "paused"}
"""States of jobs by those of run folders; others have failed."""
_NO_REQUEST = RaceRequest(mission="", budget=0, method="", flavour="", seed=0)


def row_of_job(job: Job, status: WorkStatus, problem: str = "", *, is_running: bool) -> IndexRow:
    """Row of a job, with the last reading of its race or study, and the problem of its folder."""
    state = state_of(job, is_finished=status.is_finished(job.request.budget), is_running=is_running)
    if problem and state == "queued":
        state = "failed"
    message = "" if state == "finished" else job.failure or problem
    return IndexRow(job=job, state=state, message=message, **figures_of(status))


def figures_of(status: WorkStatus) -> dict[str, Any]:
    """Figures of a row, from the last reading of its race or study, which has no score of its own."""
    score = score_of(status.view) if isinstance(status, RaceStatus) else {}
    return {"experiments": status.n_experiments, **score}


def score_of(view: RaceView) -> dict[str, Any]:
    """Score of the winner or the best so far, and where it was measured, as fields of a row."""
    headline = view.headline()
    return {} if headline is None else {"best": headline.scores.mean, "measured": headline.where}


def changed_row(row: IndexRow, job: Job, *, is_running: bool) -> IndexRow:
    """Row of a job whose file was changed, and whose race was not."""
    is_finished = row.state == "finished" and row.job.request.budget >= job.request.budget
    state = state_of(job, is_finished=is_finished, is_running=is_running)
    return replace(row, job=job, state=state, message="" if state == "finished" else job.failure)


def row_of_folder(folder: Path, reading: Reading) -> IndexRow | None:
    """Row of a run folder of no job, after reading on in its journal; None if no race has begun there."""
    name = folder.name
    job = Job(id=name, owner="", name=name, direction="maximise", request=_NO_REQUEST, submitted="")
    try:
        read_journal(folder, reading)
    except RaceError as error:
        what = "of another version: " if isinstance(error, OtherVersion) else ""
        return IndexRow(job=job, state="failed", message=what + error.messages[0])
    record, found = reading.record, run_of(folder, reading)
    if not record.start:
        return None
    request = replace(
        _NO_REQUEST, budget=min(record.budget, MAX_SEED), method=str(found["method"]),
        flavour=printable(excerpt(str(found["flavour"] or ""))), seed=min(int(found["seed"]), MAX_SEED),
    )  # fmt: skip
    job = replace(
        job, name=printable(excerpt(str(found["name"]))), direction=_direction(folder), request=request,
        submitted=found["started"] or "",
    )  # fmt: skip
    return IndexRow(
        job=job, state=_STATES.get(found["state"], "failed"), message="; ".join(found["notes"]),
        experiments=found["experiments"], **score_of(record.view),
    )  # fmt: skip


def _direction(folder: Path) -> str:
    """Direction of the scores of a run folder, from its mission; "minimise" without a mission."""
    try:
        mission = yaml.load(read_small(folder / "mission.yaml", _MAX_SIZE), Loader=LOADER)  # noqa: S506 - a safe loader
        return "maximise" if mission["objective"]["direction"] == "maximise" else "minimise"
    except (Unreadable, yaml.YAMLError, KeyError, TypeError, ValueError, RecursionError):
        return "minimise"
