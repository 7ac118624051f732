"""Experiments on the workers of a Dask cluster, wherever they are: other processes, other machines, a queue of SLURM's.

Dask gives an experiment whose worker dies to another one; how many workers it may cost is the scheduler's
`distributed.scheduler.allowed-failures` (3 by default), after which it is given up. Workers may come and go.
"""

import pickle
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

from mercator_design.errors import RaceError
from mercator_design.race.executors import Failed, WorkerUnfit, call_packed

T = TypeVar("T")
R = TypeVar("R")


class DaskExecutor:
    """Runs experiments on the workers of a scheduler.

    Args:
        scheduler: Its address, such as tcp://host:8786, or its scheduler file.
        jobs: How many experiments to have under way; by default twice the threads that workers have at the time.
        timeout: Seconds to wait for the scheduler.

    Raises:
        RaceError: There is no package distributed, or no such scheduler.
    """

    def __init__(self, scheduler: str, jobs: int | None = None, *, timeout: float = 20.0) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise RaceError("dask: expected the package distributed (pip install 'mercator-design[dask]')") from None
        self._wanted = jobs
        where = {"scheduler_file": scheduler} if Path(scheduler).is_file() else {"address": scheduler}
        try:
            self._client: Any = Client(**where, timeout=timeout, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise RaceError(f"{scheduler}: expected a Dask scheduler there: {error}") from None

    @property
    def jobs(self) -> int:
        """Threads of the workers that there are now, and at least one."""
        return max(sum(map(int, self._client.nthreads().values())), 1)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._client.close()

    def run(self, function: Callable[[T], R], items: Iterable[T | None]) -> Iterator[tuple[int, R | Failed]]:
        """As `Executor.run`."""
        from distributed import as_completed

        packed = pickle.dumps(function)
        numbered = enumerate(items)
        under_way = as_completed(loop=self._client.loop)
        places: dict[Any, int] = {}
        while True:
            room = (self._wanted or 2 * self.jobs) - len(places)
            while room > 0:
                index, item = next(numbered, (0, None))
                if item is None:
                    break
                future = self._client.submit(call_packed, packed, item, pure=False)
                places[future.key] = index
                under_way.add(future)
                room -= 1
            if not places:
                return
            future = next(under_way)
            yield places.pop(future.key), self._result(future)

    @staticmethod
    def _result(future: Any) -> Any:  # noqa: ANN401 - whatever the function gives
        from distributed.scheduler import KilledWorker

        try:
            return future.result()
        except KilledWorker as error:
            return Failed(
                f"its worker died, {error.allowed_failures + 1} times, the last time {error.last_worker.address}"
            )
        except WorkerUnfit:
            raise
        except Exception as error:  # noqa: BLE001 - what went wrong in Dask itself
            return Failed(f"{type(error).__name__}: {str(error).partition(chr(10))[0]:.300}")
        finally:
            future.release()
