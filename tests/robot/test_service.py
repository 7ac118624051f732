"""What systemd hears of a run, over a socket that a test has in its place."""

import contextlib
import os
import signal
import socket
import time

import pytest

from mercator_design.robot.run.service import notify
from tests.processes import LIMIT
from tests.robot.ways import IMPATIENT, LATE, PATIENT, SOON, running


@pytest.fixture
def address(tmp_path):
    return str(tmp_path / "notify")


@pytest.fixture
def manager(address, monkeypatch):
    """The socket that a service is told of."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(address)
        listening.settimeout(LIMIT)
        monkeypatch.setenv("NOTIFY_SOCKET", address.replace("\0", "@"))
        yield listening


def heard(manager):
    return dict(line.split("=", 1) for line in manager.recv(4096).decode().splitlines())


def drain(manager):
    """What is there to be heard; nothing if that is nothing."""
    with contextlib.suppress(BlockingIOError):
        return heard(manager)


def test_a_run_is_ready_alive_in_each_cycle_and_stopping(manager, tmp_path):
    with running(tmp_path, settings=LATE, lead=SOON + PATIENT) as robot:
        assert heard(manager) == {"READY": "1", "STATUS": "mercator runs, log.jsonl"}
        assert [heard(manager) for _ in range(5)] == [{"WATCHDOG": "1"}] * 5
        robot.process.send_signal(signal.SIGTERM)
        while (told := heard(manager)) == {"WATCHDOG": "1"}:
            pass
        assert told["STOPPING"] == "1"
        assert robot.ended()[0] == 143
        manager.setblocking(False)
        assert not drain(manager)


def test_a_run_that_hangs_is_not_said_to_be_alive(manager, tmp_path):
    with running(tmp_path, settings=LATE, fault="time.sleep(60)", lead=SOON + PATIENT) as robot:
        robot.drives()
        robot.fault()
        time.sleep(0.1)
        manager.setblocking(False)
        while drain(manager):
            pass
        time.sleep(0.5)
        assert not drain(manager)


def test_a_start_that_fails_is_never_ready(manager, tmp_path):
    with running(tmp_path, settings=", heartbeat: 0.5", lead=SOON + IMPATIENT) as robot:
        assert "no heartbeat" in robot.ended()[1]
    assert heard(manager)["STOPPING"] == "1"


@pytest.mark.parametrize("address", [f"\0mercator-{os.getpid()}"], ids=["abstract"])
def test_a_socket_without_a_file(manager):
    notify(READY=1, STATUS="runs")
    assert heard(manager) == {"READY": "1", "STATUS": "runs"}


@pytest.mark.parametrize("nowhere", ["", "/no/such/socket"])
def test_nobody_listens(monkeypatch, nowhere):
    monkeypatch.setenv("NOTIFY_SOCKET", nowhere)
    notify(READY=1)


def test_a_manager_that_does_not_read_holds_nothing_up(manager):
    for _ in range(10_000):
        notify(WATCHDOG=1)
