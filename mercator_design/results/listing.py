"""The facts on races that lists show, from their run folders."""

import math
from pathlib import Path
from typing import Any

from mercator_design.errors import RaceError
from mercator_design.race.session.journal import Reading, is_locked
from mercator_design.race.session.record import OtherVersion
from mercator_design.race.session.view import RaceView
from mercator_design.results.files import JOURNAL, possible_scores, read_journal, wrong_end

COLUMNS = ("run", "name", "flavour", "method", "seed", "experiments", "budget", "state", "started", "score", "measured")
"""The columns of a table of races; see `run_of`."""


def runs_of(folder: Path) -> list[dict[str, Any]]:
    """The facts (see `run_of`) on the race in a folder and on each in its subfolders, the last changed one last.

    Raises:
        RaceError: There is no such folder.
    """
    try:
        journals = sorted([*folder.glob(JOURNAL), *folder.glob(f"*/{JOURNAL}")], key=_modified)
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


_KEYS = (*COLUMNS, "winner", "race_score", "race_runs", "fresh_score", "fresh_runs", "low", "high", "notes")


def run_of(path: Path, reading: Reading) -> dict[str, Any]:
    """The facts on a race that a table of races shows: the keys are `_KEYS`.

    `score` is the headline of the winner or the best so far, `measured` says where; `low` and `high` are the limits of
    possible scores, None if there are none.
    """
    record = reading.record
    run: dict[str, Any] = dict.fromkeys(_KEYS) | {"run": str(path), "experiments": len(record.experiments)}
    is_running, missing = is_locked(path / JOURNAL), ""
    try:
        missing = wrong_end(path, record)
        notes = [missing] if missing else []
    except RaceError as error:
        notes = [*error.messages]
    if is_running:
        run["state"] = "running"
    elif missing:
        run["state"] = "damaged" if record.is_complete else "end missing"
    elif record.start and record.is_complete:
        run["state"] = "finished"
    else:
        run["state"] = "stopped"
    run["notes"] = [] if is_running else notes
    if record.start:
        run |= {name: record.start[name] for name in ("name", "method", "seed")}
        run |= {"flavour": record.start.get("flavour"), "budget": record.budget}
    if record.sessions:
        run["started"] = record.sessions[0].time
    return run | {"winner": record.view.winner} | _scores(path, record.view)


def _scores(path: Path, view: RaceView) -> dict[str, Any]:
    """The scores of the winner or the best so far."""
    possible = possible_scores(path)
    limits = {"low": possible.low, "high": possible.high}
    found: dict[str, Any] = {name: limit if math.isfinite(limit) else None for name, limit in limits.items()}
    if (headline := view.headline(possible)) is None:
        return found
    found |= {"score": headline.scores.mean, "measured": headline.where}
    for where, of in (
        ("race", view.headline(possible, fresh=False)),
        ("fresh", headline if headline.is_fresh else None),
    ):
        if of is not None:
            found |= {f"{where}_score": of.scores.mean, f"{where}_runs": len(of.scores.values)}
    return found
