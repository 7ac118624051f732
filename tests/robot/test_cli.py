"""The command line of mercator-robot: what a user types, and what is said of mistakes."""

import os
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from mercator_design.robot.swarm import HEARTBEAT, STOP, STOPPED, listener

ROOT = Path(__file__).parents[2]
GO = "--nstates 1 --s0 0 --rwm0 20"


@pytest.fixture
def fsm(tmp_path):
    file = tmp_path / "fsm.txt"
    file.write_text(GO)
    return file


@pytest.fixture
def robot():
    """A socket where a robot would listen, and its port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        port = probe.getsockname()[1]
    with listener(port) as listening:
        listening.setblocking(True)
        yield listening, port


class TestRun:
    def test_a_pfsm_that_is_none(self, robot_command, fsm, tmp_path):
        fsm.write_text("--nstates 1 --s0 9")
        code, _, err = robot_command("run", fsm)
        assert (code, err.startswith(f"Error: {fsm}:1: --s0, the behaviour of state 0: expected one of")) == (3, True)
        assert robot_command("run", tmp_path / "none.txt")[0] == 3
        fsm.write_text(f"# floor: black, pink\n{GO}")
        assert "found 'pink'" in robot_command("run", fsm)[2]

    def test_settings_that_are_none(self, robot_command, fsm, tmp_path, monkeypatch):
        settings = tmp_path / "robot.yaml"
        settings.write_text("limits:\n  speeed: 0.2\n")
        code, _, err = robot_command("run", fsm, "--robot", settings)
        assert (code, f"Error: {settings}:2: limits.speeed: unknown key; did you mean 'speed'?" in err) == (3, True)
        monkeypatch.setenv("MERCATOR_ROBOT", str(settings))
        assert robot_command("run", fsm)[0] == 3
        assert robot_command("run", fsm, "--robot", tmp_path / "none.yaml")[0] == 3

    def test_a_port_that_is_missing(self, robot_command, fsm, tmp_path):
        settings = tmp_path / "robot.yaml"
        settings.write_text("ports: {rvr: /dev/no_such_port}\n")
        log = tmp_path / "log.jsonl"
        code, _, err = robot_command("run", fsm, "--robot", settings, "-o", log)
        assert (code, err.startswith("Error: rvr: /dev/no_such_port: no such port")) == (1, True), err
        assert not log.exists()

    @pytest.mark.parametrize("options", [["--duration", "-1"], ["--seed", "x"], ["--speed", "1"]])
    def test_wrong_usage(self, robot_command, fsm, options):
        assert robot_command("run", fsm, *options)[0] == 2


class TestStop:
    def test_a_robot_that_answers(self, robot_command, robot):
        listening, port = robot

        def answer():
            message, sender = listening.recvfrom(100)
            assert message == STOP
            listening.sendto(STOPPED + b"r2", sender)

        answering = threading.Thread(target=answer)
        answering.start()
        assert robot_command("stop", "localhost", "--port", port) == (0, "r2 (127.0.0.1) has stopped\n", "")
        answering.join()

    def test_none_answers(self, robot_command, robot):
        code, out, err = robot_command("stop", "127.0.0.1", "--port", robot[1])
        assert (code, out) == (1, "")
        assert err == "Error: no robot has answered; one that runs nothing does not\n"

    def test_a_host_that_is_not_known(self, robot_command):
        code, _, err = robot_command("stop", "no..such..host")
        assert (code, err) == (1, "Error: no..such..host: no such host\n")


def test_heartbeats_until_they_end_and_then_stop(robot):
    listening, port = robot
    script = "from mercator_design.robot.cli import main; main()"
    beating = subprocess.Popen(
        [sys.executable, "-c", script, "heartbeat", "127.0.0.1", "--port", str(port)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stderr=subprocess.PIPE,
        text=True,
    )
    listening.settimeout(20.0)
    assert [listening.recvfrom(100)[0] for _ in range(5)] == [HEARTBEAT] * 5
    beating.send_signal(signal.SIGINT)
    while (told := listening.recvfrom(100)[0]) != STOP:
        assert told == HEARTBEAT
    assert "Interrupted." in beating.communicate()[1]
    assert beating.returncode == 130
