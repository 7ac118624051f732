"""Runs experiments in worker processes of this machine."""

import collections
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar

from mercator_design.errors import described
from mercator_design.race.executors.executor import (
    DIES,
    MAX_WAIT,
    Failed,
    WorkerUnfit,
    call_packed,
    check_worker,
    checked_jobs,
)

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

    If a worker dies, its experiment runs again, and fails after `MAX_DEATHS`, unless the next worker dies before it
    runs anything: then the experiment is not the cause. If an experiment takes longer than
    `timeout` seconds, its worker is killed; the experiment runs again, and fails after `MAX_TIMEOUTS`. Other
    experiments are not affected.

    Args:
        jobs: Number of processes. [default: the cores that it may use]
        timeout: Maximum seconds of an experiment. [default: no limit]
        clock: Returns the time [s].

    Raises:
        RaceError: `jobs` is below 1.
    """

    def __init__(
        self,
        jobs: int | None = None,
        *,
        timeout: float | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.jobs = checked_jobs(jobs)
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
        """Do nothing: `run` never waits for workers."""

    def run(self, function: Callable[[T], R], items: Iterable[T | None]) -> Iterator[tuple[int, R | Failed]]:
        import cloudpickle

        packed = cloudpickle.dumps(function)
        todo = (None if item is None else _Job(index, item) for index, item in enumerate(items))
        retries: collections.deque[_Job[T]] = collections.deque()
        idle = list(range(self.jobs))
        running: dict[Future[R | Failed], tuple[int, _Job[T]]] = {}
        while True:
            while idle and (job := retries.popleft() if retries else next(todo, None)) is not None:
                place, begin = idle.pop(), self._clock()  # before the hand-out: the worker may begin during it
                future = self._submit(place, call_packed, packed, job.item)
                if self._timeout is not None:
                    job.deadline = begin + self._timeout + START * (place in self._new)
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
                if job.deaths == MAX_DEATHS:
                    self._check(place, packed)
                if result is None:
                    retries.append(job)
                else:
                    yield job.index, result

    def _submit(self, place: int, function: Callable[..., object], *arguments: object) -> "Future[Any]":
        future: Future[Any]
        try:
            future = self._workers[place].submit(function, *arguments)
        except BrokenExecutor:  # its process died while it was idle
            self._replace(place)
            future = self._workers[place].submit(function, *arguments)
        return future

    def _check(self, place: int, packed: bytes) -> None:
        """Check that a new worker survives loading the function.

        Raises:
            WorkerUnfit: It does not, or it cannot load it.
        """
        (future,) = self._done([self._submit(place, check_worker, packed)], float("inf"))
        if isinstance(error := future.exception(), BrokenExecutor):
            raise WorkerUnfit(f"{DIES}: {str(error).partition(chr(10))[0]:.200}")
        if error is not None:
            raise error

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

    return ProcessPoolExecutor(max_workers=1, initializer=start_worker, initargs=(os.getpid(),))


def start_worker(main: int) -> None:
    """Ignore signals, which Ctrl-C and schedulers send to all processes; end when the main process has ended."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, args=(main,), daemon=True).start()


def _end_with_parent(main: int) -> None:
    """End this process when its parent has changed: then the main process has been killed."""
    while os.getppid() == main:
        time.sleep(_CHECK_EVERY)
    os._exit(1)
