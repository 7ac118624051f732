"""SQLite files of the service. What is in them can be made again, so one that is damaged is."""

import os
import sqlite3
from collections.abc import Callable
from pathlib import Path


def database(file: Path, prepare: Callable[[sqlite3.Connection], None]) -> sqlite3.Connection:
    """A connection for several threads to a file that only its owner may read.

    Args:
        file: Missing or damaged, it is made again.
        prepare: Makes the tables that are not there, and reads from each.

    Raises:
        OSError, sqlite3.Error: The file cannot be made.
    """
    try:
        return _opened(file, prepare)
    except sqlite3.DatabaseError:
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
    except BaseException:
        connection.close()
        raise
    return connection
