"""What runs experiments: a batch in, its costs out, in the same order whatever runs when."""

from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self

from joblib import Parallel, cpu_count, delayed

from mercator_design.race.race import Experiment

Evaluate = Callable[[Experiment], float]


def available_jobs() -> int:
    """How many experiments this machine runs at once: its cores, as far as this process may use them."""
    return int(cpu_count())


class ThreadExecutor:
    """Runs experiments in threads of this process, for an `evaluate` that does not hold the GIL."""

    def __init__(self, evaluate: Evaluate, jobs: int) -> None:
        self._evaluate = evaluate
        self._parallel = Parallel(n_jobs=jobs, backend="threading", batch_size=1)

    def __enter__(self) -> Self:
        self._parallel.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._parallel.__exit__(kind, error, traceback)

    def run(self, experiments: Sequence[Experiment]) -> list[float]:
        """The costs of a batch of experiments."""
        evaluate = delayed(self._evaluate)
        return list(self._parallel(evaluate(experiment) for experiment in experiments))
