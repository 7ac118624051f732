"""Parts of pages are computed once for all who look."""

import contextvars
import threading
from collections import deque
from types import SimpleNamespace

import pytest

from mercator_design.errors import RaceError
from mercator_design.serve.web.part_cache import PartCache
from mercator_design.serve.workers.pool import CURRENT_USER, Busy
from mercator_design.serve.workers.races import PagePart
from tests.processes import LIMIT


class FakePool:
    """Takes as long as it is told."""

    def __init__(self, clock):
        self.clock, self.n, self.takes, self.errors = clock, 0, 0.0, deque()

    def run(self, make, folder):
        self.n += 1
        self.clock.seconds += self.takes
        if self.errors:
            raise self.errors.popleft()
        return make(folder)


def part(folder):
    return PagePart(f"{folder.name} {(folder / 'journal.jsonl').stat().st_size}", None)


@pytest.fixture
def place(tmp_path, clock):
    folder = tmp_path / "job"
    folder.mkdir()
    (folder / "journal.jsonl").write_text("1")
    pool = FakePool(clock)
    return SimpleNamespace(folder=folder, pool=pool, kept=PartCache(pool, 2, clock=clock))


def grow(place):
    with (place.folder / "journal.jsonl").open("a") as file:
        file.write("1")


def test_200_readers_of_a_race_that_stands_still_cost_one_computation(place, clock):
    for _ in range(200):
        clock.seconds += 1
        assert place.kept.get(part, place.folder) == (PagePart("job 1", None), True)
    assert place.pool.n == 1


def test_a_race_that_goes_on_is_read_every_two_seconds(place, clock):
    for _ in range(200):  # 20 seconds
        grow(place)
        place.kept.get(part, place.folder)
        clock.seconds += 0.1
    assert place.pool.n == 10


def test_what_takes_long_is_computed_seldom(place, clock):
    place.pool.takes = 3.0
    place.kept.get(part, place.folder)
    grow(place)
    clock.seconds += 14
    found, is_fresh = place.kept.get(part, place.folder)
    assert (found.text, is_fresh) == ("job 1", False)
    clock.seconds += 2
    assert place.kept.get(part, place.folder) == (PagePart("job 2", None), True)


def test_the_end_of_a_race_is_shown_at_once(place):
    place.pool.takes = 3.0
    place.kept.get(part, place.folder)
    grow(place)
    (place.folder / "comparison.json").touch()
    assert place.kept.get(part, place.folder) == (PagePart("job 2", None), True)


def test_workers_are_left_to_other_work(place, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    (other / "journal.jsonl").touch()
    inside = []

    def asks_for_another(folder):
        inside.append(place.kept.get(part, other))
        return part(folder)

    place.kept.get(asks_for_another, place.folder)
    assert inside == [(None, False)]
    assert place.kept.get(part, other) == (PagePart("other 0", None), True)


def test_users_do_not_keep_one_another_waiting(place, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    (other / "journal.jsonl").touch()
    inside = []

    def asked_by_another(folder):
        CURRENT_USER.set("bob")
        inside.append(place.kept.get(part, other))
        return part(folder)

    contextvars.copy_context().run(place.kept.get, asked_by_another, place.folder)
    assert inside == [(PagePart("other 0", None), True)]


def test_nobody_waits_for_a_computation(place):
    entered, go = threading.Event(), threading.Event()

    def slow(folder):
        entered.set()
        go.wait(LIMIT)
        return part(folder)

    thread = threading.Thread(target=place.kept.get, args=(slow, place.folder))
    thread.start()
    entered.wait(LIMIT)
    assert place.kept.get(slow, place.folder) == (None, False)
    go.set()
    thread.join(LIMIT)
    assert place.kept.get(slow, place.folder) == (PagePart("job 1", None), True)
    assert place.pool.n == 1


def test_an_error_is_kept_until_the_folder_changes(place, clock):
    place.pool.errors.append(RaceError("damaged"))
    lengths = []
    for _ in range(5):
        with pytest.raises(RaceError, match="damaged") as found:
            place.kept.get(part, place.folder)
        lengths.append(len(found.traceback))
    assert lengths[1:] == lengths[1:2] * 4  # they do not grow
    assert place.pool.n == 1
    grow(place)
    clock.seconds += 3
    assert place.kept.get(part, place.folder)[1]


def test_a_busy_pool_is_asked_again(place):
    place.pool.errors.append(Busy("busy"))
    assert place.kept.get(part, place.folder) == (None, False)
    assert place.kept.get(part, place.folder) == (PagePart("job 1", None), True)
