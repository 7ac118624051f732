"""Robots are deployed to over the system's ssh and scp, to an OpenSSH server on this machine.

A robot is a folder of this user's, and has the ports of a twin. Skipped where no server is installed.
"""

import getpass
import os
import re
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mercator_design import __version__
from mercator_design.robot.log import read
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
    pytest.mark.slow,
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


def test_two_robots_from_copy_to_collect(mdesign, server):
    address, port, folder = server
    (folder / "fsm.txt").write_text(GO)
    rows = [
        f"- {{name: r{k}, host: '{address}', user: {getpass.getuser()}, port: {port}, folder: {folder}/r{k}}}\n"
        for k in range(2)
    ]
    (folder / "robots.yaml").write_text("robots:\n" + "".join(rows))

    def deploy(*arguments):
        return mdesign("deploy", "--robots", "robots.yaml", *arguments)

    version = "".join(f"ok      r{k:<15} mercator-robot, version {__version__}\n" for k in range(2))
    with twin(folder / "twin", 2):
        assert deploy("fsm.txt") == (0, version, "")
        for k in range(2):
            settings = (folder / f"twin/{k}/robot.yaml").read_text()
            patient = re.sub(
                r"(rvr|proximity|lidar): 0\.\d+", r"\1: 5", settings
            )  # a twin may be late on a busy machine
            (folder / f"r{k}/robot.yaml").write_text(patient)
        code, out, err = deploy("fsm.txt", "--start", "--duration", 60)
        assert (code, err) == (0, ""), out
        assert out.count("runs, logs/run-") == 2
        until = time.monotonic() + 20.0
        while not all(any(event["robot"] == k and event["left"] for event in wheels(folder)) for k in range(2)):
            assert time.monotonic() < until
            time.sleep(0.1)
        assert (
            deploy("fsm.txt")[1].count("a run is in progress; end it first: mdesign deploy --robots ... --stop") == 2
        ), said(folder)
        code, out, err = deploy("--stop", "--collect", "all")
        assert (code, err) == (0, ""), out
        assert out.splitlines() == [
            *(f"ok      r{k:<15} stopped" for k in range(2)),
            *(f"ok      r{k:<15} 2 files in all/r{k}" for k in range(2)),
        ]
        for k in range(2):
            *_, last = (event for event in wheels(folder) if event["robot"] == k)
            assert (last["left"], last["right"]) == (0.0, 0.0)
            (log,) = (folder / f"all/r{k}").glob("*.jsonl")
            assert [*read(log)][-1]["why"] == "Stopped by SIGTERM."
        assert deploy("--stop")[1].count("nothing that deploy has started runs") == 2


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
