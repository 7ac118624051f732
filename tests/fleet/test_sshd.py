"""Robots are deployed to over the system's ssh and scp, to an OpenSSH server on this machine.

A robot is a folder of this user's, and has the ports of a twin. Skipped where no server is installed.
"""

import contextlib
import getpass
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from mercator_design import __version__
from tests.processes import wait_until
from tests.robot.log_events import read
from tests.robot.ways import ATTEMPTS
from tests.twin.processes import events, twin

SSHD = shutil.which("sshd", path="/usr/sbin:/usr/local/sbin:" + os.environ.get("PATH", ""))
SSH, SCP, KEYGEN = map(shutil.which, ("ssh", "scp", "ssh-keygen"))
SERVER = """
ListenAddress {address}:{port}
HostKey {folder}/host
AuthorizedKeysFile {folder}/key.pub
PidFile none
UsePAM no
StrictModes no
PasswordAuthentication no
KbdInteractiveAuthentication no
Subsystem sftp internal-sftp
SetEnv PATH={folder}/bin:/usr/bin:/bin
"""
CLIENT = "IdentityFile {folder}/key\nUserKnownHostsFile {folder}/known\nStrictHostKeyChecking accept-new\n"
GO = "# mission: aggregation\n--nstates 1 --s0 0 --rwm0 20\n"

pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(not all((SSHD, SSH, SCP, KEYGEN)), reason="no OpenSSH server here"),
]


@pytest.fixture(params=["127.0.0.1", "::1"])
def server(request, tmp_path, monkeypatch):
    """Address, port, and a folder in which robots may be; `ssh` here uses the key of this test alone."""
    family = socket.AF_INET6 if ":" in request.param else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        try:
            probe.bind((request.param, 0))
        except OSError:
            pytest.skip(f"no {request.param} on this machine")
        port = probe.getsockname()[1]
    for name in ("host", "key"):
        subprocess.run([KEYGEN, "-q", "-t", "ed25519", "-N", "", "-f", tmp_path / name], check=True)
    programs = tmp_path / "bin"
    programs.mkdir()
    (programs / "python3").symlink_to(sys.executable)
    for name, program in (("ssh", SSH), ("scp", SCP)):
        (programs / name).write_text(f'#!/bin/sh\nexec {program} -F {tmp_path}/client "$@"\n')
        (programs / name).chmod(0o755)
    (tmp_path / "client").write_text(CLIENT.format(folder=tmp_path))
    address = f"[{request.param}]" if ":" in request.param else request.param
    (tmp_path / "server").write_text(SERVER.format(folder=tmp_path, address=address, port=port))
    if os.geteuid() == 0:
        Path("/run/sshd").mkdir(exist_ok=True)  # where it wants to live as root
    monkeypatch.setenv("PATH", str(programs), prepend=":")
    monkeypatch.chdir(tmp_path)
    with subprocess.Popen([SSHD, "-D", "-e", "-f", tmp_path / "server"], stderr=subprocess.PIPE, text=True) as process:
        try:
            assert "Server listening" in process.stderr.readline()
            yield request.param, port, tmp_path
        finally:
            process.kill()


@contextlib.contextmanager
def deployed(mdesign, server, robots):
    """`mdesign deploy` for robots of a twin, to which the program has been copied."""
    address, port, folder = server
    (folder / "fsm.txt").write_text(GO)
    user = getpass.getuser()
    rows = [
        f"- {{name: r{k}, host: '{address}', user: {user}, port: {port}, folder: {folder}/r{k}}}\n"
        for k in range(robots)
    ]
    (folder / "robots.yaml").write_text("robots:\n" + "".join(rows))

    def deploy(*arguments):
        return mdesign("deploy", "--robots", "robots.yaml", *arguments)

    version = "".join(f"ok      r{k:<15} mercator-robot, version {__version__}\n" for k in range(robots))
    with twin(folder / "twin", robots):
        assert deploy("fsm.txt") == (0, version, "")
        for k in range(robots):
            settings = (folder / f"twin/{k}/robot.yaml").read_text()
            # A twin may be late on a busy machine.
            (folder / f"r{k}/robot.yaml").write_text(re.sub(r"\b(rvr|proximity|lidar): 0\.\d+", r"\1: 5", settings))
        yield deploy


def in_time_started(deploy, *options):
    """A start that is not refused because this machine is too busy."""
    for _ in range(ATTEMPTS):
        code, out, err = deploy("fsm.txt", "--start", *options)
        if code == 0:
            return out, err
        assert "too busy?" in err, (out, err)
    raise AssertionError(err)


def test_from_copy_to_collect(mdesign, server):
    *_, folder = server
    with deployed(mdesign, server, 2) as deploy:
        out, _ = in_time_started(deploy, "--duration", 60)
        assert out.count("runs, logs/run-") == 2
        wait_until(lambda: {event["robot"] for event in wheels(folder) if event["left"]} == {0, 1})
        assert (
            deploy("fsm.txt")[1].count("a run is in progress; end it first: mdesign deploy --robots ... --stop") == 2
        ), said(folder)
        code, out, err = deploy("--stop", "--collect", "all")
        assert (code, err) == (0, ""), out
        assert [row[:32].split() for row in out.splitlines()[:2]] == [["ok", f"r{k}", "stopped"] for k in range(2)]
        for k in range(2):
            *_, last = (event for event in wheels(folder) if event["robot"] == k)
            assert (last["left"], last["right"]) == (0.0, 0.0)
            log = max((folder / f"all/r{k}").glob("*.jsonl"))
            assert [*read(log)][-1]["why"] == "Stopped by SIGTERM."
        assert deploy("--stop")[1].count("nothing that deploy has started runs") == 2


def test_five_robots_begin_within_a_control_cycle(mdesign, server):
    *_, folder = server
    with deployed(mdesign, server, 5) as deploy:
        for _ in range(ATTEMPTS):
            since = events(folder / "twin", "poses")[-1]["time"]
            in_time_started(deploy, "--duration", 2)
            time.sleep(0.5)
            driven = {}
            for event in wheels(folder):
                if event["time"] > since and event["left"]:
                    driven.setdefault(event["robot"], event["time"])
            assert len(driven) == 5
            apart = max(driven.values()) - min(driven.values())
            deploy("--stop")
            if apart <= 0.1:
                break
        assert apart <= 0.1  # by the twin's clock, which may be late too


@pytest.mark.parametrize("how", ["its connection is cut", "its process is killed"])
def test_a_robot_that_vanishes_before_the_start_keeps_all_at_rest(mdesign, server, how):
    """By the death of the process that serves its connection, or of its own."""
    *_, folder = server

    def vanish():
        while not (folder / "r1/pid").exists() or events(folder / "twin", "leds")[-1:] == []:
            time.sleep(0.05)
        time.sleep(1.0)  # while it starts up, or is ready
        run = int((folder / "r1/pid").read_text())
        os.kill(run if how == "its process is killed" else served_by(run), signal.SIGKILL)

    with deployed(mdesign, server, 3) as deploy:
        vanishing = threading.Thread(target=vanish)
        vanishing.start()
        code, out, err = deploy("fsm.txt", "--start")
        vanishing.join()
        assert (code, err.startswith("Error: no robot runs: r1: ")) == (1, True), (out, err)
        for k in (0, 2):
            assert f"FAILED  r{k}               Error: the start was called off: r1: " in out
        if how == "its connection is cut":
            assert "; over another connection: " in out
        assert deploy("--stop")[1].count("nothing that deploy has started runs") == 3
        assert not any(event["left"] or event["right"] for event in wheels(folder))


def served_by(process):
    """The sshd that has begun a process."""
    while "sshd" not in Path(f"/proc/{process}/comm").read_text():
        process = int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])
    return process


def test_a_table_of_all_robots(mdesign, server):
    with deployed(mdesign, server, 3) as deploy:
        _, out, _ = deploy("--check")
        rows = [row for row in out.splitlines() if re.match(r"r\d ", row)]
        assert len(rows) == 3
        assert all("100 %" in row and "give or take" in row for row in rows)


def said(folder):
    """What the robots have said, as one that is too busy stops by itself."""
    return [file.read_text() for file in folder.glob("r*/logs/*.txt")]


def wheels(folder):
    return events(folder / "twin", "wheels")


def test_a_key_that_is_not_known(mdesign, server):
    address, port, folder = server
    (folder / "key.pub").write_text("")
    (folder / "robots.yaml").write_text(f"robots: [{{name: r, host: '{address}', port: {port}}}]")
    code, out, err = mdesign("deploy", "--robots", "robots.yaml", "--stop")
    assert (code, err) == (1, "Error: 1 of 1 robots failed\n")
    assert "Permission denied (publickey)" in out
