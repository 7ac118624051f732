"""Helper processes for short work: each computes one function at a time, within limits of time and memory.

One user cannot keep all helpers, nor all threads of the service that wait for them, from other users.
"""

import contextlib
import multiprocessing
import os
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from multiprocessing.connection import Connection
from pathlib import Path
from typing import ParamSpec, TypeVar, cast

from mercator_design.errors import MercatorError, described
from mercator_design.serve.settings import ServiceError
from mercator_design.system.shortage import die_first

P = ParamSpec("P")
R = TypeVar("R")

ASKED_BY: ContextVar[str] = ContextVar("asked_by", default="")
"""The name of the user who asks for work; whoever answers a request sets it."""
MAX_REQUESTS, MAX_OF_USER = 30, 12
"""Pieces of work at a time, with those that wait: of all, and of a user. Each keeps one of the 40 threads that answer
requests, and the others answer what needs no helper."""
PATIENCE = 20.0
"""Seconds that work waits for a helper."""
_NICE = 5
"""Helpers leave the processor to the service, and take it from races."""
_LOOK = 0.25
"""Seconds between two looks at the memory of a helper at work."""
_MB = 1_000_000
_START = 60.0
"""Additional seconds for the first work of a helper, which loads modules and kernels."""


class Busy(ServiceError):  # noqa: N818 - nothing is wrong
    """All helpers that the user may have are at work; try again later."""


class TooMuchWork(ServiceError):  # noqa: N818 - as Busy
    """The work took longer, or more memory, than allowed."""


class Desk:
    """Helper processes; safe for several threads.

    Args:
        helpers: Number of processes.
        seconds: Time limit of a piece of work.
        megabytes: Memory of a helper.
        plugins: Python files with objectives and dynamics, which the helpers load.
        folder: An empty folder, in which the helpers work.
    """

    def __init__(self, helpers: int, seconds: float, megabytes: int, plugins: Sequence[str], folder: Path) -> None:
        self.seconds, self.megabytes = seconds, megabytes
        self._plugins, self._folder = tuple(plugins), folder
        self._max_at_work = max(1, helpers - 1)  # helpers; one is left to others
        self._asked, self._at_work = Counter[str](), Counter[str]()  # pieces of work of users; those that do not wait
        self._changed = threading.Condition()
        self._is_closed = False
        self._all: set[_Helper] = set()
        self._idle: list[_Helper] = []
        for _ in range(helpers):
            self._add()

    def run(self, function: Callable[P, R], /, *arguments: P.args, **given: P.kwargs) -> R:
        """The result of a function of a module, computed by a helper for the user of ASKED_BY.

        Raises:
            MercatorError: What the function raises.
            Busy: All helpers are at work, or as many as a user may have.
            TooMuchWork: The function took too long or too much memory; its helper was killed.
            ServiceError: The helper died, or its process cannot be started.
        """
        return self.run_within(self.seconds, function, *arguments, **given)

    def run_within(self, seconds: float, function: Callable[P, R], /, *arguments: P.args, **given: P.kwargs) -> R:
        """As `run`, with another time limit [s]."""
        with self._helper(ASKED_BY.get()) as helper:
            result, error = helper.work(function, arguments, given, seconds, self.megabytes)
        if error is not None:
            raise error
        return cast("R", result)

    def check_plugins(self) -> None:
        """Let a helper load the plugins.

        Raises:
            ServiceError: One of them cannot be read, or fails when it is run.
        """
        if self._plugins:
            self.run(os.getpid)  # any work starts a helper

    def close(self) -> None:
        with self._changed:
            self._is_closed = True
            for helper in self._all:
                helper.end()  # whose thread, if it is at work, closes it
            for helper in self._idle:
                helper.close()

    @contextlib.contextmanager
    def _helper(self, user: str) -> "Iterator[_Helper]":
        """A helper for a piece of work of a user; if that goes wrong, another one takes its place."""
        with self._changed:
            if self._asked[user] >= MAX_OF_USER or self._asked.total() >= MAX_REQUESTS:
                raise Busy("the service is busy with too much work at a time: try again in a moment")
            self._asked[user] += 1
            if not self._changed.wait_for(lambda: self._idle and self._at_work[user] < self._max_at_work, PATIENCE):
                self._asked -= Counter([user])
                raise Busy("the service is busy with other work: try again in a moment")
            self._at_work[user] += 1
            helper = self._idle.pop()
        is_well = False
        try:
            yield helper
            is_well = True
        finally:
            try:
                if not is_well:
                    helper.close()
            finally:
                with self._changed:
                    self._asked -= Counter([user])
                    self._at_work -= Counter([user])
                    if is_well:
                        self._idle.append(helper)
                    else:
                        self._all.discard(helper)
                        self._add()
                    self._changed.notify_all()

    def _add(self) -> None:
        if not self._is_closed:
            helper = _Helper(self._plugins, self._folder)
            self._all.add(helper)
            self._idle.append(helper)


