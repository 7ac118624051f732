"""Executors run experiments: a function on items. Results come as soon as they are available.

There are three executors with one interface, `Executor`: threads of this process (thread_executor.py), worker
processes, and the workers of a Dask cluster (dask_executor.py). The result of an experiment does not depend on where it
runs. If an experiment fails, its result is a `Failed`; the executor does not raise, and the caller decides.
"""

import collections
import itertools
import os
import pickle
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Generic, Protocol, Self, TypeVar

from mercator_design.errors import RaceError, described

if TYPE_CHECKING:
    from joblib.externals.loky import ProcessPoolExecutor

T = TypeVar("T")
R = TypeVar("R")

MAX_DEATHS = 3
"""Worker deaths after which an experiment fails."""
MAX_TIMEOUTS = 2
"""Timeouts after which an experiment fails: the first may be an accident."""
START = 60.0
"""Additional seconds for the first experiment of a new worker, which loads modules and kernels."""
_CHECK_EVERY = 1.0
"""Seconds between two checks of a worker that its main process is alive."""
MAX_WAIT = 0.5
"""Maximum seconds of one wait: a signal just before a wait is handled only at its end."""
_MAX_MESSAGE = 2000
"""Maximum length of the reason of a failure, which may have a command in it."""


@dataclass(frozen=True, slots=True)
class Failed:
    """The result of an experiment that failed."""

    reason: str
    error: Exception | None = None  # the exception, if there was one and it can be pickled


class Rejected(RaceError):  # noqa: N818 - as `Failed`, it says what happened
    """Raised by an experiment to reject its configuration: a failure that does not stop a race."""


class WorkerUnfit(RaceError):  # noqa: N818 - as `Failed`, it says what happened
    """A worker cannot run its function. It is not a failure of the experiment, so it always stops the race."""


class ExecutorStopped(Exception):  # noqa: N818 - nothing is wrong
    """Experiments were stopped on request; the finished ones of a race are recorded."""


class Executor(Protocol):
    """Runs a function on items; a context manager, which releases its workers at the end."""

    @property
    def jobs(self) -> int:
        """Number of items that run at the same time."""

    def __enter__(self) -> Self: ...

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None: ...

    def stop(self) -> None:
        """Begin no further item: `run` ends when the running ones have finished. A signal handler may call it."""

    def run(self, function: Callable[[T], R], items: Iterable[T | None]) -> Iterator[tuple[int, R | Failed]]:
        """Yield the position of each item and the function's result, in the order in which they finish.

        Items are taken as workers become free; an executor may hold up to two for each worker, or two groups of short
        ones. None stands for an item that is not known yet: `items` is asked again when another item has finished, and
        `run` ends if none is running. If `items` has a length hint, so many can be taken without waiting.
        The position counts all that `items` has yielded, None included. A caller may stop iterating early; the next
        call of `run` yields nothing of this one.

        Raises:
            WorkerUnfit: A worker has no such function, or another version of it.
        """


class Items(Generic[T]):
    """Items for `Executor.run`, each made when it is taken.

    Args:
        make: Returns the item at a position, as `run` takes it; raises StopIteration if there are no more.
        n_known: Returns how many can be taken now without waiting: the length hint.
    """

    def __init__(self, make: Callable[[int], T | None], n_known: Callable[[], int]) -> None:
        self._make, self._n_known = make, n_known
        self._positions = itertools.count()

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> T | None:
        return self._make(next(self._positions))

    def __length_hint__(self) -> int:
        return self._n_known()


def available_jobs() -> int:
    """Number of cores that this process may use."""
    from joblib import cpu_count

    return int(cpu_count())


def attempt(function: Callable[[T], R], item: T, errors: type[BaseException] = BaseException) -> R | Failed:
    """Call a function on an item; any exception, also SystemExit, is a failure of this item.

    In the main thread signals raise exceptions that concern the program: there `errors` is Exception.
    """
    try:
        return function(item)
    except errors as error:
        return Failed(described(error, _MAX_MESSAGE), error if isinstance(error, Exception) else None)


def in_order(
    executor: Executor,
    function: Callable[[T], R],
    items: Iterable[T],
    watch: Callable[[int], None] = lambda done: None,  # noqa: ARG005 - a name for the reader
    stopped: Callable[[], bool] = lambda: False,
) -> list[R]:
    """The function's results for all items, in the order of the items.

    Args:
        executor: Runs the function.
        function: The function to run.
        items: The items to run it on.
        watch: Called with the number of finished items.
        stopped: Returns whether to stop; called before each item.

    Raises:
        RaceError: An item failed without an exception; else its exception is raised. Running items have finished.
        ExecutorStopped: see `stopped`. Running items have finished.
    """
    found: dict[int, R] = {}
    failed: list[Failed] = []

    for place, result in executor.run(function, itertools.takewhile(lambda _: not (failed or stopped()), items)):
        if isinstance(result, Failed):
            failed.append(result)
        else:
            found[place] = result
            watch(len(found))
    if stopped():
        raise ExecutorStopped
    if failed:
        raise failed[0].error or RaceError(f"an experiment failed: {failed[0].reason}")
    return [found[place] for place in range(len(found))]


@dataclass(slots=True, eq=False)
class _Job(Generic[T]):
    """An item, and how often its worker died or was too slow."""

    index: int
    item: T
    deaths: int = 0
    timeouts: int = 0
    deadline: float = float("inf")


