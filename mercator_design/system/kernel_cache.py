"""The cache of machine code on disk, which only runs complete files that this user has written.

A file of machine code is unpickled and executed: a flipped bit may end the interpreter, and whoever can write a file
can run any code. So the folder must belong to this user, on a path that no other user can change; each file must belong
to this user; and its contents end in a digest, which is checked first. A file that fails a check is compiled again.

Of the processes that want the same function, one compiles it; the others wait, and find it in the cache.
"""

import atexit
import contextlib
import fcntl
import functools
import hashlib
import os
import shutil
import stat
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
"""Seconds to wait for a process that compiles; it may have been stopped."""


class Place(NamedTuple):
    """The folder of the cache."""

    folder: Path | None  # None: there is none
    problem: str  # why what is compiled is lost when this process ends, and what to do; empty if it is kept


@functools.cache
def place(name: str) -> Place:
    """The folder of a name in the user's cache; if that is not possible, a temporary folder of this process.

    The cache is NUMBA_CACHE_DIR if that is set, else the user's cache folder. If it can only be read, what is in it is
    copied to the temporary folder. Processes that this one starts use the temporary folder, too.
    """
    given = os.environ.get("NUMBA_CACHE_DIR")
    usual = Path(given) if given else user_folder("cache")
    problem, readable = "this user has no home folder", None
    if usual is not None:
        problem = f"{usual / name}: no file can be written there"
        with contextlib.suppress(OSError, RuntimeError):  # a link to itself raises either
            folder = usual.resolve() / name
            for missing in reversed([each for each in (folder, *folder.parents) if not each.exists()]):
                missing.mkdir(mode=0o700, exist_ok=True)
            if reason := why_not_private(folder):
                problem = f"{usual / name}: {reason}"
            else:
                readable = folder
                with tempfile.TemporaryFile(dir=folder):
                    return Place(folder, "")
    problem += "; set NUMBA_CACHE_DIR to a folder of your own"
    try:
        cache = Path(tempfile.mkdtemp(prefix="mercator_design-"))  # only this user may enter it
    except OSError:
        return Place(readable, problem)
    atexit.register(shutil.rmtree, cache, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = str(cache)
    if readable is not None:
        with contextlib.suppress(OSError):  # what cannot be copied is compiled
            shutil.copytree(readable, cache / name)
    (cache / name).mkdir(exist_ok=True)
    for copy, _, _ in os.walk(cache):  # which may have been a folder that nobody may change
        Path(copy).chmod(0o700)
    return Place(cache / name, problem)


def why_not_private(folder: Path) -> str:
    """Why another user could change the contents of a folder; empty if none could. The path has no links.

    The folder must belong to this user. Its parents may also belong to root; if others may write to a parent, as in
    /tmp, its sticky bit must be set.
    """
    us = os.geteuid()
    for place in (folder, *folder.parents):
        found = place.lstat()
        if found.st_uid != us and (found.st_uid != 0 or place == folder):
            return f"{place} belongs to user {found.st_uid}, not to {us}"
        kept = bool(found.st_mode & stat.S_ISVTX) and place != folder
        if _others_may_write(found) and not kept:
            return f"other users may write to {place}"
    return ""


def _others_may_write(found: os.stat_result) -> bool:
    if found.st_mode & stat.S_IWOTH:
        return True
    return bool(found.st_mode & stat.S_IWGRP) and not _is_trusted(found.st_gid)


def _is_trusted(group: int) -> bool:
    """Whether a group is root's, or has only this user as a member, as many systems create one for each user."""
    import grp
    import pwd

    if group == 0:
        return True
    try:
        name, found = pwd.getpwuid(os.geteuid()).pw_name, grp.getgrgid(group)
    except KeyError:  # no such user or group, as in some containers
        return False
    return found.gr_name == name and set(found.gr_mem) <= {name}


def keep_whole(
    cache: Any,  # noqa: ANN401 - numba has no types
    part: str,
    missed: Callable[[], None],
    before_compiling: Callable[[], None],
) -> "Forgiving":
    """Make numba's cache of one function load only complete files, and raise only for a lack of memory.

    Installations with the same sources share compiled code: numba would look in a folder named by the path of the
    source file, and of some versions only if the file is as old.

    Args:
        cache: The cache.
        part: A digest of the kernels of other packages in it, such as plugins; empty if there are none.
        missed: Called if the cache does not have what is wanted.
        before_compiling: Called if no other process has compiled it either.
    """
    files = getattr(cache, "_cache_file", None)  # numba offers no other way in
    if files is None:  # nothing is cached
        return Forgiving(cache, missed, before_compiling)
    implementation, function = cache._impl, cache._py_func  # noqa: SLF001
    from importlib.metadata import version  # slow to import, and a robot compiles nothing

    name = "-".join([function.__module__ or "", *([part] if part else []), "numba", version("numba")])
    folder = str(Path(cache.cache_path).parent / name)
    implementation.locator.get_cache_path = lambda: folder
    file = Path(function.__code__.co_filename)
    source = file.read_bytes() if file.is_file() else b""  # of a notebook there is no file
    files.__init__(folder, implementation.filename_base, hashlib.blake2b(source).digest())
    kind: Any = type(files)

    class Whole(kind):  # type: ignore[misc]  # as said above
        """The files of the cache, each with a digest after the data of numba."""

        def _load_index(self) -> Any:  # noqa: ANN401
            return super()._load_index() if is_whole(Path(self._index_path)) else {}

        def _load_data(self, name: str) -> Any:  # noqa: ANN401
            path = self._data_path(name)
            if not is_whole(Path(path)):
                raise FileNotFoundError(path)  # numba then compiles
            return super()._load_data(name)

        @contextlib.contextmanager
        def _open_for_write(self, path: str) -> Iterator["_Digesting"]:
            with super()._open_for_write(path) as file:
                os.fchmod(file.fileno(), 0o600)
                digesting = _Digesting(file)
                yield digesting
                file.write(digesting.digest.digest())

    files.__class__ = Whole
    return Forgiving(cache, missed, before_compiling, Turn(Path(f"{files._index_path}.lock")))  # noqa: SLF001


class _Digesting:
    """A file, and the digest of the data written to it."""

    def __init__(self, file: Any) -> None:  # noqa: ANN401
        self._file = file
        self.digest = hashlib.blake2b(digest_size=_DIGEST)

    def write(self, data: bytes) -> int:
        self.digest.update(data)
        return int(self._file.write(data))


def is_whole(path: Path) -> bool:
    """Whether a file belongs to this user, and ends in the digest of its contents."""
    try:
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file:
            found = os.fstat(file.fileno())
            if not stat.S_ISREG(found.st_mode) or found.st_uid != os.geteuid() or found.st_mode & 0o022:
                return False
            data = file.read()
    except OSError:
        return False
    return hashlib.blake2b(data[:-_DIGEST], digest_size=_DIGEST).digest() == data[-_DIGEST:]


class Turn:
    """One process at a time has its turn; it ends with the process. Without a file for it, all have it at once."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._descriptors: list[int] = []  # none, or the one of a turn that has begun
        self._process = 0  # that began it

    def begin(self, patience: float = _PATIENCE) -> None:
        """Begin the turn when no other process has its turn, or after so many seconds."""
        self.end()
        end = time.monotonic() + patience
        with contextlib.suppress(OSError, IndexError):  # also if another thread ends it meanwhile
            self._process = os.getpid()
            self._file.parent.mkdir(mode=0o700, exist_ok=True)
            self._descriptors.append(os.open(self._file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600))
            while not self._is_mine() and time.monotonic() < end:
                time.sleep(0.1)

    def _is_mine(self) -> bool:
        try:
            fcntl.flock(self._descriptors[0], fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def end(self) -> None:
        """End the turn, if it has begun."""
        with contextlib.suppress(IndexError):  # also if another thread has ended it just now
            descriptor = self._descriptors.pop()
            if self._process == os.getpid():  # a child that has inherited it would end the turn of its parent
                with contextlib.suppress(OSError):
                    fcntl.flock(descriptor, fcntl.LOCK_UN)  # closing would not do if a child has inherited it
            os.close(descriptor)


class Forgiving:
    """A cache that recompiles if a file cannot be read, and is not used if the disk is full.

    Raises MemoryError if LLVM would end this process for lack of memory.
    """

    def __init__(
        self,
        cache: Any,  # noqa: ANN401
        missed: Callable[[], None],
        before_compiling: Callable[[], None],
        turn: Turn | None = None,
    ) -> None:
        self._cache = cache
        self._missed = missed
        self._before_compiling = before_compiling
        self._turn = turn

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401
        return getattr(self._cache, name)

    def load_overload(self, signature: Any, context: Any) -> Any:  # noqa: ANN401
        """The machine code in the cache; without it None, and others wait until it is saved or given up."""
        address_space.require(address_space.TO_LOAD, "to load machine code")
        found = self._found(signature, context)
        if found is not None:
            return found
        address_space.require(address_space.TO_COMPILE, "to compile")
        self._missed()
        try:
            if self._turn:
                self._turn.begin()
                found = self._found(signature, context)  # another process may just have compiled it
            if found is None:
                self._before_compiling()
        except BaseException:
            self.give_up()
            raise
        if found is not None:
            self.give_up()
        return found

    def _found(self, signature: Any, context: Any) -> Any:  # noqa: ANN401
        with contextlib.suppress(Exception):  # for example a file of another version of numba
            return self._cache.load_overload(signature, context)
        return None

    def save_overload(self, signature: Any, data: Any) -> None:  # noqa: ANN401
        """Save machine code for all that wait for it."""
        try:
            for _ in range(2):
                try:
                    self._cache.save_overload(signature, data)
                except Exception:  # noqa: BLE001 - as above, for the old index; or the disk is full
                    with contextlib.suppress(OSError):
                        self._cache.flush()  # delete the old index, and try again
                else:
                    return
        finally:
            self.give_up()

    def give_up(self) -> None:
        """Let others compile, if this failed."""
        if self._turn:
            self._turn.end()
