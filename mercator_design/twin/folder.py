"""The folder of a twin whose user names none: one that is the user's own."""

import os
import stat
from pathlib import Path

import platformdirs

from mercator_design.errors import RobotError

_NAME = "mercator-twin"


def usual_folder() -> Path:
    """The folder `mercator-twin` in the user's runtime directory, which is made.

    Without a runtime directory, as in a container or after `su`, it is in the user's cache directory.

    Raises:
        RobotError: if the folder cannot be made, belongs to somebody else, or is open to others.
    """
    folder = (_runtime_directory() or platformdirs.user_cache_path("mercator_design")) / _NAME
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise RobotError(f"{folder}: cannot be made: {error.strerror}; give another folder with --folder") from None
    if not _is_own(found):
        raise RobotError(
            f"{folder}: expected a folder of this user's that nobody else may use (mode 0700), "
            f"found {stat.filemode(found.st_mode)} of user {found.st_uid}; remove it, or give another with --folder"
        )
    return folder


def _runtime_directory() -> Path | None:
    """As the XDG Base Directory Specification has it: of this user, and of nobody else; None if there is none."""
    for name in (os.environ.get("XDG_RUNTIME_DIR", ""), f"/run/user/{os.getuid()}"):
        path = Path(name)
        try:
            if path.is_absolute() and _is_own(path.stat()):
                return path
        except OSError:
            continue
    return None


def _is_own(found: os.stat_result) -> bool:
    """Whether it is a folder of this user's that is closed to others."""
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and stat.S_IMODE(found.st_mode) & 0o077 == 0
