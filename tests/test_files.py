"""What is at a path before something is written there."""

import os
import stat
import threading
from pathlib import Path

import pytest

from mercator_design.system.files import replacing, write_text


def test_owner_and_rights_stay(tmp_path, monkeypatch):
    given = []
    monkeypatch.setattr(os, "fchown", lambda _, uid, gid: given.append((uid, gid)))
    path = tmp_path / "robot.yaml"
    path.write_text("before")
    path.chmod(0o640)
    write_text(path, "after")
    assert (path.read_text(), stat.S_IMODE(path.stat().st_mode)) == ("after", 0o640)
    assert given == [(path.stat().st_uid, path.stat().st_gid)]


def test_of_another_s_file_the_owner_cannot_stay(tmp_path, monkeypatch):
    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "fchown", refuse)
    path = tmp_path / "robot.yaml"
    path.write_text("before")
    write_text(path, "after")
    assert path.read_text() == "after"


def test_a_link_is_followed(tmp_path):
    link, file = tmp_path / "link", tmp_path / "there" / "file"
    file.parent.mkdir()
    link.symlink_to(file)
    for text in ("new", "again"):
        write_text(link, text)
        assert (link.is_symlink(), file.read_text()) == (True, text)


def test_a_pipe_is_written_to(tmp_path):
    path, read = tmp_path / "pipe", []
    os.mkfifo(path)
    reader = threading.Thread(target=lambda: read.append(path.read_text()))
    reader.start()
    write_text(path, "through")
    reader.join()
    assert (read, path.is_fifo()) == (["through"], True)


def test_a_device_stays_one(tmp_path):
    path = tmp_path / "nowhere"
    path.symlink_to(os.devnull)
    write_text(path, "gone")
    assert stat.S_ISCHR(path.stat().st_mode)


@pytest.mark.parametrize("name", ["", ".", "/"])
def test_a_folder_is_none_to_write_to(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(IsADirectoryError):
        write_text(Path(name), "text")


def test_nothing_is_left_of_what_goes_wrong(tmp_path):
    path = tmp_path / "file"
    path.write_text("before")
    with pytest.raises(TypeError), replacing(path) as file:
        file.writelines([b"half", None])
    assert [each.read_text() for each in tmp_path.iterdir()] == ["before"]


def test_what_a_name_of_the_system_leads_to_is_written_to():
    """As /dev/stdout before `|`, and `>(...)`: a link that leads to no path."""
    end, pipe = os.pipe()
    write_text(Path(f"/dev/fd/{pipe}"), "through")
    os.close(pipe)
    with os.fdopen(end) as file:
        assert file.read() == "through"
