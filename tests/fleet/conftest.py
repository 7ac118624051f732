"""Robots that are reached over an ssh and an scp that act in local folders: a host is a folder, its home."""

import contextlib
import functools
import os
import signal
import stat
import sys
from pathlib import Path

import pytest

from mercator_design.fleet import deploy as deployment
from mercator_design.fleet import ssh
from mercator_design.fleet.bundle import bundle
from mercator_design.robot.protocols import joint_start
from tests.fleet.fakes import FAKE, GO, PATIENT
from tests.processes import LIMIT

ROOT = Path(__file__).parents[2]


same_bundle = functools.cache(bundle)  # the sources do not change between tests


@pytest.fixture
def field(tmp_path, monkeypatch):
    """A folder with the homes of the robots r1 and r2, fsm.txt and robots.yaml."""
    programs = tmp_path / "bin"
    programs.mkdir()
    for name, text in {"ssh": FAKE, "scp": FAKE, "python3": PATIENT}.items():
        file = programs / name
        file.write_text(text.format(python=sys.executable, root=tmp_path, log=tmp_path / "calls", source=ROOT))
        file.chmod(file.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", str(programs), prepend=":")
    monkeypatch.delenv("PYTHONPATH", raising=False)
    for name, seconds in {
        "SILENCE": 600.0,
        "_ANSWER_LIMIT": 600.0,
        "_CLOCK_LIMIT": 600.0,
        "LEAD": 1.5,
        "PROBE": 0.02,
    }.items():
        monkeypatch.setattr(joint_start, name, seconds)
    monkeypatch.setattr(ssh, "END_WAIT", LIMIT)
    monkeypatch.setattr(deployment, "bundle", same_bundle)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fsm.txt").write_text(GO)
    (tmp_path / "robots.yaml").write_text(
        "robots: [{name: r1, host: r1}, {name: r2, host: r2, user: pi, port: 2222}]\n"
    )
    for name in ("r1", "r2"):
        (tmp_path / name).mkdir()
    yield tmp_path
    for file in tmp_path.glob("*/mercator/pid"):  # of a test that failed
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):
            pid = int(file.read_text())
            if Path(f"/proc/{pid}/cwd").readlink() == file.parent:
                os.kill(pid, signal.SIGKILL)


@pytest.fixture
def deploy(mdesign):
    return lambda *arguments: mdesign("deploy", "--robots", "robots.yaml", *arguments)
