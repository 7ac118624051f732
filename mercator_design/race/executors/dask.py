"""Runs experiments on the workers of a Dask cluster: other processes, other machines, or jobs of SLURM.

If a worker dies, Dask gives its experiments to another one, as often as the scheduler's
`distributed.scheduler.allowed-failures` allows (3 by default). Another experiment on the same worker may be the cause,
so each then runs alone, and fails if it again kills as many workers, unless workers die before they run anything.
Workers may come and go; while there is none, the race waits.

An experiment fails only by what happens to it in a worker. Anything else is a loss of the cluster, or an error of Dask:
a scheduler that ends or restarts, a connection or client that is closed, tasks that are cancelled.
"""

import asyncio
import collections
import contextlib
import queue
import secrets
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Any, Self, TypeVar

import cloudpickle

from mercator_design.errors import RaceError, described
from mercator_design.race.executors.bundles import Bundle, Bundles
from mercator_design.race.executors.compiling import CompilingWorkers, noting
from mercator_design.race.executors.executor import (
    DIES,
    MAX_WAIT,
    ExecutorLost,
    Failed,
    WorkerUnfit,
    call_packed,
    check_worker,
)
from mercator_design.race.executors.schedulers import TIMEOUT, address_of

T = TypeVar("T")
R = TypeVar("R")
_Fetched = queue.SimpleQueue[tuple[Any, Any]]  # futures with their results or exceptions

CHECK_EVERY = 1.0
"""Seconds between two counts of workers: the scheduler takes some milliseconds for an answer."""
SILENCE = 5.0
"""Seconds without an answer after which the scheduler is said to be silent."""
_CLOSING = 2.0
"""Seconds for saying goodbye to the scheduler."""