class ProcessExecutor:
    """Worker processes (joblib's loky). Each runs one experiment at a time, so the cause of its death is known.

    If a worker dies, its experiment runs again, and fails after `MAX_DEATHS`. If an experiment takes longer than
    `timeout` seconds, its worker is killed; the experiment runs again, and fails after `MAX_TIMEOUTS`. Other
    experiments are not affected.
    """

    def __init__(self, jobs: int, *, timeout: float | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self.jobs = jobs
        self._timeout, self._clock = timeout, clock
        self._workers: list[ProcessPoolExecutor] = []  # of one process each
        self._new: set[int] = set()  # indices of workers that have not finished an experiment yet

    def __enter__(self) -> Self:
        self._workers = [_worker() for _ in range(self.jobs)]
        self._new = set(range(self.jobs))
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        for worker in self._workers:
            worker.shutdown(wait=True, kill_workers=kind is not None)

    def stop(self) -> None:
        """Do nothing: all items that have begun are running."""

    def run(self, function: Callable[[T], R], items: Iterable[T | None]) -> Iterator[tuple[int, R | Failed]]:
        import cloudpickle

        packed = cloudpickle.dumps(function)
        todo = (None if item is None else _Job(index, item) for index, item in enumerate(items))
        retries: collections.deque[_Job[T]] = collections.deque()
        idle = list(range(self.jobs))
        running: dict[Future[R | Failed], tuple[int, _Job[T]]] = {}
        while True:
            while idle and (job := retries.popleft() if retries else next(todo, None)) is not None:
                place = idle.pop()
                future = self._submit(place, packed, job.item)
                if self._timeout is not None:
                    job.deadline = self._clock() + self._timeout + START * (place in self._new)
                running[future] = place, job
            if not running:
                return
            soonest = min(job.deadline for _, job in running.values())
            done = self._done(running, soonest)
            now = self._clock()
            late = [future for future, (_, job) in running.items() if job.deadline <= now and future not in done]
            for future in [*done, *late]:
                place, job = running.pop(future)
                result = self._timed_out(job) if future in late else _outcome(future, job)
                if future in late or isinstance(future.exception(), BrokenExecutor):
                    self._replace(place)
                else:
                    self._new.discard(place)
                idle.append(place)
                if result is None:
                    retries.append(job)
                else:
                    yield job.index, result

    def _submit(self, place: int, packed: bytes, item: T) -> "Future[Any]":
        future: Future[Any]
        try:
            future = self._workers[place].submit(call_packed, packed, item)
        except BrokenExecutor:  # its process died while it was idle
            self._replace(place)
            future = self._workers[place].submit(call_packed, packed, item)
        return future

    def _replace(self, place: int) -> None:
        """Put a new worker in the place of one that is dead or too slow."""
        self._workers[place].shutdown(wait=True, kill_workers=True)
        self._workers[place] = _worker()
        self._new.add(place)

    def _done(self, running: Iterable["Future[R]"], deadline: float) -> set["Future[R]"]:
        """The futures that have ended; waits for one, but not longer than the deadline."""
        while True:
            left = max(deadline - self._clock(), 0.0)
            done, _ = wait(running, timeout=min(left, MAX_WAIT), return_when=FIRST_COMPLETED)
            if done or left <= MAX_WAIT:
                return done

    def _timed_out(self, job: _Job[T]) -> Failed | None:
        job.timeouts += 1
        if job.timeouts < MAX_TIMEOUTS:
            return None
        return Failed(f"took longer than {self._timeout:g} s, {job.timeouts} times")


def _outcome(future: "Future[R | Failed]", job: _Job[Any]) -> R | Failed | None:
    """The result of a job; None if it is to run again.

    Raises:
        WorkerUnfit: The worker cannot load the function.
    """
    error = future.exception()  # not raised here: it may be a SystemExit
    if error is None:
        return future.result()
    if isinstance(error, BrokenExecutor):
        job.deaths += 1
        if job.deaths < MAX_DEATHS:
            return None
        reason = str(error).partition("\n")[0]
        return Failed(f"its worker process died, {job.deaths} times: {reason:.200}")
    if isinstance(error, WorkerUnfit):
        raise error
    # For example a result that cannot be pickled.
    return Failed(described(error, 500), error if isinstance(error, Exception) else None)


def _worker() -> "ProcessPoolExecutor":
    from joblib.externals.loky import ProcessPoolExecutor

    return ProcessPoolExecutor(max_workers=1, initializer=_start_worker, initargs=(os.getpid(),))


def _start_worker(main: int) -> None:
    """Ignore signals, which Ctrl-C and schedulers send to all processes; end when the main process has ended."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, args=(main,), daemon=True).start()


def _end_with_parent(main: int) -> None:
    """End this process when its parent has changed: then the main process has been killed."""
    while os.getppid() == main:
        time.sleep(_CHECK_EVERY)
    os._exit(1)


@lru_cache(maxsize=4)
def _unpacked(packed: bytes) -> Callable[[Any], Any]:
    """Unpickle a function once for all its items in this process."""
    function: Callable[[Any], Any] = pickle.loads(packed)  # noqa: S301 - of our own main process
    return function


def call_packed(packed: bytes, item: Any) -> Any:  # noqa: ANN401 - the function's types
    """In a worker: call a function, and make sure that its result can be pickled.

    Raises:
        WorkerUnfit: The function cannot be loaded here.
    """
    try:
        function = _unpacked(packed)
    except BaseException as error:  # noqa: BLE001 - for example a missing package; also sys.exit()
        where = f"process {os.getpid()} on {socket.gethostname()}"
        raise WorkerUnfit(f"a worker ({where}) cannot run this race: {described(error)}") from None
    result = attempt(function, item)
    if isinstance(result, Failed):
        try:
            pickle.loads(pickle.dumps(result))  # noqa: S301 - our own
        except BaseException:  # noqa: BLE001 - exceptions of other people's classes fail in many ways here
            result = Failed(result.reason)
    return result
