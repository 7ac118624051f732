"""Worker processes for short work: their results, errors, time limits, deaths, end."""

import errno
import os
import signal
import threading
import time
from multiprocessing.context import SpawnProcess
from pathlib import Path

import pytest

from mercator_design.errors import MissionError
from mercator_design.serve.settings import Extensions, ServiceError
from mercator_design.serve.workers import pool as module
from mercator_design.serve.workers.pool import Busy, WorkerPool
from mercator_design.serve.workers.process import TooMuchWork
from tests.processes import LIMIT, wait_until
from tests.tiers import some


def add(one, other=1):
    return one + other


def refuse(*messages):
    raise MissionError(*messages)


def fail():
    raise ZeroDivisionError("as it happens")


def where():
    return os.getpid(), os.getcwd()  # noqa: PTH109 - what is asked


def die():
    os.kill(os.getpid(), signal.SIGKILL)


def sleep(seconds):
    time.sleep(seconds)


def oom_score():
    return Path("/proc/self/oom_score_adj").read_text()


def unsendable():
    return lambda: None


@pytest.fixture(scope="module")
def pool(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pool")
    pool = WorkerPool(1, LIMIT, 2000, Extensions(), folder)
    yield pool
    pool.close()


def test_a_result_of_another_process(pool):
    assert pool.run(add, 1, other=2) == 3
    process, folder = pool.run(where)
    assert process != os.getpid()
    assert folder == os.path.realpath(pool._folder)
    assert not any(pool._folder.iterdir())
    assert pool.run(where)[0] == process


def test_errors_come_back_and_the_worker_stays(pool):
    process, _ = pool.run(where)
    with pytest.raises(MissionError) as error:
        pool.run(refuse, "one", "two")
    assert error.value.messages == ("one", "two")
    with pytest.raises(ServiceError, match="internal error: ZeroDivisionError: as it happens"):
        pool.run(fail)
    assert pool.run(where)[0] == process


@pytest.mark.swept
@pytest.mark.parametrize("function", some([die, unsendable], 1))
def test_a_worker_that_dies_is_replaced(pool, function):
    process, _ = pool.run(where)
    with pytest.raises(ServiceError, match="the process that worked on this has died"):
        pool.run(function)
    assert pool.run(where)[0] != process


def test_a_worker_that_cannot_be_started_is_replaced(tmp_path, monkeypatch):
    def refused(_):
        raise OSError(errno.EAGAIN, "Resource temporarily unavailable")

    pool = WorkerPool(1, LIMIT, 2000, Extensions(), tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(SpawnProcess, "start", refused)
        with pytest.raises(ServiceError, match="a process for this cannot be started: Resource temporarily unavail"):
            pool.run(add, 1)
    assert pool.run(add, 1) == 2
    pool.close()


def test_what_cannot_be_sent_does_no_harm(pool):
    with pytest.raises((TypeError, AttributeError, ValueError)):
        pool.run(lambda: None)
    assert pool.run(add, 1) == 2


def test_time_limit(pool, monkeypatch):
    pool.run(add, 1)  # its start has a limit of its own
    monkeypatch.setattr(pool, "seconds", 0.05)
    with pytest.raises(TooMuchWork, match=r"longer than the 0.05 s that the service allows"):
        pool.run(sleep, 600)
    assert pool.run_within(LIMIT, sleep, 0.3) is None
    monkeypatch.undo()
    assert pool.run(add, 1) == 2


def test_busy(pool, monkeypatch):
    monkeypatch.setattr(module, "MAX_WAIT", 0.0)
    with pool._worker("ann"), pytest.raises(Busy, match="try again in a moment"):
        pool.run(add, 1)
    assert pool.run(add, 1) == 2
    assert not pool._waiting
    assert not pool._at_work


def test_a_user_leaves_a_worker_to_others(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "MAX_WAIT", 0.0)
    pool = WorkerPool(3, LIMIT, 2000, Extensions(), tmp_path)
    with pool._worker("ann"), pool._worker("ann"):
        with pytest.raises(Busy), pool._worker("ann"):
            pass
        with pool._worker("bob"), pytest.raises(Busy), pool._worker("carl"):
            pass
        with pool._worker("carl"):
            pass


class Crowd:
    """Requests of users, each of which waits for a worker and gives it back at once."""

    def __init__(self, pool):
        self.pool, self.served, self.refused, self.threads = pool, [], [], []

    def _ask(self, user):
        try:
            with self.pool._worker(user):
                self.served.append(user)
        except Busy:
            self.refused.append(user)

    def ask(self, *users):
        for user in users:
            waiting = len(self.pool._waiting) + len(self.refused)
            self.threads.append(threading.Thread(target=self._ask, args=(user,)))
            self.threads[-1].start()
            wait_until(lambda n=waiting: len(self.pool._waiting) + len(self.refused) > n)

    def end(self):
        for thread in self.threads:
            thread.join(LIMIT)


def test_work_of_three_users_does_not_keep_a_fourth_waiting(tmp_path):
    pool = WorkerPool(3, LIMIT, 2000, Extensions(), tmp_path)
    crowd = Crowd(pool)
    with pool._worker("bob"), pool._worker("carl"):
        with pool._worker("ann"):
            crowd.ask(*["ann"] * 12, *["bob"] * 12, *["carl"] * 6, "dan")
        wait_until(lambda: len(crowd.served) >= 13)
        assert crowd.served[:13] == ["dan", *["ann"] * 12]  # a worker of bob and of carl is at work
    crowd.end()
    assert len(crowd.served) == 31
    assert crowd.refused == []


def test_users_take_turns(tmp_path):
    pool = WorkerPool(1, LIMIT, 2000, Extensions(), tmp_path)
    crowd = Crowd(pool)
    with pool._worker("bob"):
        crowd.ask("ann", "ann", "ann", "bob", "bob", "carl")
    crowd.end()
    assert crowd.served == ["ann", "carl", "bob", "ann", "bob", "ann"]


def test_a_class_that_shares_a_user_is_served(tmp_path):
    pool = WorkerPool(2, LIMIT, 2000, Extensions(), tmp_path)
    crowd = Crowd(pool)
    with pool._worker("class"):
        crowd.ask(*["class"] * 30)
    crowd.end()
    assert crowd.served == ["class"] * 30


def test_of_too_much_work_that_of_who_has_most_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "MAX_WAITING", 3)
    pool = WorkerPool(1, LIMIT, 2000, Extensions(), tmp_path)
    crowd = Crowd(pool)
    with pool._worker("bob"):
        crowd.ask("ann", "ann", "bob", "carl", "ann")
        wait_until(lambda: crowd.refused == ["ann", "ann"])
    crowd.end()
    assert crowd.served == ["ann", "carl", "bob"]


def test_memory_limit(pool, monkeypatch):
    process, _ = pool.run(where)
    monkeypatch.setattr(pool, "megabytes", 1)
    with pytest.raises(TooMuchWork, match="more than the 1 MB of memory"):
        pool.run(sleep, 600)
    monkeypatch.undo()
    assert pool.run(where)[0] != process


def test_a_worker_that_has_died_without_work_is_replaced(pool):
    process, _ = pool.run(where)
    os.kill(process, signal.SIGKILL)
    wait_until(lambda: not pool._idle[-1]._process.is_alive())
    assert pool.run(add, 1) == 2


@pytest.mark.skipif(not Path("/proc/self/oom_score_adj").exists(), reason="Linux alone has it")
def test_workers_die_before_the_service(pool):
    assert pool.run(oom_score) == "500\n"


def is_there(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def test_close_ends_work_and_processes(tmp_path):
    pool = WorkerPool(1, LIMIT, 2000, Extensions(), tmp_path)
    process, _ = pool.run(where)
    failed = []

    def work():
        try:
            pool.run(sleep, 600)
        except ServiceError as error:
            failed.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    wait_until(lambda: not pool._idle)
    pool.close()
    thread.join(LIMIT)
    assert failed
    wait_until(lambda: not is_there(process))
    assert not pool._idle


def test_a_pool_that_is_closed_starts_no_process(tmp_path):
    pool = WorkerPool(1, LIMIT, 2000, Extensions(), tmp_path)
    pool.close()
    with pytest.raises(ServiceError, match="the service ends"):
        pool.run(add, 1)
