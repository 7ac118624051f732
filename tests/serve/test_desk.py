"""Helper processes for short work: their results, errors, time limits, deaths, end."""

import os
import signal
import threading
import time

import pytest

from mercator_design.errors import MissionError
from mercator_design.serve.desk import desk as module
from mercator_design.serve.desk.desk import Busy, Desk, TimeLimit
from mercator_design.serve.settings import ServiceError
from tests.processes import wait_until


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


def unsendable():
    return lambda: None


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    folder = tmp_path_factory.mktemp("desk")
    desk = Desk(1, 60.0, (), folder)
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


def test_what_cannot_be_sent_does_no_harm(desk):
    with pytest.raises((TypeError, AttributeError, ValueError)):
        desk.run(lambda: None)
    assert desk.run(add, 1) == 2


def test_time_limit(desk, monkeypatch):
    desk.run(add, 1)  # its start has a limit of its own
    monkeypatch.setattr(desk, "_seconds", 0.05)
    with pytest.raises(TimeLimit, match=r"longer than the 0.05 s that the service allows"):
        desk.run(sleep, 60)
    monkeypatch.undo()
    assert desk.run(add, 1) == 2


def test_busy(desk, monkeypatch):
    monkeypatch.setattr(module, "_PATIENCE", 0.0)
    helper = desk._idle.get()
    with pytest.raises(Busy, match="try again in a moment"):
        desk.run(add, 1)
    desk._idle.put(helper)
    assert desk.run(add, 1) == 2


def is_there(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def test_close_ends_work_and_processes(tmp_path):
    desk = Desk(1, 60.0, (), tmp_path)
    process, _ = desk.run(where)
    failed = []

    def work():
        try:
            desk.run(sleep, 600)
        except ServiceError as error:
            failed.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    wait_until(desk._idle.empty)
    desk.close()
    thread.join(60)
    assert failed
    wait_until(lambda: not is_there(process))
    assert desk._idle.empty()