class _Helper:
    """One process; it is started by its first work."""

    def __init__(self, plugins: tuple[str, ...], folder: Path) -> None:
        self._plugins, self._folder = plugins, folder
        self._process: multiprocessing.process.BaseProcess | None = None
        self._connection: Connection | None = None
        self._starting = threading.Lock()
        self._has_ended = False

    def work(
        self, function: Callable[..., object], arguments: object, given: object, seconds: float, megabytes: int
    ) -> tuple[object, Exception | None]:
        """The result of a function, or the exception that it has raised."""
        allowed = seconds
        if self._process is None or self._connection is None or not self._process.is_alive():
            self._start()
            allowed += _START
        assert self._process is not None  # noqa: S101 - just started
        assert self._connection is not None  # noqa: S101
        end = time.monotonic() + allowed
        try:
            self._connection.send((function, arguments, given))
            while not self._connection.poll(max(0.0, min(_LOOK, end - time.monotonic()))):
                if time.monotonic() >= end:
                    raise TooMuchWork(f"this took longer than the {seconds:g} s that the service allows")
                if _memory_of(self._process.pid) > megabytes * _MB:
                    raise TooMuchWork(f"this took more than the {megabytes} MB of memory that the service allows")
            result, error = self._connection.recv()
        except (EOFError, OSError) as lost:
            raise ServiceError(f"the process that worked on this has died: {described(lost)}") from None
        return result, error

    def _start(self) -> None:
        self.close()  # one that was killed while it had no work
        context = multiprocessing.get_context("spawn")
        with self._starting:
            if self._has_ended:
                raise ServiceError("the service ends")
            try:
                self._connection, theirs = context.Pipe()
                with theirs:
                    arguments = (theirs, self._plugins, str(self._folder))
                    process = context.Process(target=_serve, args=arguments, name="helper", daemon=True)
                    process.start()
            except OSError as error:  # for example, there are too many processes
                raise ServiceError(f"a process for this cannot be started: {error.strerror or error}") from None
            self._process = process

    def end(self) -> None:
        """Kill the process, and start no other one."""
        with self._starting:
            self._has_ended = True
            self.kill()

    def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.join()

    def close(self) -> None:
        self.kill()
        if self._connection is not None:
            self._connection.close()


def _memory_of(process: int | None) -> int:
    """The bytes of memory that a process uses; 0 if the system does not say it."""
    try:
        pages = Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1]
    except (OSError, IndexError):
        return 0
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def _serve(connection: Connection, plugins: Sequence[str], folder: str) -> None:
    """Work until the service has gone."""
    from mercator_design.missions.plugin_files import read_plugin
    from mercator_design.missions.plugins import refuse_more, run_plugin

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_service, daemon=True).start()
    os.nice(_NICE)
    die_first()
    os.chdir(folder)
    problem = None
    try:
        for file in plugins:
            run_plugin(read_plugin(Path(file)), file)
    except MercatorError as error:
        problem = ServiceError(*(f"plugins: {message}" for message in error.messages))
    refuse_more("expected a plugin that serve.yaml names, found another one; it was not run")
    with contextlib.suppress(EOFError, OSError):
        while True:
            function, arguments, given = connection.recv()
            connection.send((None, problem) if problem is not None else _answer(function, arguments, given))


def _answer(
    function: Callable[..., object], arguments: Sequence[object], given: Mapping[str, object]
) -> tuple[object, Exception | None]:
    """The result of a function, or the exception that it raises."""
    try:
        return function(*arguments, **given), None
    except MercatorError as error:
        return None, error
    except Exception as error:  # noqa: BLE001 - a fault of this program: the service reports and goes on
        return None, ServiceError(f"internal error: {described(error)}")


def _end_with_service() -> None:
    """End this process with the service, which alone knows of time limits, also if it was killed."""
    service = multiprocessing.parent_process()
    assert service is not None  # noqa: S101 - this is a helper
    service.join()
    os._exit(os.EX_TEMPFAIL)
