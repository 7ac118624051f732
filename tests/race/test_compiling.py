"""What is said of workers that compile."""

import pytest

from mercator_design import jit
from mercator_design.race.executors import compiling
from mercator_design.race.executors.compiling import SETTLE, CompilingWorkers, noting


@pytest.fixture
def said():
    return []


@pytest.fixture
def timers():
    return []


@pytest.fixture
def workers(said, timers):
    return CompilingWorkers(said.append, lambda seconds, function: timers.append((seconds, function)))


def test_those_that_begin_together_share_a_line(workers, said, timers):
    for _ in range(6):
        workers.add("")
    ((seconds, tell),) = timers
    assert (seconds, said) == (SETTLE, [])
    tell()
    assert said == ["6 workers compile, which may take a minute"]


def test_later_ones_get_another(workers, said, timers):
    for number in (0, 1):
        workers.add("")
        timers[number][1]()
    assert said == ["1 worker compiles, which may take a minute"] * 2


def test_the_reason_is_given_if_it_is_not_kept(workers, said, timers):
    for reason in ("", "/home: full", "/home: full"):
        workers.add(reason)
    timers[0][1]()
    assert said == ["3 workers compile, which may take a minute; for this run only, 2 of them: /home: full"]


def test_a_worker_says_it_once_and_goes_on_if_nobody_listens(monkeypatch):
    monkeypatch.setattr(jit, "cache_warning", lambda: "full")
    noted = []

    def note(reason):
        noted.append(reason)
        raise BrokenPipeError

    compiling._has_said.clear()
    for _ in range(2):
        with noting(note):
            jit._missed()
    compiling._has_said.clear()
    assert noted == ["full"]
