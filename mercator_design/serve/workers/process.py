"""A worker process: computes one function after the other, within limits of time and memory."""

import contextlib
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import Connection
from pathlib import Path

from mercator_design.errors import MercatorError, described
from mercator_design.serve.settings import Extensions, ServiceError
from mercator_design.system.shortage import die_first

_NICE = 5
"""Niceness of workers: between the service and races."""
_PERIOD = 0.25
"""Seconds between two checks of the memory of a process at work."""
_MB = 1_000_000
_START = 60.0
"""Additional time for the first function, for which the process loads modules and kernels [s]."""


class TooMuchWork(ServiceError):  # noqa: N818 - nothing is wrong with the service
    """The work took longer, or more memory, than allowed."""


class WorkerProcess:
    """A worker process; started by its first function."""

    def __init__(self, extensions: Extensions, folder: Path) -> None:
        self._extensions, self._folder = extensions, folder
        self._process: multiprocessing.process.BaseProcess | None = None
        self._connection: Connection | None = None
        self._starting = threading.Lock()
        self._has_ended = False

    def work(
        self, function: Callable[..., object], arguments: object, given: object, seconds: float, megabytes: int
    ) -> tuple[object, Exception | None]:
        """The result of a function, or the exception that it has raised.

        Raises:
            TooMuchWork: It took too long, or too much memory.
            ServiceError: The process has died, or cannot be started.
        """
        end = time.monotonic() + seconds
        process, connection = self._process, self._connection
        if process is None or connection is None or not process.is_alive():
            process, connection = self._start()
            end += _START
        try:
            connection.send((function, arguments, given))
            while not connection.poll(max(0.0, min(_PERIOD, end - time.monotonic()))):
                if time.monotonic() >= end:
                    raise TooMuchWork(f"this took longer than the {seconds:g} s that the service allows")
                if _memory_of(process.pid) > megabytes * _MB:
                    raise TooMuchWork(f"this took more than the {megabytes} MB of memory that the service allows")
            result, error = connection.recv()
        except (EOFError, OSError) as lost:
            raise ServiceError(f"the process that worked on this has died: {described(lost)}") from None
        return result, error

    def _start(self) -> tuple[multiprocessing.process.BaseProcess, Connection]:
        self.close()  # one that was killed while it had no work
        context = multiprocessing.get_context("spawn")
        with self._starting:
            if self._has_ended:
                raise ServiceError("the service ends")
            try:
                ours, theirs = context.Pipe()
                self._connection = ours
                with theirs:
                    arguments = (theirs, self._extensions, str(self._folder))
                    process = context.Process(target=_main, args=arguments, name="worker", daemon=True)
                    process.start()
            except OSError as error:  # for example, there are too many processes
                raise ServiceError(f"a process for this cannot be started: {error.strerror or error}") from None
            self._process = process
            return process, ours

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
    """Memory of a process [bytes]; 0 if unknown."""
    try:
        pages = Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1]
    except (OSError, IndexError):
        return 0
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def _main(connection: Connection, extensions: Extensions, folder: str) -> None:
    """Compute functions until the service has ended."""
    from mercator_design.plugins.loading import refuse_more

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_service, daemon=True).start()
    os.nice(_NICE)
    die_first()
    os.chdir(folder)
    problem = None
    try:
        extensions.load()
    except ServiceError as error:
        problem = error
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
    """End this process with the service, also if that was killed."""
    service = multiprocessing.parent_process()
    assert service is not None  # noqa: S101 - this is a worker
    service.join()
    os._exit(os.EX_TEMPFAIL)
