"""SQLite files of the service. Their contents can be rebuilt, so a damaged file is replaced."""

import contextlib
import os
import sqlite3
from collections.abc import Callable
from pathlib import Path

_LOG = 250
"""Pages of the write-ahead log before a checkpoint (1 MB)."""
RESERVED_BYTES = 2_000_000
"""Reserved size of the file, and of its log [bytes]."""


_UNREADABLE = {sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_ERROR}
"""Error codes of damaged files; SQLITE_ERROR is that of other tables or columns."""


def database(file: Path, prepare: Callable[[sqlite3.Connection], None]) -> sqlite3.Connection:
    """A connection for several threads to a file that only its owner may read.

    Args:
        file: The file; if missing or damaged, it is made again.
        prepare: Function that makes missing tables, and reads from each.

    Raises:
        OSError, sqlite3.Error: The file cannot be made, or not be opened for another reason than damage.
    """
    try:
        return _opened(file, prepare)
    except sqlite3.DatabaseError as error:
        if getattr(error, "sqlite_errorcode", sqlite3.SQLITE_CORRUPT) & 0xFF not in _UNREADABLE:
            raise
        for one in file.parent.glob(f"{file.name}*"):
            one.unlink()
        return _opened(file, prepare)


def _opened(file: Path, prepare: Callable[[sqlite3.Connection], None]) -> sqlite3.Connection:
    os.close(os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600))
    connection = sqlite3.connect(file, check_same_thread=False, isolation_level=None)
    try:
        connection.execute("PRAGMA journal_mode=WAL").close()
        connection.execute("PRAGMA synchronous=NORMAL")
        prepare(connection)
        with contextlib.suppress(sqlite3.OperationalError):  # the disk is full already
            _reserve(connection)
    except BaseException:
        connection.close()
        raise
    return connection


def _reserve(connection: sqlite3.Connection) -> None:
    """Reserve space, so that small changes are possible on a full disk: free pages of the file, and a long log."""
    connection.execute(f"PRAGMA wal_autocheckpoint={_LOG}")
    connection.executescript(
        "DROP TABLE IF EXISTS reserve;"
        f"CREATE TABLE reserve AS SELECT zeroblob({RESERVED_BYTES});"
        "DROP TABLE reserve; PRAGMA wal_checkpoint(RESTART)"
    )
