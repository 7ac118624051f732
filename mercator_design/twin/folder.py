"""The folder of a twin, with its log. The default is a folder that only the user can enter."""

import contextlib
import fcntl
import json
import os
import stat
from collections.abc import Iterator
from pathlib import Path

from mercator_design.errors import RobotError
from mercator_design.robot.devices.ports import DEVICES
from mercator_design.system.files import writing
from mercator_design.system.user_folders import user_folder
from mercator_design.twin.twin import Log

ROBOT = "robot.yaml"
LOG = "twin.jsonl"
BEGINS = {ROBOT: b"# A twin's, which takes this file away when it ends.\n", LOG: b'{"time": 0.0, "event": "'}
"""The first bytes of a twin's files, by which those of a killed twin are recognised."""
FRESH = ".new"
"""Suffix of a new link until it replaces the old one."""
_NAME = "mercator-twin"


def usual_folder() -> Path:
    """Make the folder `mercator-twin` in the user's runtime directory.

    Without a runtime directory, as in a container or after `su`, it is made in the user's cache directory.

    Raises:
        RobotError: if the folder cannot be made, belongs to another user, or others may enter it.
    """
    parent = _runtime_directory() or user_folder("cache")
    if parent is None:
        raise RobotError("this user has no home folder for the twin's ports; give a folder with --folder")
    folder = parent / _NAME
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise RobotError(f"{folder}: cannot be made: {error.strerror}; give another folder with --folder") from None
    if not is_own(found):
        raise RobotError(
            f"{folder}: expected a folder of this user that is closed to others (mode 0700), "
            f"found {stat.filemode(found.st_mode)} of user {found.st_uid}; remove it, or give another with --folder"
        )
    return folder


def _runtime_directory() -> Path | None:
    """The directory by the XDG Base Directory Specification, which only this user can enter; None if there is none."""
    for name in (os.environ.get("XDG_RUNTIME_DIR", ""), f"/run/user/{os.getuid()}"):
        path = Path(name)
        try:
            if path.is_absolute() and is_own(path.stat()):
                return path
        except OSError:
            continue
    return None


def is_own(found: os.stat_result) -> bool:
    """Whether it is a folder that only this user can enter."""
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and stat.S_IMODE(found.st_mode) & 0o077 == 0


@contextlib.contextmanager
def open_log(folder: Path) -> Iterator[Log]:
    """The log in a folder: one JSON object a line, each written at once. No other twin can open it meanwhile.

    Raises:
        RobotError: if another twin has the folder, a file that is not a twin's is in the place of the log, or
            the folder cannot be written to.
    """
    with writing(folder, RobotError):
        folder.mkdir(parents=True, exist_ok=True)
        check_free(folder / LOG)
        stream = (folder / LOG).open("a", encoding="utf-8")
    with stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise RobotError(f"{folder}: another twin is running there; end it, or choose another folder") from None
        stream.truncate(0)
        yield lambda event: print(json.dumps(event), file=stream, flush=True)


def check_free(path: Path) -> None:
    """Check that a twin may write a file: there is none, or a twin has left it.

    Raises:
        RobotError: if it may not.
    """
    if os.path.lexists(path) and not _is_left(path):
        raise RobotError(f"{path} exists and is not a twin's; move it, or choose another folder")


def _is_left(path: Path) -> bool:
    """Whether a twin has made a file."""
    if path.is_symlink():
        return path.name.removesuffix(FRESH) in DEVICES and str(path.readlink()).startswith("/dev/pts/")
    if not path.is_file() or path.name not in BEGINS:
        return False
    begins = BEGINS[path.name]
    with path.open("rb") as file:
        return file.read(len(begins)) in (begins, b"")
