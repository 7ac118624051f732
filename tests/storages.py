"""Optuna's storages in tests."""

import contextlib

import sqlalchemy


@contextlib.contextmanager
def connections_closed():
    """Close at the end what was connected: Optuna leaves connections open, of which Python 3.13 warns.

    Databases do not wait for the disk.
    """
    connections = []

    def note(connection, _):
        connection.execute("PRAGMA synchronous=OFF")
        connections.append(connection)

    sqlalchemy.event.listen(sqlalchemy.Engine, "connect", note)
    try:
        yield
    finally:
        sqlalchemy.event.remove(sqlalchemy.Engine, "connect", note)
        for connection in connections:
            connection.close()
