"""The pool of worker processes, shared fairly by users: the work of a user waits behind the user's own."""

import contextlib
import os
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import ParamSpec, TypeVar, cast

from mercator_design.serve.settings import MAX_WORKERS, Extensions, ServiceError
from mercator_design.serve.turns import next_user
from mercator_design.serve.workers.process import WorkerProcess

P = ParamSpec("P")
R = TypeVar("R")

CURRENT_USER: ContextVar[str] = ContextVar("current_user", default="")
"""Name of the user whose request is answered."""
MAX_WAITING = 300
"""Maximum number of waiting tasks of all users."""
MAX_WORK = MAX_WAITING + MAX_WORKERS
"""Maximum number of tasks, at work and waiting; each occupies a thread of the service."""
MAX_WAIT = 120.0
"""Maximum waiting time of a task [s]."""


class Busy(ServiceError):  # noqa: N818 - nothing is wrong
    """Too many tasks wait for a worker, or one has waited too long."""


@dataclass(eq=False, slots=True)
class _Waiting:
    """A task that waits for a worker."""

    user: str
    worker: Future[WorkerProcess] = field(default_factory=Future)


class WorkerPool:
    """Pool of worker processes; safe for several threads.

    A free worker takes a task of the user whose turn it is (`next_user`). One user never has all workers, so that long
    tasks do not keep other users waiting. If too many tasks wait, the latest of the user with the most is refused.

    Args:
        workers: Number of processes.
        seconds: Time limit of a task.
        megabytes: Memory limit of a worker.
        extensions: Plugins and flavours, which the workers load.
        folder: An empty folder, in which the workers work.
    """

    def __init__(self, workers: int, seconds: float, megabytes: int, extensions: Extensions, folder: Path) -> None:
        self.seconds, self.megabytes = seconds, megabytes
        self._extensions, self._folder = extensions, folder
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
            Busy: No worker was free in time, or too many tasks wait.
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

    def check_extensions(self) -> None:
        """Let a worker load the plugins and flavours.

        Raises:
            ServiceError: One of them cannot be read, or fails when it is run.
        """
        if any(self._extensions):
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
        """A worker for a task of a user; if the task raises, another worker takes its place."""
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
        """Wait for a worker for a task of a user.

        Raises:
            Busy: Too many tasks wait, or this one has waited too long.
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
        """Give idle workers to waiting tasks."""
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
        """The latest task of the user with the most waiting tasks."""
        number = Counter(one.user for one in self._waiting)
        return max(reversed(self._waiting), key=lambda one: number[one.user])

    def _refuse(self, one: _Waiting) -> None:
        self._waiting.remove(one)
        one.worker.set_exception(Busy("the service is busy with other work: try again in a moment"))

    def _add(self) -> None:
        if not self._is_closed:
            worker = WorkerProcess(self._extensions, self._folder)
            self._all.add(worker)
            self._idle.append(worker)
