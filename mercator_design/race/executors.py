"""What runs experiments: a batch in, its results out, in the same order whatever runs when."""

from collections.abc import Callable, Iterator, Sequence
from types import TracebackType
from typing import Self, TypeVar

from joblib import Parallel, cpu_count, delayed

T = TypeVar("T")
R = TypeVar("R")


def available_jobs() -> int:
    """How many experiments this machine runs at once: its cores, as far as this process may use them."""
    return int(cpu_count())


class ThreadExecutor:
    """Runs experiments in threads of this process, for functions that do not hold the GIL."""

    def __init__(self, jobs: int) -> None:
        self._portion = 10 * jobs  # small enough to see progress, large enough to keep all jobs busy
        self._parallel = Parallel(n_jobs=jobs, backend="threading", batch_size=1)

    def __enter__(self) -> Self:
        self._parallel.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._parallel.__exit__(kind, error, traceback)

    def run(self, function: Callable[[T], R], items: Sequence[T]) -> Iterator[list[R]]:
        """The function's results in the order of the items, some at a time, so that a caller can show and keep them."""
        for start in range(0, len(items), self._portion):
            portion = items[start : start + self._portion]
            yield list(self._parallel(delayed(function)(item) for item in portion))
