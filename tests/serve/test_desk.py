"""Helper processes for short work: their results, errors, time limits, deaths, end."""

import errno
import os
import signal
import threading
import time
from multiprocessing.context import SpawnProcess
from pathlib import Path

import pytest

from mercator_design.errors import MissionError
from mercator_design.serve.desk import desk as module
from mercator_design.serve.desk.desk import ASKED_BY, Busy, Desk, TooMuchWork
from mercator_design.serve.settings import ServiceError
from tests.processes import LIMIT, wait_until


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
def desk(tmp_path_factory):
    folder = tmp_path_factory.mktemp("desk")
    desk = Desk(1, LIMIT, 2000, (), folder)
    yield desk
    desk.close()


def test_a_result_of_another_process(desk):
    assert desk.run(add, 1, other=2) == 3
    process, folder = desk.run(where)
    assert process != os.getpid()
    assert folder == os.path.realpath(desk._folder)
    assert not any(desk._folder.iterdir())
    assert desk.run(where)[0] == process


def test_errors_come_back_and_the_helper_stays(desk):
    process, _ = desk.run(where)
    with pytest.raises(MissionError) as error:
        desk.run(refuse, "one", "two")
    assert error.value.messages == ("one", "two")
    with pytest.raises(ServiceError, match="internal error: ZeroDivisionError: as it happens"):
        desk.run(fail)
    assert desk.run(where)[0] == process


@pytest.mark.parametrize("function", [die, unsendable])
def test_a_helper_that_dies_is_replaced(desk, function):
    process, _ = desk.run(where)
    with pytest.raises(ServiceError, match="the process that worked on this has died"):
        desk.run(function)
    assert desk.run(where)[0] != process


def test_a_helper_that_cannot_be_started_is_replaced(tmp_path, monkeypatch):
    def refused(_):
        raise OSError(errno.EAGAIN, "Resource temporarily unavailable")

    desk = Desk(1, LIMIT, 2000, (), tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(SpawnProcess, "start", refused)
        with pytest.raises(ServiceError, match="a process for this cannot be started: Resource temporarily unavail"):
            desk.run(add, 1)
    assert desk.run(add, 1) == 2
    desk.close()


def test_what_cannot_be_sent_does_no_harm(desk):
    with pytest.raises((TypeError, AttributeError, ValueError)):
        desk.run(lambda: None)
    assert desk.run(add, 1) == 2


def test_time_limit(desk, monkeypatch):
    desk.run(add, 1)  # its start has a limit of its own
    monkeypatch.setattr(desk, "seconds", 0.05)
    with pytest.raises(TooMuchWork, match=r"longer than the 0.05 s that the service allows"):
        desk.run(sleep, 600)
    assert desk.run_within(LIMIT, sleep, 0.3) is None
    monkeypatch.undo()
    assert desk.run(add, 1) == 2


def test_busy(desk, monkeypatch):
    monkeypatch.setattr(module, "PATIENCE", 0.0)
    with desk._helper("ann"), pytest.raises(Busy, match="try again in a moment"):
        desk.run(add, 1)
    assert desk.run(add, 1) == 2
    assert not desk._asked
    assert not desk._at_work


def test_a_user_leaves_a_helper_to_others(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "PATIENCE", 0.0)
    desk = Desk(3, LIMIT, 2000, (), tmp_path)
    with desk._helper("ann"), desk._helper("ann"):
        with pytest.raises(Busy), desk._helper("ann"):
            pass
        with desk._helper("bob"), pytest.raises(Busy), desk._helper("carl"):
            pass
        with desk._helper("carl"):
            pass


def test_who_asks_for_much_work_waits_no_longer(desk, monkeypatch):
    monkeypatch.setattr(module, "PATIENCE", LIMIT)
    monkeypatch.setattr(module, "MAX_OF_USER", 2)
    monkeypatch.setattr(module, "MAX_REQUESTS", 3)
    waiting = []

    def wait(user):
        ASKED_BY.set(user)
        waiting.append(desk.run(add, 1))

    with desk._helper("ann"):
        threads = [threading.Thread(target=wait, args=(user,)) for user in ("ann", "bob")]
        for thread in threads:
            thread.start()
        wait_until(lambda: desk._asked == {"ann": 2, "bob": 1})
        for user in ("ann", "carl"):  # the one has too much work, then all together
            with pytest.raises(Busy, match="too much work"), desk._helper(user):
                pass
    for thread in threads:
        thread.join(LIMIT)
    assert waiting == [2, 2]


def test_memory_limit(desk, monkeypatch):
    process, _ = desk.run(where)
    monkeypatch.setattr(desk, "megabytes", 1)
    with pytest.raises(TooMuchWork, match="more than the 1 MB of memory"):
        desk.run(sleep, 600)
    monkeypatch.undo()
    assert desk.run(where)[0] != process


def test_a_helper_that_has_died_without_work_is_replaced(desk):
    process, _ = desk.run(where)
    os.kill(process, signal.SIGKILL)
    wait_until(lambda: not desk._idle[-1]._process.is_alive())
    assert desk.run(add, 1) == 2


@pytest.mark.skipif(not Path("/proc/self/oom_score_adj").exists(), reason="Linux alone has it")
def test_helpers_die_before_the_service(desk):
    assert desk.run(oom_score) == "500\n"


def is_there(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def test_close_ends_work_and_processes(tmp_path):
    desk = Desk(1, LIMIT, 2000, (), tmp_path)
    process, _ = desk.run(where)
    failed = []

    def work():
        try:
            desk.run(sleep, 600)
        except ServiceError as error:
            failed.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    wait_until(lambda: not desk._idle)
    desk.close()
    thread.join(LIMIT)
    assert failed
    wait_until(lambda: not is_there(process))
    assert not desk._idle


def test_a_desk_that_is_closed_starts_no_process(tmp_path):
    desk = Desk(1, LIMIT, 2000, (), tmp_path)
    desk.close()
    with pytest.raises(ServiceError, match="the service ends"):
        desk.run(add, 1)
