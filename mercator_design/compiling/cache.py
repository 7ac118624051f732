"""The cache of machine code on disk: numba's keys and data, in one checked file for each function and types.

A file of machine code is unpickled and executed: a flipped bit may end the interpreter, and whoever can write a file
can run any code. So a file is only loaded if it belongs to this user, nobody else may write to it, and it ends in a
digest of its contents; else the code is compiled again. Of the processes that want the same function, one compiles it.
"""

import atexit
import contextlib
import fcntl
import functools
import hashlib
import os
import pickle
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from mercator_design.system import address_space
from mercator_design.system.user_folders import user_folder

_DIGEST = 32
"""Bytes of the digest at the end of a file."""
_PATIENCE = 180.0
"""Seconds to wait for a process that compiles."""


class Place(NamedTuple):
    """The folder of the cache."""

    folder: Path | None  # None: there is none
    problem: str  # why what is compiled is lost when this process ends, and what to do; empty if it is kept


@functools.cache
def place(name: str) -> Place:
    """The folder of a name in the user's cache; if nothing can be written there, a temporary folder of this process.

    The cache is NUMBA_CACHE_DIR if that is set, else the user's cache folder. What is in it is copied to the temporary
    folder. Processes that this one starts use the temporary folder, too.
    """
    given = os.environ.get("NUMBA_CACHE_DIR")
    usual = Path(given) if given else user_folder("cache")
    problem, readable = "this user has no home folder", []
    if usual is not None:
        folder, us = usual.absolute() / name, os.geteuid()
        problem = f"{usual / name}: no file can be written there"
        with contextlib.suppress(OSError):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            readable = [*folder.iterdir()]
            if (owner := folder.stat().st_uid) != us:
                problem = f"{usual / name} belongs to user {owner}, not to {us}"
            else:
                with tempfile.TemporaryFile(dir=folder):
                    return Place(folder, "")
    problem += "; set NUMBA_CACHE_DIR to a folder of your own"
    try:
        cache = Path(tempfile.mkdtemp(prefix="mercator_design-"))  # only this user may enter it
        (cache / name).mkdir()
    except OSError:
        return Place(folder if readable else None, problem)
    atexit.register(shutil.rmtree, cache, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = str(cache)
    for file in readable:
        with contextlib.suppress(OSError):  # what cannot be copied is compiled
            write_whole(cache / name / file.name, read_whole(file))
    return Place(cache / name, problem)


def cache_of(function: Callable[..., Any], folder: Path | None, part: str, missed: Callable[[], None]) -> Any:
    """A cache for numba's dispatcher of a function, which raises only MemoryError: if LLVM would end this process.

    Args:
        function: The function.
        folder: Where its files are; None if nothing is kept.
        part: A digest of the kernels of other packages in it, such as plugins; empty if there are none.
        missed: Called before something is compiled.
    """
    import numba
    from numba.core import caching, compiler

    class Cache(caching.FunctionCache):  # type: ignore[misc]
        """The compiled forms of the function."""

        def __init__(self) -> None:
            self._py_func = function  # all that numba's key needs
            self.turn = contextlib.ExitStack()  # to be closed if it cannot be compiled

        def load_overload(self, signature: Any, context: Any) -> Any:
            """The machine code in the cache; None if it has to be compiled."""
            address_space.require(address_space.TO_LOAD, "to load machine code")
            if (found := self._found(signature, context)) is None:
                address_space.require(address_space.TO_COMPILE, "to compile")
                missed()
                with contextlib.suppress(OSError):
                    self.turn.enter_context(turn(file_of("turn").with_suffix(".lock")))
                if (found := self._found(signature, context)) is not None:  # another process has just compiled it
                    self.turn.close()
            return found

        def _found(self, signature: Any, context: Any) -> Any:
            with contextlib.suppress(Exception):  # for example, it is not there, or cannot be unpickled here
                context.refresh()
                key = self._index_key(signature, context.codegen())
                found, data = pickle.loads(read_whole(file_of(key)))  # noqa: S301 - written by this user
                if found == key:
                    return compiler.CompileResult._rebuild(context, *data)  # noqa: SLF001 - as numba's cache does
            return None

        def save_overload(self, signature: Any, result: Any) -> None:
            """Keep machine code, unless it has addresses of this process."""
            with self.turn, contextlib.suppress(Exception):  # for example, the disk is full
                if not result.library.has_dynamic_globals:
                    key = self._index_key(signature, result.codegen)
                    write_whole(file_of(key), caching.dumps((key, result._reduce())))  # noqa: SLF001

    def file_of(key: object) -> Path:
        if folder is None:
            raise FileNotFoundError
        versions = sys.implementation.cache_tag, numba.__version__, part
        digest = hashlib.sha256(repr((versions, key)).encode()).hexdigest()
        return folder / f"{function.__module__}.{function.__name__}-{digest[:32]}.nbc"

    return Cache()


@contextlib.contextmanager
def turn(file: Path) -> Iterator[None]:
    """Wait for other processes in this context, at most `_PATIENCE` seconds: one of them may have been stopped."""
    with file.open("wb") as lock:
        end = time.monotonic() + _PATIENCE
        while time.monotonic() < end:
            with contextlib.suppress(BlockingIOError):
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            time.sleep(0.1)
        try:
            yield
        finally:
            fcntl.flock(lock, fcntl.LOCK_UN)  # closing would not do if a child has inherited it


def write_whole(path: Path, data: bytes) -> None:
    """Write data and its digest to a file that only this user may read; a reader never sees a part of it."""
    draft, name = tempfile.mkstemp(dir=path.parent)
    try:
        with os.fdopen(draft, "wb") as file:
            file.write(data + hashlib.blake2b(data, digest_size=_DIGEST).digest())
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def read_whole(path: Path) -> bytes:
    """The data of a file that belongs to this user, and to which no other may write.

    Raises:
        OSError: It is not such a file, or not whole.
    """
    with os.fdopen(os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK), "rb") as file:
        found = os.fstat(file.fileno())
        contents = file.read() if stat.S_ISREG(found.st_mode) else b""
    data, digest = contents[:-_DIGEST], contents[-_DIGEST:]
    is_ours = found.st_uid == os.geteuid() and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    if not is_ours or digest != hashlib.blake2b(data, digest_size=_DIGEST).digest():
        raise OSError(f"{path}: not a whole file of this user")
    return data
