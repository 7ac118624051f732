"""Helper processes for short work: each computes one function at a time, within a time limit."""

import contextlib
import multiprocessing
import os
import queue
import signal
import threading
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import ParamSpec, TypeVar, cast

from mercator_design.errors import MercatorError, described
from mercator_design.serve.settings import ServiceError

P = ParamSpec("P")
R = TypeVar("R")

_PATIENCE = 20.0
"""Seconds that work waits for a helper."""
_NICE = 5
"""Helpers leave the processor to the service, and take it from races."""
_START = 60.0
"""Additional seconds for the first work of a helper, which loads modules and kernels."""


class Busy(ServiceError):  # noqa: N818 - nothing is wrong
    """All helpers are at work; try again later."""


class TimeLimit(ServiceError):  # noqa: N818 - as Busy
    """The work took longer than allowed."""


class Desk:
    """Helper processes; safe for several threads.

    Args:
        helpers: Number of processes.
        seconds: Time limit of a piece of work.
        plugins: Python files with objectives and dynamics, which the helpers load.
        folder: An empty folder, in which the helpers work.
    """

    def __init__(self, helpers: int, seconds: float, plugins: Sequence[str], folder: Path) -> None:
        self._seconds, self._plugins, self._folder = seconds, tuple(plugins), folder
        self._idle: queue.LifoQueue[_Helper] = queue.LifoQueue()
        self._all: set[_Helper] = set()
        self._lock = threading.Lock()
        self._is_closed = False
        for _ in range(helpers):
            self._add()

    def run(self, function: Callable[P, R], /, *arguments: P.args, **given: P.kwargs) -> R:
        """The result of a function of a module, computed by a helper.

        Raises:
            MercatorError: What the function raises.
            Busy: All helpers are at work.
            TimeLimit: The function took too long; its helper was killed.
            ServiceError: The helper died.
        """
        try:
            helper = self._idle.get(timeout=_PATIENCE)
        except queue.Empty:
            raise Busy("the service is busy with other work: try again in a moment") from None
        is_well = False
        try:
            result, error = helper.work(function, arguments, given, self._seconds)
            is_well = True
        finally:
            if is_well:
                self._idle.put(helper)
            else:
                helper.kill()
                with self._lock:
                    self._all.discard(helper)
                self._add()
        if error is not None:
            raise error
        return cast("R", result)

    def close(self) -> None:
        """End the helpers."""
        self._is_closed = True
        with self._lock:
            for helper in self._all:
                helper.kill()

    def _add(self) -> None:
        with self._lock:
            if not self._is_closed:
                helper = _Helper(self._plugins, self._folder)
                self._all.add(helper)
                self._idle.put(helper)


class _Helper:
    """One process; it is started by its first work."""

    def __init__(self, plugins: tuple[str, ...], folder: Path) -> None:
        self._plugins, self._folder = plugins, folder
        self._process: multiprocessing.process.BaseProcess | None = None
        self._connection: Connection | None = None

    def work(
        self, function: Callable[..., object], arguments: object, given: object, seconds: float
    ) -> tuple[object, Exception | None]:
        """The result of a function, or the exception that it has raised."""
        if self._process is None or self._connection is None:
            context = multiprocessing.get_context("spawn")
            self._connection, theirs = context.Pipe()
            arguments_of_process = (theirs, self._plugins, str(self._folder))
            self._process = context.Process(target=_serve, args=arguments_of_process, name="helper", daemon=True)
            self._process.start()
            theirs.close()
            seconds += _START
        try:
            self._connection.send((function, arguments, given))
            if not self._connection.poll(seconds):
                raise TimeLimit(f"this took longer than the {seconds:g} s that the service allows")
            result, error = self._connection.recv()
        except (EOFError, OSError) as lost:
            raise ServiceError(f"the process that worked on this has died: {described(lost)}") from None
        return result, error

    def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.join()
        if self._connection is not None:
            self._connection.close()


def _serve(connection: Connection, plugins: Sequence[str], folder: str) -> None:
    """Work until the service has gone."""
    from mercator_design.missions.plugin_files import read_plugin
    from mercator_design.missions.plugins import run_plugin

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_service, daemon=True).start()
    os.nice(_NICE)
    os.chdir(folder)
    for file in plugins:
        run_plugin(read_plugin(Path(file)), file)
    with contextlib.suppress(EOFError, OSError):
        while True:
            function, arguments, given = connection.recv()
            answer: tuple[object, Exception | None]
            try:
                answer = (function(*arguments, **given), None)
            except MercatorError as error:
                answer = (None, error)
            except Exception as error:  # noqa: BLE001 - a fault of this program: the service reports and goes on
                answer = (None, ServiceError(f"internal error: {described(error)}"))
            connection.send(answer)


def _end_with_service() -> None:
    """End this process with the service, which alone knows of time limits, also if it was killed."""
    service = multiprocessing.parent_process()
    assert service is not None  # noqa: S101 - this is a helper
    service.join()
    os._exit(os.EX_TEMPFAIL)
