"""The sessions of browsers: each begins with a token, and ends with it. The file has hashes of their secrets."""

import secrets
import sqlite3
import threading
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

from mercator_design.serve.accounts.users import digest
from mercator_design.serve.database import database

FILE = "sessions.sqlite"
DAYS = 7
"""Maximum duration of a session [days]."""
MAX_SESSIONS = 100  # sessions of a token; the oldest end


class Sessions:
    """The sessions in an SQLite file; safe for several threads. If it is damaged, all sessions have ended.

    Raises:
        OSError, sqlite3.Error: The file cannot be made.
    """

    def __init__(self, file: Path, now: Callable[[], datetime]) -> None:
        self._now = now
        self._lock = threading.RLock()
        self._db = database(file, _prepare)

    def close(self) -> None:
        with self._lock:
            self._db.close()

    def begin(self, token: str, until: datetime) -> str:
        """Begin a session with the token of an id; return the secret of the session.

        Raises:
            sqlite3.Error: It cannot be written.
        """
        secret = secrets.token_urlsafe(32)
        ends = min(until, self._now() + timedelta(days=DAYS))
        with self._lock:
            self._db.execute("DELETE FROM sessions WHERE ends <= ?", [self._now().timestamp()])
            self._db.execute("INSERT INTO sessions VALUES (?, ?, ?)", [digest(secret), token, ends.timestamp()])
            self._db.execute(
                "DELETE FROM sessions WHERE token = ? AND hash NOT IN "
                "(SELECT hash FROM sessions WHERE token = ? ORDER BY ends DESC, rowid DESC LIMIT ?)",
                [token, token, MAX_SESSIONS],
            )
        return secret

    def token(self, secret: str) -> str | None:
        """Id of the token of a session; None if the session has ended.

        Raises:
            sqlite3.Error: The file cannot be read.
        """
        with self._lock:
            found = self._db.execute(
                "SELECT token FROM sessions WHERE hash = ? AND ends > ?", [digest(secret), self._now().timestamp()]
            ).fetchone()
        return None if found is None else str(found[0])

    def end(self, secret: str) -> None:
        """End a session.

        Raises:
            sqlite3.Error: It cannot be written.
        """
        with self._lock:
            self._db.execute("DELETE FROM sessions WHERE hash = ?", [digest(secret)])


def _prepare(db: sqlite3.Connection) -> None:
    db.execute("PRAGMA secure_delete=ON")
    db.execute("CREATE TABLE IF NOT EXISTS sessions (hash TEXT PRIMARY KEY, token TEXT, ends REAL)")
    db.execute("SELECT hash, token, ends FROM sessions LIMIT 1").fetchone()
