"""The SQLite files of the service."""

import sqlite3

import pytest

from mercator_design.serve.database import database


def prepare(db):
    db.execute("CREATE TABLE IF NOT EXISTS things (name TEXT)")
    db.execute("SELECT name FROM things LIMIT 1").fetchone()


@pytest.fixture
def file(tmp_path):
    file = tmp_path / "things.sqlite"
    db = database(file, prepare)
    db.execute("INSERT INTO things VALUES ('one')")
    db.close()
    return file


def things(file):
    db = database(file, prepare)
    found = db.execute("SELECT name FROM things").fetchall()
    db.close()
    return found


def test_what_was_written_is_there(file):
    assert things(file) == [("one",)]


def of_other_columns(file):
    with sqlite3.connect(file) as db:
        db.execute("ALTER TABLE things RENAME COLUMN name TO other")
    db.close()


@pytest.mark.parametrize(
    "damage", [lambda file: file.write_bytes(b"nonsense" * 1000), of_other_columns], ids=["nonsense", "other columns"]
)
def test_a_damaged_file_is_made_again(file, damage):
    damage(file)
    assert things(file) == []


def test_a_file_stays_when_the_disk_is_full(file):
    def fill(db):
        prepare(db)
        db.execute(f"PRAGMA max_page_count={db.execute('PRAGMA page_count').fetchone()[0]}")
        db.execute("CREATE TABLE more AS SELECT zeroblob(10000000)")

    with pytest.raises(sqlite3.OperationalError, match="full"):
        database(file, fill)
    assert things(file) == [("one",)]
