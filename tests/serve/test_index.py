import sqlite3
from contextlib import closing

import pytest

from mercator_design.serve.jobs.index import ORDERS, Index
from tests.serve.races import row_of as row


@pytest.fixture
def file(tmp_path):
    return tmp_path / "index.sqlite"


@pytest.fixture
def index(file):
    with closing(Index(file)) as one:
        yield one


def ids(index, viewer=None, **wanted):
    return [one.id for one in index.find(viewer, **wanted)[0]]


def test_rows_are_kept_as_they_are(index, file):
    whole = row(
        "a",
        best=1.5,
        measured="on 30 fresh instances",
        seed=2**63 - 1,
        set=("robots=3",),
        shared=True,
        message="née 'x'",
        seconds=3.5,
        key="k",
    )
    index.put(whole, row("b"))
    assert (index.get("a"), index.get("c"), len(index.all())) == (whole, None, 2)
    with closing(Index(file)) as again:
        assert again.get("a") == whole


def test_put_replaces_and_change_keeps_the_rest(index):
    index.put(row("a"), row("a", priority=1))
    assert index.change("a", state="failed") == index.get("a") == row("a", priority=1, state="failed")
    with pytest.raises(KeyError):
        index.change("b", state="failed")


def test_who_sees_what(index):
    index.put(row("own"), row("shared", "bob", shared=True), row("foreign", "bob"), row("folder", ""))
    assert set(ids(index, "ann")) == {"own", "shared", "folder"}
    assert len(ids(index)) == 4
    assert ids(index, "ann", owner="bob") == ids(index, "ann", shared=True) == ["shared"]
    assert [one.id for one in index.of_no_job()] == ["folder"]


def test_filters_and_pages(index):
    index.put(
        *(
            row(f"{k}", submitted=f"2030-01-0{k}", name="AAC %_"[:k], state="failed" if k == 2 else "queued")
            for k in range(1, 7)
        )
    )
    assert ids(index, states=("failed",)) == ["2"]
    assert ids(index, text="c") == ["6", "5", "4", "3"]
    assert ids(index, text="%") == ["6", "5"]
    assert ids(index, descending=False, limit=2, offset=1) == ["2", "3"]
    assert index.find(None, limit=1)[1] == 6


@pytest.mark.parametrize("order", ORDERS)
def test_every_order(index, order):
    low, high = (1, 2) if order in ("budget", "experiments", "best", "priority") else ("failed", "queued")
    index.put(row("x", **{order: high}), row("y", **{order: low}))
    assert ids(index, order=order) == ["x", "y"]
    assert ids(index, order=order, descending=False) == ["y", "x"]


def test_an_order_is_one_of_ours(index):
    with pytest.raises(ValueError, match="id; DROP TABLE jobs"):
        index.find(None, order="id; DROP TABLE jobs")


def test_counts_keys_and_what_queued_jobs_wait_for(index):
    index.put(row("a", key="k"), row("b", state="failed"), row("c", "bob"), row("d", "", state="failed"))
    assert (index.counts("ann"), index.counts()) == ({"queued": 1, "failed": 1}, {"queued": 2, "failed": 1})
    assert (index.find_by_key("ann", "k").id, index.find_by_key("bob", "k")) == ("a", None)
    index.set_queued_message("waits")
    assert [index.get(one).message for one in "abcd"] == ["waits", "", "waits", ""]


@pytest.mark.parametrize("how", ["no database", "another version", "another table"])
def test_what_cannot_be_used_is_made_again(file, how):
    with closing(Index(file)) as index:
        index.put(row("a"))
    if how == "no database":
        file.write_bytes(b"SQLite format 3\0" + b"?" * 4096)
    else:
        with closing(sqlite3.connect(file)) as database:
            database.execute(
                "PRAGMA user_version=99" if how == "another version" else "ALTER TABLE jobs RENAME COLUMN best TO x"
            )
            database.commit()
    with closing(Index(file)) as index:
        assert index.all() == []
        index.put(row("b"))


def test_changes_need_no_space_on_a_full_disk(file):
    def taken():
        return sum(one.stat().st_blocks for one in file.parent.iterdir())

    with closing(Index(file)) as index:
        index.put(*(row(f"{k}") for k in range(20)))
        before = taken()
        for k in range(5000):
            index.change(f"{k % 20}", message=f"waits, {k}")
        index.put(*(row(f"new {k}") for k in range(100)))
        assert taken() == before
