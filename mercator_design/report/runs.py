"""Reports on races from their journals: a table of all, or a page on one."""

import json
from pathlib import Path
from typing import Any

from mercator_design.errors import RaceError, printable
from mercator_design.race.racing.summary import Scores
from mercator_design.race.running.events import SessionStarted, SessionStopped
from mercator_design.race.running.journal import Reading, is_locked
from mercator_design.race.running.record import Record
from mercator_design.report.columns import aligned
from mercator_design.report.iterations import iteration_notes, iterations_table
from mercator_design.report.summary import test_lines
from mercator_design.runs.files import JOURNAL, TASKS, OtherVersion, read_journal, wrong_end


def runs_table(folder: Path) -> tuple[str, list[str]]:
    """A table of the races in the subfolders of a folder, and notes on damaged ones.

    Raises:
        RaceError: if there is no such folder.
    """
    found = _runs(folder)
    names = ("run", "name", "method", "seed", "experiments", "budget", "state", "started")
    rows: list[tuple[object, ...]] = [(*names, "mean of winner")]
    for run in found:
        score = None if run["score"] is None else f"{run['score']:.4g}"
        rows.append((*(run[name] for name in names), score))
    wrong = [run for run in found if run["state"] in {"damaged", "end missing"}]
    return "\n".join(aligned(rows)), [note for run in wrong for note in run["notes"]]


def runs_json(folder: Path) -> str:
    """The table as JSON.

    Raises:
        RaceError: if there is no such folder.
    """
    return json.dumps(_runs(folder), indent=2)


def run_summary(path: Path) -> str:
    """A page on the race of a run folder.

    Raises:
        RaceError: if there is no race, or its journal is corrupt.
    """
    reading = read_journal(path)
    record, run = reading.record, run_of(path, reading)
    if not record.start:
        return f"{path}: no race has begun here yet"
    task = TASKS[record.start["task"]]
    counted = {(one.configuration, one.instance) for one in record.experiments.values()}
    n_extra = sum(place not in counted for place in record.speculative)
    failed = sum(one.score is None for one in record.results())
    lines = [
        *task.about(record.start),
        f"Race       {record.start['method']}, {run['experiments']} of {run['budget']} experiments, "
        f"{len(record.configurations)} configurations",
        *(
            [f"Extended   from a budget of {', '.join(map(str, record.budgets[:-1]))}"]
            if len(record.budgets) > 1
            else []
        ),
        *([f"Failed     {failed} experiments; their configurations were rejected"] if failed else []),
        *([f"Extra      {n_extra} speculative experiment{'s' * (n_extra != 1)}, not counted"] if n_extra else []),
        f"State      {run['state']}",
        *(f"           {_session(session)}" for session in record.sessions),
        *([f"Note       {reading.torn}: incomplete, for example after a loss of power"] if reading.torn else []),
        *(f"Note       {note}" for note in run["notes"]),
        f"Digest     {record.digest()}",
    ]
    if record.iterations:
        lines += ["", *iterations_table(record), *iteration_notes(record), ""]
    if run["winner"] is not None:
        winner = [record.configurations[run["winner"]]]
        task.check(record.start, winner)
        columns = task.columns(record.start, winner)
        tests = {number: Scores(scores) for number, scores in record.test_scores().items()}
        lines += [f"Winner     configuration {run['winner']}, mean score {run['score']:.4g}"]
        lines += test_lines(record, tests, "on fresh instances")
        lines += [""]
        lines += [f"{value}" if len(columns) == 1 else f"{name} = {value}" for name, [value] in columns.items()]
    return "\n".join(map(printable, lines))


def _runs(folder: Path) -> list[dict[str, Any]]:
    try:
        journals = sorted(folder.glob(f"*/{JOURNAL}"), key=_modified)
        found = folder.is_dir()
    except OSError as error:
        raise RaceError(f"{folder}: cannot be read: {error.strerror}") from None
    if not found:
        raise RaceError(f"{folder}: no such folder")
    runs = []
    for journal in journals:
        try:
            runs.append(run_of(journal.parent, read_journal(journal.parent)))
        except RaceError as error:
            state = "of another version" if isinstance(error, OtherVersion) else "damaged"
            notes = [*error.messages]
            runs.append(dict.fromkeys(_KEYS) | {"run": str(journal.parent), "state": state, "notes": notes})
    return runs


def _modified(file: Path) -> float:
    try:
        return file.stat().st_mtime
    except OSError:  # a broken link, or just removed
        return 0.0


_KEYS = ("run", "name", "method", "seed", "experiments", "budget", "state", "started", "winner", "score", "notes")


def run_of(path: Path, reading: Reading) -> dict[str, Any]:
    """What a table of races says of one: see `_KEYS`."""
    record = reading.record
    run: dict[str, Any] = dict.fromkeys(_KEYS) | {"run": str(path), "experiments": len(record.experiments)}
    is_running, (missing, warnings) = is_locked(path / JOURNAL), _warnings(path, record)
    if is_running:
        run["state"] = "running"
    elif missing:
        run["state"] = "damaged" if record.is_complete else "end missing"
    elif record.start and record.is_complete:
        run["state"] = "finished"
    else:
        run["state"] = "stopped"
    run["notes"] = [] if is_running else [missing] * bool(missing) + warnings
    if record.start:
        run |= {name: record.start[name] for name in ("name", "method", "seed")} | {"budget": record.budget}
    if record.sessions:
        run["started"] = record.sessions[0].time
    if record.ends:
        winner = record.ends[-1].winner
        scores = [one.score for one in record.results() if one.configuration == winner and one.score is not None]
        run |= {"winner": winner, "score": sum(scores) / len(scores)}
    return run


def _warnings(path: Path, record: Record) -> tuple[str, list[str]]:
    """A warning that the end of a valid journal is missing, and warnings on its folder."""
    try:
        return wrong_end(path, record), []
    except RaceError as error:
        return "", [*error.messages]


def _session(session: SessionStarted | SessionStopped) -> str:
    if isinstance(session, SessionStopped):
        return f"{session.time}  stopped: {session.why}"
    how = f"{session.executor}, {session.jobs} jobs" if session.executor else ""
    return f"{session.time}  process {session.process} on {session.host}: {how}"
