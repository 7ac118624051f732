"""The index of jobs: what lists show, in SQLite. Missing or damaged, it is made again from the data folder."""

import sqlite3
import threading
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path
from typing import Any

from mercator_design.serve.database import database
from mercator_design.serve.jobs.job import State, Wish

_VERSION = 4
"""Of the table; an index of another version is made again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IndexRow:
    """What lists show of a job, or of a run folder that is of no job."""

    id: str
    owner: str  # empty for a run folder that is of no job
    name: str  # of the mission
    state: State
    wish: Wish = "run"  # of its users: a running race may be about to pause
    message: str = ""  # why it failed, or what it waits for
    method: str = ""
    flavour: str = ""
    seed: int = 0
    budget: int = 0
    priority: int = 0
    experiments: int = 0  # done
    best: float | None = None  # mean score of the winner, or of the best so far
    tested: float | None = None  # mean score of the winner on fresh instances
    direction: str = "maximise"
    submitted: str = ""  # time
    ended: str = ""  # time
    seconds: float = 0.0  # of its races
    left: float | None = None  # seconds that its race still takes, about
    shared: bool = False
    key: str = ""  # of the submission

    @property
    def is_job(self) -> bool:
        """Whether the service runs it; else its run folder was in the data folder."""
        return self.owner != ""


_COLUMNS = tuple(field.name for field in fields(IndexRow))
ORDERS = ("submitted", "name", "owner", "state", "budget", "experiments", "best", "priority")


class Index:
    """The rows of all jobs; safe for several threads.

    Raises:
        sqlite3.Error: It cannot be opened or made.
    """

    def __init__(self, file: Path) -> None:
        self._lock = threading.RLock()
        self._known: dict[str, IndexRow] = {}  # rows as they are in the file
        self._db = database(file, _prepare)
        self._db.row_factory = sqlite3.Row

    def close(self) -> None:
        with self._lock:
            self._db.close()

    def put(self, *rows: IndexRow) -> None:
        """Add or replace rows."""
        marks = ", ".join("?" * len(_COLUMNS))
        with self._lock:
            with self._db:
                self._db.execute("BEGIN")
                self._db.executemany(f"INSERT OR REPLACE INTO jobs VALUES ({marks})", [astuple(row) for row in rows])  # noqa: S608
            self._known |= {row.id: row for row in rows}

    def remove(self, *ids: str) -> None:
        with self._lock:
            self._db.executemany("DELETE FROM jobs WHERE id = ?", [(one,) for one in ids])
            for one in ids:
                self._known.pop(one, None)

    def get(self, identity: str) -> IndexRow | None:
        """A row; also for hundreds who ask several times a second."""
        if (known := self._known.get(identity)) is not None:
            return known
        with self._lock:
            for row in self._rows("WHERE id = ?", [identity]):
                self._known[identity] = row
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
        """The rows of run folders that are of no job."""
        return self._rows("WHERE owner = ''", [])

    def set_queued_message(self, message: str) -> None:
        """Set what all queued jobs wait for."""
        with self._lock:
            self._db.execute("UPDATE jobs SET message = ? WHERE state = 'queued' AND message != ?", (message, message))
            self._known.clear()

    def submitted(self, owner: str, key: str) -> IndexRow | None:
        """The job that a user has submitted with a key."""
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
            descending: Whether the last comes first.
            limit: Maximum number of rows.
            offset: Rows before the page.
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
        way = "DESC" if descending else "ASC"
        with self._lock:
            total = self._db.execute(f"SELECT count(*) FROM jobs {where}", values).fetchone()[0]  # noqa: S608
            tail = f"{where} ORDER BY {order} {way}, submitted {way}, id {way} LIMIT ? OFFSET ?"
            return self._rows(tail, [*values, limit, offset]), total

    def counts(self, owner: str | None = None) -> dict[State, int]:
        """The number of jobs in each state, of a user or of all."""
        where, values = ("WHERE owner = ?", [owner]) if owner is not None else ("WHERE owner != ''", [])
        with self._lock:
            found = self._db.execute(f"SELECT state, count(*) FROM jobs {where} GROUP BY state", values)  # noqa: S608
            return dict(found.fetchall())

    def _rows(self, tail: str, values: Sequence[object]) -> list[IndexRow]:
        with self._lock:
            found = self._db.execute(f"SELECT * FROM jobs {tail}", values).fetchall()  # noqa: S608 - only our own text
        return [IndexRow(**{name: one[name] for name in _COLUMNS} | {"shared": bool(one["shared"])}) for one in found]


def _prepare(db: sqlite3.Connection) -> None:
    if db.execute("PRAGMA user_version").fetchone()[0] != _VERSION:
        db.execute("DROP TABLE IF EXISTS jobs")
        db.execute(f"CREATE TABLE jobs ({', '.join(_COLUMNS)}, PRIMARY KEY (id))")
        db.execute("CREATE INDEX by_time ON jobs (submitted)")
        db.execute("CREATE INDEX by_owner ON jobs (owner, state)")
        db.execute("CREATE INDEX by_key ON jobs (owner, key)")
        db.execute(f"PRAGMA user_version={_VERSION}")
    db.execute(f"SELECT {', '.join(_COLUMNS)} FROM jobs LIMIT 1").fetchone()  # noqa: S608 - our own names
    if (found := db.execute("PRAGMA quick_check(1)").fetchone()[0]) != "ok":
        raise sqlite3.DatabaseError(found)