class DaskExecutor:
    """Runs experiments on the workers of a scheduler.

    Args:
        scheduler: Its address, such as tcp://host:8786, or its scheduler file.
        jobs: Number of experiments to submit at a time; by default twice the number of the workers' threads.
        timeout: Seconds to wait for the scheduler, or for its file. [default: those of `schedulers.address_of`]
        announce: Called with a message when experiments wait for a worker or for the scheduler, and when workers
            compile; perhaps in another thread.

    Raises:
        RaceError: The package distributed is not installed, or there is no such scheduler.
    """

    def __init__(
        self,
        scheduler: str,
        jobs: int | None = None,
        *,
        timeout: float | None = None,
        announce: Callable[[str], None] = lambda what: None,  # noqa: ARG005 - a name for the reader
    ) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise RaceError("dask: expected the package distributed: in the clone, pip install '.[dask]'") from None
        self._scheduler = scheduler
        self._announce = announce
        self._is_stopping = False
        self._wanted = jobs
        address = address_of(scheduler, timeout, announce=announce)
        try:
            self._client: Any = Client(address, timeout=TIMEOUT, set_as_default=False)
            self._n_threads = sum(map(int, self._client.nthreads().values()))  # of all workers, counted now and then
        except (OSError, ValueError, TimeoutError) as error:
            raise RaceError(f"{scheduler}: expected a Dask scheduler there: {error}") from None
        compiling = CompilingWorkers(announce)
        self._topic = f"mercator_design {secrets.token_hex(8)}"  # of the notes that workers send here
        self._client.subscribe_topic(self._topic, lambda event: compiling.add(event[1]))
        self._asked = self._answered = time.monotonic()
        self._is_asking = False

    @property
    def jobs(self) -> int:
        """Number of threads of the workers, counted now and then; at least one."""
        self._ask()
        return max(self._n_threads, 1)

    def stop(self) -> None:
        """As `Executor.stop`: without workers, `run` ends."""
        self._is_stopping = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(Exception):  # of a scheduler that is gone or does not answer
            self._client.close(timeout=_CLOSING)

    def run(self, function: Callable[[T], R], items: Iterable[T | None]) -> Iterator[tuple[int, R | Failed]]:
        packed = cloudpickle.dumps(function)
        left: Bundles[T] = Bundles(items)
        fetched: _Fetched = queue.SimpleQueue()
        bundles: dict[Any, Bundle[T]] = {}  # by future
        suspects: collections.deque[tuple[int, T]] = collections.deque()  # items that may have killed their workers

        def submit(new: Sequence[Bundle[T]]) -> None:
            work = [[item for _, item in bundle] for bundle in new]
            futures = self._submit(fetched, partial(_call_all, packed, self._topic), work)
            bundles.update(zip(futures, new, strict=True))

        try:
            while True:
                if is_alone := bool(suspects) and not bundles:
                    submit([[suspects.popleft()]])
                elif not suspects and (new := left.draw(len(bundles), self._wanted or 2 * self.jobs)):
                    submit(new)
                if not bundles:
                    return
                for future, found in (some := self._next(fetched)):
                    bundle = bundles.pop(future)
                    future.release()
                    if found is not None:
                        results, spent = found
                        left.took(spent, len(bundle))
                        yield from zip((index for index, _ in bundle), results, strict=True)
                    elif not is_alone:
                        suspects += bundle
                    elif self._is_a_worker_fit(packed):
                        yield bundle[0][0], Failed("its workers died")
                if not some:
                    return
        finally:
            for future in bundles:
                future.release()

    def _submit(self, fetched: _Fetched, function: Callable[[Any], object], work: Sequence[Any]) -> list[Any]:
        """Submit a task for each piece of work, in one message: the scheduler takes some milliseconds for each.

        The futures and their results are put into a queue when the results are here.
        """
        try:
            futures: list[Any] = self._client.map(function, work, pure=False)
            self._client.loop.add_callback(_fetch_all, futures, fetched)
        except Exception as error:
            if self._client.status == "running":
                raise
            raise self._lost(error) from None
        return futures

    def _next(self, fetched: _Fetched) -> list[tuple[Any, Any]]:
        """Futures that have ended, at least one, and their results; without one if its workers died.

        None at all if the executor stops and there is no worker.

        Raises:
            WorkerUnfit: A worker or Dask cannot run the task.
            ExecutorLost: There is no connection to the scheduler, or it has given up the task.
        """
        if (first := self._wait(fetched)) is None:
            return []
        some = [first]
        with contextlib.suppress(queue.Empty):
            while True:
                some.append(fetched.get_nowait())
        return [(future, self._result(future, found)) for future, found in some]

    def _result(self, future: Any, found: Any) -> Any:  # noqa: ANN401 - Dask's
        """What a task has returned; None if its workers died."""
        from distributed.scheduler import KilledWorker

        if isinstance(found, KilledWorker):  # it does not know the cause: a death counts against all tasks of a worker
            return None
        if isinstance(found, WorkerUnfit):
            raise found
        if isinstance(found, BaseException):
            if future.status == "error":
                reason = " ".join(described(found.__cause__ or found).split())
                raise WorkerUnfit(f"{self._scheduler}: the scheduler or a worker cannot run this race: {reason}")
            raise self._lost(found)
        return found

    def _wait(self, fetched: _Fetched) -> tuple[Any, Any] | None:
        """The next future of a queue with its result; None if the executor stops and there is no worker."""
        announced, begin = "", time.monotonic()
        while True:
            with contextlib.suppress(queue.Empty):
                return fetched.get(timeout=min(CHECK_EVERY, MAX_WAIT))
            if self._client.status != "running":
                raise self._lost(None)
            self._ask()
            what = ""
            if time.monotonic() > max(self._answered, begin) + SILENCE:
                what = "the scheduler does not answer; the race waits for it"
            elif self._answered > begin and not self._n_threads:
                what = "no worker is connected; the race waits for one"
            if what and self._is_stopping:
                return None
            if what and what != announced:
                self._announce(f"{self._scheduler}: {what}")
            announced = what

    def _is_a_worker_fit(self, packed: bytes) -> bool:
        """Whether a worker survives loading the function; False if the executor stops before that is known.

        Raises:
            WorkerUnfit: Workers die of it.
        """
        fetched: _Fetched = queue.SimpleQueue()
        self._submit(fetched, check_worker, [packed])
        ended = self._next(fetched)
        if any(found is None for _, found in ended):
            raise WorkerUnfit(f"{self._scheduler}: {DIES}")
        return bool(ended)

    def _ask(self) -> None:
        """Ask the scheduler for the number of its workers' threads, unless it was asked just now; do not wait."""
        if self._is_asking or time.monotonic() < self._asked + CHECK_EVERY:
            return
        self._asked, self._is_asking = time.monotonic(), True
        with contextlib.suppress(RuntimeError):  # the client is closed
            self._client.loop.add_callback(self._count)

    async def _count(self) -> None:
        """In the event loop: take the answer."""
        try:
            self._n_threads = sum(map(int, (await self._client.nthreads()).values()))
            self._answered = time.monotonic()
        except Exception:  # noqa: BLE001, S110 - `_wait` reports it, when it lasts
            pass
        finally:
            self._is_asking = False

    def _lost(self, error: BaseException | None) -> ExecutorLost:
        reason = getattr(error, "reason", "") or (described(error) if error else f"client {self._client.status}")
        return ExecutorLost(
            f"{self._scheduler}: lost the Dask cluster ({reason}); running experiments are not recorded"
        )


async def _fetch_all(futures: Sequence[Any], fetched: _Fetched) -> None:
    """In the event loop: fetch the results of futures as they end. Dask itself joins requests that come together."""
    await asyncio.gather(*(_fetch(future, fetched) for future in futures))


async def _fetch(future: Any, fetched: _Fetched) -> None:  # noqa: ANN401 - Dask's
    """In the event loop: wait for a future, fetch its result, and put both into a queue."""
    try:
        found = await future
    except BaseException as error:  # noqa: BLE001 - also that it was cancelled
        found = error
    fetched.put((future, found))


def _call_all(packed: bytes, topic: str, items: Sequence[Any]) -> tuple[list[Any], float]:
    """In a worker: run all items; return their results and the time [s]."""
    from distributed import get_worker

    start = time.perf_counter()
    with noting(partial(get_worker().log_event, topic)):
        return [call_packed(packed, item) for item in items], time.perf_counter() - start
