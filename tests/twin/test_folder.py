"""Where a twin is whose user names no folder."""

import os
from pathlib import Path

import pytest

from mercator_design.errors import RobotError
from mercator_design.robot.cli import main
from mercator_design.twin import folder as of_twins
from mercator_design.twin.arena import TwinArena
from mercator_design.twin.folder import usual_folder


@pytest.fixture
def runtime(tmp_path, monkeypatch):
    """A user's runtime directory."""
    path = tmp_path / "runtime"
    path.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(path))
    return path


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A user's cache directory; the system has no runtime directory for the user."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(os, "getuid", lambda: 987654)
    stat, lstat = Path.stat, Path.lstat

    def owned(found):
        return os.stat_result((*found[:4], 987654, *found[5:]))

    monkeypatch.setattr(Path, "stat", lambda path, **given: owned(stat(path, **given)))
    monkeypatch.setattr(Path, "lstat", lambda path: owned(lstat(path)))
    return tmp_path / "cache/mercator_design"


def test_it_is_in_the_user_s_runtime_directory_and_closed_to_others(runtime):
    for _ in range(2):
        assert usual_folder() == runtime / "mercator-twin"
    assert (runtime / "mercator-twin").stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("named", ["", "relative", "/no/such/folder", "/tmp"])  # noqa: S108 - what it must not take
def test_without_a_runtime_directory_it_is_in_the_user_s_cache(cache, monkeypatch, named):
    monkeypatch.setenv("XDG_RUNTIME_DIR", named)
    assert usual_folder() == cache / "mercator-twin"
    assert (cache / "mercator-twin").stat().st_mode & 0o777 == 0o700


def test_a_runtime_directory_that_is_open_to_others_or_somebody_else_s_is_not_used(runtime, cache, monkeypatch):
    runtime.chmod(0o770)
    assert usual_folder() == cache / "mercator-twin"
    runtime.chmod(0o700)
    assert usual_folder() == runtime / "mercator-twin"
    monkeypatch.setattr(of_twins, "is_own", lambda found: False)
    with pytest.raises(RobotError):
        usual_folder()


@pytest.mark.parametrize("taken", ["open", "link", "file"])
def test_a_folder_that_somebody_else_may_have_taken_is_refused(runtime, tmp_path, taken):
    folder = runtime / "mercator-twin"
    match taken:
        case "open":
            folder.mkdir()
            folder.chmod(0o777)
        case "link":
            (tmp_path / "elsewhere").mkdir(mode=0o700)
            folder.symlink_to(tmp_path / "elsewhere")
        case "file":
            folder.write_text("mine")
    with pytest.raises(RobotError, match=r"mercator-twin: .*(give another folder|or give another) with --folder"):
        usual_folder()
    assert taken != "file" or folder.read_text() == "mine"


def test_the_command_uses_it(run_command, runtime, monkeypatch):
    def rehearse(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(TwinArena, "rehearse", rehearse)
    assert run_command("mercator-robot", main, "twin", "aggregation")[0] == 130
    assert (runtime / "mercator-twin/twin.jsonl").exists()


@pytest.mark.usefixtures("homeless")
def test_a_user_without_a_home_gives_a_folder(run_command, monkeypatch):
    monkeypatch.setattr(os, "getuid", lambda: 987654)  # nobody's, so /run/user has no folder of it
    code, _, err = run_command("mercator-robot", main, "twin", "aggregation")
    assert (code, err) == (1, "Error: this user has no home folder for the twin's ports; give a folder with --folder\n")
