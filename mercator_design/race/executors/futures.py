"""Runs experiments on any executor of Python's `concurrent.futures`: of MPI, Ray, Parsl, loky or a user's own.

Such an executor says little of its workers: not how many they are, and after the death of one, mostly, that all is
lost. So a death is the loss of the executor, after which a race is resumed, and never a failure of an experiment.
"""

import contextlib
import importlib
import inspect
import os
import queue
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Future
from concurrent.futures import Executor as FutureExecutor
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Self, TypeVar

from mercator_design.errors import RaceError, described, excerpt
from mercator_design.race.executors.bundles import Bundle, Bundles
from mercator_design.race.executors.executor import (
    MAX_WAIT,
    ExecutorLost,
    Failed,
    WorkerUnfit,
    available_jobs,
    call_packed,
    checked_jobs,
)
from mercator_design.race.executors.processes import start_worker

T = TypeVar("T")
R = TypeVar("R")

GROUP = "mercator_design.executors"
"""The group of entry points by which a package names its factories."""
_COUNTS = ("num_workers", "_max_workers")
"""Attributes in which executors have the number of their workers: that of mpi4py; those of Python and loky."""
_EXPECTED = "threads, processes, dask, the name of an entry point of " + GROUP + ", or MODULE:FACTORY"


def factory_of(name: str) -> Callable[..., Any]:
    """The factory that an entry point names, or MODULE:FACTORY; a module may be in the current folder.

    Raises:
        RaceError: There is none, or it cannot be imported.
    """
    known = {one.name: one.value for one in entry_points(group=GROUP)}
    where = known.get(name, name)
    module, colon, attributes = where.partition(":")
    if not (module and colon and attributes):
        others = f"; entry points found: {', '.join(sorted(known))}" if known else ""
        raise RaceError(f"executor: expected {_EXPECTED}, found {excerpt(repr(name))}{others}")
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)
    try:
        found: Any = importlib.import_module(module)
        for attribute in attributes.split("."):
            found = getattr(found, attribute)
    except Exception as error:  # noqa: BLE001 - other people's modules fail in many ways
        raise RaceError(f"executor {name}: cannot be imported: {described(error)}") from None
    if not callable(found):
        raise RaceError(f"executor {name}: expected a function or class, found {excerpt(repr(found))}")
    return found  # type: ignore[no-any-return]


class FuturesExecutor:
    """Runs experiments on an executor of `concurrent.futures`, in bundles of up to 0.2 s.

    Args:
        name: The name of an entry point, or MODULE:FACTORY. The factory returns an executor. It is called without
            arguments, or with `max_workers=jobs` if it takes that and jobs are given.
        jobs: Number of experiments that run at once. [default: the number of workers that the executor tells, or else
            the cores that this process may use]

    Raises:
        RaceError: There is no such factory, it fails, or what it returns is no executor; or `jobs` is below 1.
    """

    def __init__(self, name: str, jobs: int | None = None) -> None:
        given = None if jobs is None else checked_jobs(jobs)
        make = factory_of(name)
        self._name = name
        try:
            executor = make(max_workers=given) if given is not None and _takes_workers(make) else make()
        except Exception as error:  # noqa: BLE001 - of other people's code
            raise RaceError(f"executor {name}: cannot be made: {described(error)}") from None
        if not (callable(getattr(executor, "submit", None)) and callable(getattr(executor, "shutdown", None))):
            raise RaceError(f"executor {name}: expected an executor of concurrent.futures, found {type(executor)}")
        self._executor: FutureExecutor = executor
        told = (getattr(executor, one, None) for one in _COUNTS)
        self.jobs: int = given or next((n for n in told if isinstance(n, int) and n > 0), 0) or available_jobs()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Release the workers; after an error or Ctrl-C without waiting for what runs, if they are processes."""
        children = [] if kind is None else list((getattr(self._executor, "_processes", None) or {}).values())
        with contextlib.suppress(Exception):  # of one that is broken, or has no `cancel_futures`
            self._executor.shutdown(wait=kind is None, cancel_futures=True)
        for child in children:  # Python and loky would wait for them at the end of this process
            with contextlib.suppress(Exception):
                os.kill(child.pid, signal.SIGKILL)

    def stop(self) -> None:
        """Do nothing: it is not known whether there are workers."""

    def run(self, function: Callable[[T], R], items: Iterable[T | None]) -> Iterator[tuple[int, R | Failed]]:
        import cloudpickle

        packed = cloudpickle.dumps(function)
        left: Bundles[T] = Bundles(items)
        ended: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
        under_way: dict[Future[Any], Bundle[T]] = {}
        try:
            while True:
                for bundle in left.draw(len(under_way), 2 * self.jobs):
                    future = self._submit(packed, [item for _, item in bundle])
                    under_way[future] = bundle
                    future.add_done_callback(ended.put)
                if not under_way:
                    return
                future = _next(ended)
                bundle = under_way.pop(future)
                results, seconds = self._result(future)
                left.took(seconds, len(bundle))
                yield from zip((index for index, _ in bundle), results, strict=True)
        finally:
            for future in under_way:
                future.cancel()

    def _submit(self, packed: bytes, items: Sequence[Any]) -> "Future[Any]":
        try:
            return self._executor.submit(_call_all, os.getpid(), packed, items)
        except Exception as error:  # noqa: BLE001 - whatever it is, it is not the experiment
            raise self._lost(error) from None

    def _result(self, future: "Future[Any]") -> tuple[list[Any], float]:
        """The results of a bundle and its seconds.

        Raises:
            WorkerUnfit: A worker cannot load or run the function.
            ExecutorLost: The executor has given up.
        """
        if future.cancelled():
            raise self._lost(CancelledError())
        error = future.exception()  # not raised here: it may be a SystemExit
        if error is None:
            found: tuple[list[Any], float] = future.result()
            return found
        if isinstance(error, WorkerUnfit):
            raise error
        if isinstance(error, BrokenExecutor):
            raise self._lost(error)
        raise WorkerUnfit(f"executor {self._name}: a worker cannot run this race: {described(error)}")

    def _lost(self, error: BaseException) -> ExecutorLost:
        reason = described(error).partition("\n")[0]
        return ExecutorLost(f"executor {self._name}: lost ({reason:.200}); running experiments are not recorded")


def _takes_workers(make: Callable[..., object]) -> bool:
    try:
        return "max_workers" in inspect.signature(make).parameters
    except (TypeError, ValueError):  # of compiled code
        return False


def _next(ended: "queue.SimpleQueue[Future[Any]]") -> "Future[Any]":
    while True:
        with contextlib.suppress(queue.Empty):
            return ended.get(timeout=MAX_WAIT)


_prepared: set[int] = set()
"""This process, when it is prepared to be a worker; after a fork the parent, too."""


def _call_all(main: int, packed: bytes, items: Sequence[Any]) -> tuple[list[Any], float]:
    """In a worker: run all items; return their results and the time [s]."""
    if os.getpid() not in _prepared:
        _prepared.add(os.getpid())
        if os.getppid() == main:
            with contextlib.suppress(ValueError):  # not in the main thread
                start_worker(main)
    start = time.perf_counter()
    return [call_packed(packed, item) for item in items], time.perf_counter() - start
