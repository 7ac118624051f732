"""Reads untrusted files, and writes files atomically: a reader never sees an incomplete file."""

import contextlib
import glob
import os
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from mercator_design.errors import MercatorError


class Unreadable(Exception):  # noqa: N818 - callers raise their own error class
    """The reason why a file cannot be read."""


def read_small(path: Path, max_size: int) -> bytes:
    """The contents of a regular file of at most `max_size` bytes.

    Raises:
        Unreadable: with the reason.
    """
    try:
        if path.is_dir():
            wrong = "expected a file, found a folder"
        elif not path.exists():
            wrong = "no such file"
        elif not path.is_file():  # opening a pipe would block, reading a device might never end
            wrong = "expected a regular file, found a device or pipe"
        else:
            with path.open("rb") as file:
                data = file.read(max_size + 1)
            if len(data) <= max_size:
                return data
            wrong = f"expected at most {max_size // 1024} KiB, found a larger file"
    except OSError as error:
        wrong = f"cannot be read: {error.strerror}"
    except ValueError:  # a NUL in the path
        wrong = "no such file"
    raise Unreadable(wrong)


def contents_of(path: str | Path, max_size: int, error: type[Exception], label: str = "") -> bytes:
    """As `read_small`; raises an error of the given class, which names the path, or another label."""
    try:
        return read_small(Path(path), max_size)
    except Unreadable as wrong:
        raise error(f"{label or path}: {wrong}") from None


def small_text(path: str | Path, max_size: int, error: type[Exception], label: str = "") -> str:
    """The text of a UTF-8 file; errors are those of `contents_of`, with the line of what is not UTF-8."""
    return text_of(contents_of(path, max_size, error, label), error, label or str(path))


def text_of(data: bytes, error: type[Exception], label: str) -> str:
    """The text of the contents of a UTF-8 file; errors are those of `small_text`."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as wrong:
        line = data.count(b"\n", 0, wrong.start) + 1
        found = f"found the byte 0x{data[wrong.start]:02x}"
        raise error(f"{label}:{line}: expected UTF-8 text, {found}") from None


@contextlib.contextmanager
def writing(path: Path, error: type[MercatorError] = MercatorError) -> Iterator[None]:
    """Name the path that the user gave in errors on writing."""
    try:
        yield
    except OSError as wrong:
        raise error(f"{path}: cannot be written: {wrong.strerror or wrong}") from None


def sync_folder(path: Path) -> None:
    """Sync a folder, so that a new file is in it after a loss of power."""
    folder = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def write_text(path: Path, text: str) -> None:
    """Write a file atomically: after a crash there is either the old or the new one."""
    write_bytes(path, text.encode())


def write_bytes(path: Path, data: bytes) -> None:
    """As `write_text`."""
    with replacing(path) as file:
        file.write(data)


def remove_drafts(path: Path) -> None:
    """Remove drafts of a file whose writer was killed. No other process may be writing it."""
    for draft in path.parent.glob(glob.escape(_draft_of(path)) + "[0-9a-f]" * 8):
        draft.unlink()


def _draft_of(path: Path) -> str:
    return f".{path.name[:200]}-"


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """Open a draft that replaces a file when it is complete; if an error occurs, the draft is removed.

    The new file has the owner and the permissions of the old one. Links are followed; a device or pipe is written to.
    """
    before = path.stat() if path.exists() else None
    if before is not None and not stat.S_ISREG(before.st_mode):
        with path.open("wb") as file:
            yield file
        return
    path = Path(os.path.realpath(path))  # only now: /dev/stdout may lead to a pipe, which has no path
    draft = path.with_name(f"{_draft_of(path)}{secrets.token_hex(4)}")
    try:
        with draft.open("xb") as file:
            if before is not None:
                with contextlib.suppress(OSError):  # only root may change the owner
                    os.fchown(file.fileno(), before.st_uid, before.st_gid)
                os.fchmod(file.fileno(), stat.S_IMODE(before.st_mode))
            yield file
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise
