"""The worker processes, shared fairly by users: the work of a user waits behind the user's own."""

import contextlib
import os
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import ParamSpec, TypeVar, cast

from mercator_design.serve.settings import MAX_WORKERS, ServiceError
from mercator_design.serve.turns import next_user
from mercator_design.serve.workers.process import WorkerProcess

P = ParamSpec("P")
R = TypeVar("R")

CURRENT_USER: ContextVar[str] = ContextVar("current_user", default="")
"""The name of the user whose request is answered."""
MAX_WAITING = 300
"""Pieces of work of all users that wait for a worker."""
MAX_WORK = MAX_WAITING + MAX_WORKERS
"""Pieces of work at a time, with those that wait; each keeps a thread of the service."""
MAX_WAIT = 120.0
"""Seconds that work waits for a worker."""


class Busy(ServiceError):  # noqa: N818 - nothing is wrong
    """Too much work waits for a worker; try again later."""


@dataclass(eq=False, slots=True)
class _Waiting:
    """A piece of work that waits for a worker."""

    user: str
    worker: Future[WorkerProcess] = field(default_factory=Future)


class WorkerPool:
    """Worker processes; safe for several threads.

    A worker that is free goes to the user whose turn it is (`next_user`). One user never has all workers, so that work
    that takes long keeps no other user waiting. Of too much waiting work, the latest of the user with the most of it is
    refused.

    Args:
        workers: Number of processes.
        seconds: Time limit of a piece of work.
        megabytes: Memory of a worker.
        plugins: Python files with objectives and dynamics, which the workers load.
        folder: An empty folder, in which the workers work.
    """

    def __init__(self, workers: int, seconds: float, megabytes: int, plugins: Sequence[str], folder: Path) -> None:
        self.seconds, self.megabytes = seconds, megabytes
        self._plugins, self._folder = tuple(plugins), folder
        self._max_at_work = max(1, workers - 1)  # of a user
        self._lock = threading.Lock()
        self._waiting: list[_Waiting] = []  # in the order of their arrival
        self._at_work, self._served = Counter[str](), dict[str, int]()  # by user
        self._is_closed = False
        self._all: set[WorkerProcess] = set()
        self._idle: list[WorkerProcess] = []
        for _ in range(workers):
            self._add()

    def run(self, function: Callable[P, R], /, *arguments: P.args, **given: P.kwargs) -> R:
        """The result of a function of a module, computed by a worker for CURRENT_USER.

        Raises:
            MercatorError: What the function raises.
            Busy: No worker was free in time, or too much work waits.
            TooMuchWork: The function took too long or too much memory; its worker was killed.
            ServiceError: The worker died, or its process cannot be started.
        """
        return self.run_within(self.seconds, function, *arguments, **given)

    def run_within(self, seconds: float, function: Callable[P, R], /, *arguments: P.args, **given: P.kwargs) -> R:
        """As `run`, with another time limit [s]."""
        with self._worker(CURRENT_USER.get()) as worker:
            result, error = worker.work(function, arguments, given, seconds, self.megabytes)
        if error is not None:
            raise error
        return cast("R", result)

    def check_plugins(self) -> None:
        """Let a worker load the plugins.

        Raises:
            ServiceError: One of them cannot be read, or fails when it is run.
        """
        if self._plugins:
            self.run(os.getpid)  # any work starts a worker

    def close(self) -> None:
        with self._lock:
            self._is_closed = True
            for one in [*self._waiting]:
                self._refuse(one)
            for worker in self._all:
                worker.end()  # its thread, if it is at work, closes it
            for worker in self._idle:
                worker.close()

    @contextlib.contextmanager
    def _worker(self, user: str) -> Iterator[WorkerProcess]:
        """A worker for a piece of work of a user; if that goes wrong, another one takes its place."""
        worker, is_well = self._free_worker(user), False
        try:
            yield worker
            is_well = True
        finally:
            try:
                if not is_well:
                    worker.close()
            finally:
                with self._lock:
                    self._at_work -= Counter([user])
                    if is_well:
                        self._idle.append(worker)
                    else:
                        self._all.discard(worker)
                        self._add()
                    self._assign()

    def _free_worker(self, user: str) -> WorkerProcess:
        """Wait until it is the turn of a piece of work of a user.

        Raises:
            Busy: Too much work waits, or this has waited too long.
        """
        one = _Waiting(user)
        with self._lock:
            self._waiting.append(one)
            self._assign()
            if len(self._waiting) > MAX_WAITING:
                self._refuse(self._work_to_refuse())
        with contextlib.suppress(TimeoutError):
            return one.worker.result(MAX_WAIT)
        with self._lock:
            if one in self._waiting:
                self._refuse(one)
        return one.worker.result()

    def _assign(self) -> None:
        """Give idle workers to those whose turn it is."""
        while self._idle:
            users = (one.user for one in self._waiting)
            user = next_user(users, self._at_work, self._served, self._max_at_work)
            if user is None:
                return
            first = next(one for one in self._waiting if one.user == user)
            self._waiting.remove(first)
            self._at_work[user] += 1
            self._served[user] = max(self._served.values(), default=-1) + 1
            first.worker.set_result(self._idle.pop())

    def _work_to_refuse(self) -> _Waiting:
        """The latest work of the user with the most work that waits."""
        number = Counter(one.user for one in self._waiting)
        return max(reversed(self._waiting), key=lambda one: number[one.user])

    def _refuse(self, one: _Waiting) -> None:
        self._waiting.remove(one)
        one.worker.set_exception(Busy("the service is busy with other work: try again in a moment"))

    def _add(self) -> None:
        if not self._is_closed:
            worker = WorkerProcess(self._plugins, self._folder)
            self._all.add(worker)
            self._idle.append(worker)
