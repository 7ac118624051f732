"""The index of jobs: what lists show, in SQLite. Missing or damaged, it is made again from the data folder."""

import json
import sqlite3
import threading
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from operator import attrgetter
from pathlib import Path
from typing import Any

from mercator_design.serve.database import database
from mercator_design.serve.jobs.job import Job, RaceRequest, Request, State, StudyRequest


@dataclass(frozen=True, slots=True, kw_only=True)
class IndexRow:
    """A job, or a run folder of no job, with the figures of its race that lists show."""

    job: Job  # as in its file, with the seconds until now; without an owner for a run folder that is of no job
    state: State
    message: str = ""  # why it failed, or what it waits for
    experiments: int = 0  # done
    best: float | None = None  # score of the winner, or of the best so far
    measured: str = ""  # where: "on 30 fresh instances", or "in the race, 12 runs"
    left: float | None = None  # estimate of the seconds until the end of its race

    @property
    def id(self) -> str:
        return self.job.id

    @property
    def is_study(self) -> bool:
        """Whether it is a study, not a race."""
        return isinstance(self.job.request, StudyRequest)

    @property
    def is_job(self) -> bool:
        """Whether it is a job of this service; otherwise a run folder that was in the data folder."""
        return self.job.owner != ""


_COLUMNS = {
    "id": "job.id", "owner": "job.owner", "name": "job.name", "state": "state", "budget": "job.request.budget",
    "experiments": "experiments", "best": "best", "priority": "job.request.priority", "submitted": "job.submitted",
    "shared": "job.shared", "key": "job.key",
}  # fmt: skip
"""Columns of queries -> attributes of a row; one more column holds the whole row as JSON."""
ORDERS = ("submitted", "name", "owner", "state", "budget", "experiments", "best", "priority")
_values = attrgetter(*_COLUMNS.values())
_VERSION = (
    zlib.crc32(
        repr([[one.name for one in fields(kind)] for kind in (IndexRow, Job, RaceRequest, StudyRequest)]).encode()
    )
    >> 1
)
"""Version of the table: an index of rows with other fields is made again."""


