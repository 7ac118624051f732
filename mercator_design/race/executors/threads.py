"""Runs experiments in threads of this process.

A thread runs several short experiments together, step by step: all are prepared, then all run in compiled code, then
all are read. For compiled code leaves little of Python in the processor's caches, and Python needs it back only once
for a group.
"""

import contextlib
import queue
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from functools import partial
from itertools import islice, takewhile
from operator import length_hint
from typing import Any, Protocol, Self, TypeVar, runtime_checkable

from mercator_design.race.executors.executor import MAX_WAIT, Failed, attempt, checked_jobs

T = TypeVar("T")
R = TypeVar("R")
T_contra = TypeVar("T_contra", contravariant=True)
R_co = TypeVar("R_co", covariant=True)

Group = Sequence[tuple[int, T]]
"""Items with their positions."""
Results = list[tuple[int, R | Failed]]

_MAX_GROUP = 8
_GROUP_SECONDS = 0.05
"""Maximum seconds that a group takes: the result of its first item is not known sooner."""


@runtime_checkable
class Stepped(Protocol[T_contra, R_co]):
    """A function that also runs in steps."""

    def __call__(self, item: T_contra) -> R_co: ...

    def in_steps(self, item: T_contra) -> Generator[None, None, R_co]:
        """Do what a call does, yield after each step but the last, and return what a call returns."""


class ThreadExecutor:
    """Threads of this process, for functions that release the GIL.

    The calling thread runs no items: so exceptions of signals and exceptions of items cannot be confused. Items of a
    `Stepped` function run in groups if they are short, and if `items` has a length hint: towards its end groups become
    smaller, so that all threads end at the same time.

    Args:
        jobs: Number of threads. [default: the cores that it may use]
        clock: Returns the time [s].

    Raises:
        RaceError: `jobs` is below 1.
    """

    def __init__(self, jobs: int | None = None, *, clock: Callable[[], float] = time.perf_counter) -> None:
        self.jobs = checked_jobs(jobs)
        self._clock = clock
        self._todo: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._threads: list[threading.Thread] = []

    def __enter__(self) -> Self:
        # Daemons end with this process, even if an experiment does not end.
        self._threads = []
        try:
            for _ in range(self.jobs):
                thread = threading.Thread(target=self._serve, daemon=True)
                thread.start()
                self._threads.append(thread)
        except BaseException:  # the system may have no more threads
            self.__exit__(None)
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        with contextlib.suppress(queue.Empty):
            while True:
                self._todo.get_nowait()
        for _thread in self._threads:
            self._todo.put(None)
        if kind is None or issubclass(kind, Exception):  # after Ctrl-C it does not wait
            for thread in self._threads:
                while thread.is_alive():
                    thread.join(MAX_WAIT)

    def stop(self) -> None:
        """Do nothing: `run` never waits for workers."""

    def run(self, function: Callable[[T], R], items: Iterable[T | None]) -> Iterator[tuple[int, R | Failed]]:
        if not self._threads:
            raise RuntimeError("expected to be entered (`with ThreadExecutor(...)`) before it runs anything")
        left = iter(items)
        numbered: Iterator[tuple[int, Any]] = enumerate(left)
        together: Callable[[Group[T]], Results[R]]
        if isinstance(function, Stepped):
            together, group_limit = partial(_in_steps, function), _MAX_GROUP
        else:
            together, group_limit = partial(_one_by_one, function), 1
        done: queue.SimpleQueue[tuple[Results[R], float]] = queue.SimpleQueue()

        def run(group: Group[T]) -> None:
            start = self._clock()
            done.put((together(group), self._clock() - start))

        max_under_way = self.jobs + (self.jobs > 1)  # a group for each thread; if there are several, one more waits
        under_way = 0
        max_group = 1
        while True:
            while under_way < max_under_way:
                share = length_hint(left) // (self.jobs + 1)
                size = min(max(share, 1), max_group)
                group = list(takewhile(lambda one: one[1] is not None, islice(numbered, size)))
                if not group:
                    break
                self._todo.put(partial(run, group))
                under_way += 1
            if not under_way:
                return
            results, seconds = _next(done)
            yield from results
            under_way -= 1
            max_group = max(min(int(_GROUP_SECONDS * len(results) / max(seconds, 1e-6)), group_limit), 1)

    def _serve(self) -> None:
        while (job := self._todo.get()) is not None:
            job()


def _next(done: "queue.SimpleQueue[T]") -> T:
    while True:
        with contextlib.suppress(queue.Empty):
            return done.get(timeout=MAX_WAIT)


class _More:
    """Stands for the result of steps that have not ended."""


def _one_by_one(function: Callable[[T], R], group: Group[T]) -> Results[R]:
    return [(index, attempt(function, item)) for index, item in group]


def _in_steps(function: Stepped[T, R], group: Group[T]) -> Results[R]:
    """Make the first step of all items, then the second, and so on."""
    running: dict[int, Generator[None, None, R]] = {}
    found: Results[R] = []
    for index, item in group:
        steps = attempt(function.in_steps, item)
        if isinstance(steps, Failed):
            found.append((index, steps))
        else:
            running[index] = steps
    while running:
        for index, steps in list(running.items()):
            result = attempt(_step, steps)
            if not isinstance(result, _More):
                found.append((index, result))
                del running[index]
    return found


def _step(steps: Generator[None, None, R]) -> R | _More:
    """Make a step, and return the result if it was the last."""
    try:
        next(steps)
    except StopIteration as end:
        result: R = end.value
        return result
    return _More()
