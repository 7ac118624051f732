"""Runs experiments on the workers of a Dask cluster: other processes, other machines, or jobs of SLURM.

If a worker dies, Dask gives its experiments to another one, as often as the scheduler's
`distributed.scheduler.allowed-failures` allows (3 by default). Another experiment on the same worker may be the cause,
so each then runs alone, and fails if it again kills as many workers. Workers may come and go; while there is none, the
race waits.
"""

import collections
import math
import secrets
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import islice, takewhile
from pathlib import Path
from typing import Any, Self, TypeVar

import cloudpickle

from mercator_design.errors import RaceError
from mercator_design.race.executors.compiling import CompilingWorkers, noting
from mercator_design.race.executors.executor import Failed, WorkerUnfit, call_packed

T = TypeVar("T")
R = TypeVar("R")
_Bundle = list[tuple[int, T]]  # items with their indices

BUNDLE = 0.2
"""Seconds of work in one task, if there is work for all workers: the scheduler takes a millisecond or two per task."""
MAX_BUNDLED = 64
CHECK_EVERY = 1.0
"""Seconds between two counts of workers: asking the scheduler takes some milliseconds."""


class DaskExecutor:
    """Runs experiments on the workers of a scheduler.

    Args:
        scheduler: Its address, such as tcp://host:8786, or its scheduler file.
        jobs: Number of experiments to submit at a time; by default twice the number of the workers' threads.
        timeout: Seconds to wait for the scheduler.
        announce: Called with a message when experiments wait and there is no worker, and when workers compile; perhaps
            in another thread.

    Raises:
        RaceError: The package distributed is not installed, or there is no such scheduler.
    """

    def __init__(
        self,
        scheduler: str,
        jobs: int | None = None,
        *,
        timeout: float = 20.0,
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
        self._jobs, self._checked = 1, -math.inf
        where = {"scheduler_file": scheduler} if Path(scheduler).is_file() else {"address": scheduler}
        try:
            self._client: Any = Client(**where, timeout=timeout, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise RaceError(f"{scheduler}: expected a Dask scheduler there: {error}") from None
        compiling = CompilingWorkers(announce)
        self._topic = f"mercator_design {secrets.token_hex(8)}"  # of the notes that workers send here
        self._client.subscribe_topic(self._topic, lambda event: compiling.add(event[1]))

    @property
    def jobs(self) -> int:
        """Number of threads of the workers, counted now and then; at least one."""
        if (now := time.monotonic()) > self._checked + CHECK_EVERY:
            self._checked, self._jobs = now, max(self._n_threads(), 1)
        return self._jobs

    def stop(self) -> None:
        """As `Executor.stop`: without workers, `run` ends."""
        self._is_stopping = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._client.close()

    def run(self, function: Callable[[T], R], items: Iterable[T | None]) -> Iterator[tuple[int, R | Failed]]:
        from distributed import as_completed

        packed = cloudpickle.dumps(function)
        numbered: Iterator[tuple[int, Any]] = enumerate(items)
        under_way = as_completed(loop=self._client.loop)
        bundles: dict[Any, _Bundle[T]] = {}
        seconds = math.inf  # per item

        suspects: collections.deque[tuple[int, T]] = collections.deque()  # items that may have killed their workers

        def submit(bundle: _Bundle[T]) -> None:
            future = self._client.submit(_call_all, packed, [item for _, item in bundle], self._topic, pure=False)
            bundles[future.key] = bundle
            under_way.add(future)

        while True:
            if is_alone := bool(suspects) and not bundles:
                submit([suspects.popleft()])
            elif not suspects:
                room = max((self._wanted or 2 * self.jobs) - len(bundles), 0)
                bundle_size = min(max(int(BUNDLE / seconds), 1), MAX_BUNDLED)
                drawn = list(takewhile(lambda one: one[1] is not None, islice(numbered, room * bundle_size)))
                for k in range(min(room, len(drawn))):
                    submit(drawn[k::room])
            if not bundles:
                return
            if not self._is_one_ready(under_way):
                return
            future = next(under_way)
            bundle = bundles.pop(future.key)
            results, spent = self._result(future, len(bundle))
            if results is None and not is_alone:
                suspects += bundle
            elif results is None:
                yield bundle[0][0], Failed("its workers died")
            else:
                seconds = spent / len(bundle) or seconds
                yield from zip((index for index, _ in bundle), results, strict=True)

    def _is_one_ready(self, under_way: Any) -> bool:  # noqa: ANN401 - Dask's as_completed
        """Wait until a future has ended; False if the executor stops and there is no worker."""
        is_announced, look = False, time.monotonic() + CHECK_EVERY
        while not under_way.has_ready():
            with under_way.thread_condition:
                under_way.thread_condition.wait(timeout=0.1)
            if time.monotonic() < look:
                continue
            is_there = self._n_threads() > 0
            if not is_there and self._is_stopping:
                return False
            if not is_there and not is_announced:
                self._announce(f"{self._scheduler}: no worker is connected; the race waits for one")
            is_announced, look = not is_there, time.monotonic() + CHECK_EVERY
        return True

    def _n_threads(self) -> int:
        """Number of threads of all workers; 0 if the scheduler does not answer."""
        try:
            return sum(map(int, self._client.nthreads().values()))
        except (OSError, RuntimeError, ValueError):  # the connection is closed, or a timeout
            return 0

    @staticmethod
    def _result(future: Any, n: int) -> tuple[list[Any] | None, float]:  # noqa: ANN401 - the function's type
        """The results of n items and their time [s]; None if their workers died.

        Dask does not know the cause of a death: it counts against all tasks of the worker.
        """
        from distributed.scheduler import KilledWorker

        try:
            found: tuple[list[Any], float] = future.result()
        except KilledWorker:
            return None, 0.0
        except WorkerUnfit:
            raise
        except Exception as error:  # noqa: BLE001 - an error in Dask itself
            return [Failed(f"{type(error).__name__}: {str(error).partition(chr(10))[0]:.300}")] * n, 0.0
        else:
            return found
        finally:
            future.release()


def _call_all(packed: bytes, items: Sequence[Any], topic: str) -> tuple[list[Any], float]:
    """In a worker: run all items; return their results and the time [s]."""
    from distributed import get_worker

    start = time.perf_counter()
    with noting(partial(get_worker().log_event, topic)):
        return [call_packed(packed, item) for item in items], time.perf_counter() - start