class Index:
    """The rows of all jobs; safe for several threads.

    Raises:
        sqlite3.Error: It cannot be opened or made.
    """

    def __init__(self, file: Path) -> None:
        self._lock = threading.RLock()
        self._known: dict[str, IndexRow] = {}  # rows as they are in the file
        self._db = database(file, _prepare)

    def close(self) -> None:
        with self._lock:
            self._db.close()

    def put(self, *rows: IndexRow) -> None:
        """Add or replace rows."""
        marks = ", ".join("?" * (len(_COLUMNS) + 1))
        values = [(*_values(row), json.dumps(row, default=_fields_of)) for row in rows]
        with self._lock:
            with self._db:
                self._db.execute("BEGIN")
                self._db.executemany(f"INSERT OR REPLACE INTO jobs VALUES ({marks})", values)  # noqa: S608
            self._known |= {row.id: row for row in rows}

    def remove(self, *ids: str) -> None:
        with self._lock:
            self._db.executemany("DELETE FROM jobs WHERE id = ?", [(one,) for one in ids])
            for one in ids:
                self._known.pop(one, None)

    def get(self, identity: str) -> IndexRow | None:
        """A row, from memory if known: hundreds of event streams ask several times a second."""
        if (known := self._known.get(identity)) is not None:
            return known
        self._rows("WHERE id = ?", [identity])
        return self._known.get(identity)

    def change(self, identity: str, **changes: Any) -> IndexRow:  # noqa: ANN401 - the fields of IndexRow
        """Change fields of a row that is there.

        Raises:
            KeyError: It is not.
        """
        with self._lock:
            before = self.get(identity)
            if before is None:
                raise KeyError(identity)
            row = replace(before, **changes)
            if row != before:
                self.put(row)
            return row

    def all(self) -> list[IndexRow]:
        return self._rows("", [])

    def of_no_job(self) -> list[IndexRow]:
        """Rows of run folders of no job."""
        return self._rows("WHERE owner = ''", [])

    def set_queued_message(self, message: str) -> None:
        """Set the message of all queued jobs."""
        with self._lock:
            self.put(*(replace(row, message=message) for row in self._rows("WHERE state = 'queued'", [])))

    def find_by_key(self, owner: str, key: str) -> IndexRow | None:
        """A user's job with an idempotency key."""
        found = self._rows("WHERE owner = ? AND key = ?", [owner, key])
        return found[0] if found else None

    def find(
        self,
        viewer: str | None,
        *,
        states: Sequence[State] = (),
        owner: str = "",
        text: str = "",
        shared: bool = False,
        order: str = "submitted",
        descending: bool = True,
        limit: int = 50,
        offset: int = 0,
    ) -> tuple[list[IndexRow], int]:
        """A page of the rows that a user may see, and the number of all of them.

        Args:
            viewer: Sees own rows, shared ones, and run folders of no job; None: an administrator, who sees all.
            states: Only of these; by default of all.
            owner: Only of this user.
            text: Only with this text in the id or the name.
            shared: Only shared ones.
            order: One of ORDERS.
            descending: Whether the order is descending.
            limit: Maximum number of rows.
            offset: Number of rows before the page.
        """
        filters: list[tuple[bool, str, Sequence[object]]] = [
            (viewer is not None, "(owner = ? OR shared OR owner = '')", [viewer]),
            (bool(states), f"state IN ({', '.join('?' * len(states))})", states),
            (bool(owner), "owner = ?", [owner]),
            (bool(text), "(instr(lower(name), lower(?)) OR instr(lower(id), lower(?)))", [text, text]),
            (shared, "shared", []),
        ]
        asked = [(condition, given) for is_asked, condition, given in filters if is_asked]
        where = f"WHERE {' AND '.join(condition for condition, _ in asked)}" if asked else ""
        values = [value for _, given in asked for value in given]
        if order not in ORDERS:
            raise ValueError(order)
        direction = "DESC" if descending else "ASC"
        with self._lock:
            total = self._db.execute(f"SELECT count(*) FROM jobs {where}", values).fetchone()[0]  # noqa: S608
            tail = f"{where} ORDER BY {order} {direction}, submitted {direction}, id {direction} LIMIT ? OFFSET ?"
            return self._rows(tail, [*values, limit, offset]), total

    def counts(self, owner: str | None = None) -> dict[State, int]:
        """The number of jobs in each state, of a user or of all."""
        where, values = ("WHERE owner = ?", [owner]) if owner is not None else ("WHERE owner != ''", [])
        with self._lock:
            found = self._db.execute(f"SELECT state, count(*) FROM jobs {where} GROUP BY state", values)  # noqa: S608
            return dict(found.fetchall())

    def _rows(self, tail: str, values: Sequence[object]) -> list[IndexRow]:
        with self._lock:
            found = self._db.execute(f"SELECT id, row FROM jobs {tail}", values).fetchall()  # noqa: S608 - our own text
            self._known |= {identity: _row_of(text) for identity, text in found if identity not in self._known}
            return [self._known[identity] for identity, _ in found]


def _fields_of(one: IndexRow | Job | Request) -> dict[str, object]:
    return {name: getattr(one, name) for name in one.__slots__}


def _row_of(text: str) -> IndexRow:
    row = json.loads(text)
    job = row["job"]
    given = job["request"]
    request: Request
    if given["kind"] == "study":
        request = StudyRequest(**given)
    else:
        request = RaceRequest(**given | {"set": tuple(given["set"])})
    return IndexRow(**row | {"job": Job(**job | {"request": request})})


def _prepare(db: sqlite3.Connection) -> None:
    if db.execute("PRAGMA user_version").fetchone()[0] != _VERSION:
        db.execute("DROP TABLE IF EXISTS jobs")
        db.execute(f"CREATE TABLE jobs ({', '.join(_COLUMNS)}, row, PRIMARY KEY (id))")
        db.execute("CREATE INDEX by_time ON jobs (submitted)")
        db.execute("CREATE INDEX by_owner ON jobs (owner, state)")
        db.execute("CREATE INDEX by_key ON jobs (owner, key)")
        db.execute(f"PRAGMA user_version={_VERSION}")
    db.execute(f"SELECT {', '.join(_COLUMNS)}, row FROM jobs LIMIT 1").fetchone()  # noqa: S608 - our own names
    if (found := db.execute("PRAGMA quick_check(1)").fetchone()[0]) != "ok":
        raise sqlite3.DatabaseError(found)
