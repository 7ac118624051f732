"""SQLite files of the service. Their contents can be rebuilt, so a damaged file is replaced."""

import contextlib
import os
import sqlite3
from collections.abc import Callable
from pathlib import Path

_LOG = 250
"""Pages of the log (1 MB) after which it begins again."""
RESERVED_BYTES = 2_000_000
"""Bytes that are taken in the file and in its log."""


_UNREADABLE = {sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_ERROR}
"""What damaged files lead to, the last if tables or columns are others. Full disks and locks lead to other errors."""


def database(file: Path, prepare: Callable[[sqlite3.Connection], None]) -> sqlite3.Connection:
    """A connection for several threads to a file that only its owner may read.

    Args:
        file: Missing or damaged, it is made again.
        prepare: Makes the tables that are not there, and reads from each.

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
    """Take space on the disk, so that small changes are written also when it is full.

    The file keeps free pages. The log stays as long as it has been, and begins again from its start before that.
    """
    connection.execute(f"PRAGMA wal_autocheckpoint={_LOG}")
    connection.executescript(
        "DROP TABLE IF EXISTS reserve;"
        f"CREATE TABLE reserve AS SELECT zeroblob({RESERVED_BYTES});"
        "DROP TABLE reserve; PRAGMA wal_checkpoint(RESTART)"
    )
