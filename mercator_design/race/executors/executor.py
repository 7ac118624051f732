"""The interface of executors, and what they share.

An executor runs experiments: a function on items. Results come as soon as they are available, and do not depend on
where an experiment runs. If an experiment fails, its result is a `Failed`; the executor does not raise, and the caller
decides.
"""

import itertools
import os
import pickle
import socket
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Generic, Protocol, Self, TypeVar

from mercator_design.errors import RaceError, described

T = TypeVar("T")
R = TypeVar("R")

MAX_WAIT = 0.5
"""Maximum seconds of one wait: a signal just before a wait is handled only at its end."""
CORES_OF_JOB = (
    *("SLURM_CPUS_PER_TASK", "SLURM_CPUS_ON_NODE"),
    *("NCPUS", "PBS_NUM_PPN"),  # PBS Pro, Torque
    "NSLOTS",  # Grid Engine
    "LSB_DJOB_NUMPROC",  # LSF
)
"""Variables by which schedulers say how many cores a job has: not all of them keep it from using others."""
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


class ExecutorLost(RaceError):  # noqa: N818 - as `Failed`, it says what happened
    """An executor has lost its workers. It is not a failure of an experiment; the race can be resumed."""

    exit_code = os.EX_TEMPFAIL


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
        """Prepare for the end of `items`: `run` then waits for running items, but not for new workers.

        A signal handler may call it.
        """

    def run(self, function: Callable[[T], R], items: Iterable[T | None]) -> Iterator[tuple[int, R | Failed]]:
        """Yield the position of each item and the function's result, in the order in which they finish.

        Items are taken as workers become free; an executor may hold up to two for each worker, or two groups of short
        ones. None stands for an item that is not known yet: `items` is asked again when another item has finished, and
        `run` ends if none is running. If `items` has a length hint, so many can be taken without waiting.
        The position counts all that `items` has yielded, None included. A caller may stop iterating early; the next
        call of `run` yields nothing of this one.

        Raises:
            WorkerUnfit: A worker has no such function, or another version of it, or dies as it loads it.
            ExecutorLost: The workers cannot be reached any longer.
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
    """Number of cores that this process may use: by its affinity, its control group, and the scheduler of its job."""
    from joblib import cpu_count

    given = [os.environ.get(name, "") for name in CORES_OF_JOB]
    return min([int(cpu_count()), *(int(cores) for cores in given if cores.isdecimal() and int(cores) > 0)])


def checked_jobs(jobs: int | None) -> int:
    """How many items run at once: as many as given, by default `available_jobs`.

    Raises:
        RaceError: There are none.
    """
    if jobs is None:
        return available_jobs()
    if jobs < 1:
        raise RaceError(f"jobs: expected at least 1, found {jobs}")
    return jobs


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
    result = attempt(load_packed(packed), item)
    try:
        pickle.loads(pickle.dumps(result))  # noqa: S301 - our own
    except BaseException as error:  # noqa: BLE001 - other people's classes fail in many ways here
        result = Failed(result.reason if isinstance(result, Failed) else described(error))
    return result


def load_packed(packed: bytes) -> Callable[[Any], Any]:
    """In a worker: load a function.

    Raises:
        WorkerUnfit: It cannot be loaded here.
    """
    try:
        return _unpacked(packed)
    except BaseException as error:  # noqa: BLE001 - for example a missing package; also sys.exit()
        where = f"process {os.getpid()} on {socket.gethostname()}"
        raise WorkerUnfit(f"a worker ({where}) cannot run this race: {described(error)}") from None


def check_worker(packed: bytes) -> bool:
    """In a worker: do nothing but load a function, to see whether the worker survives that."""
    load_packed(packed)
    return True


DIES = "workers die before they have run anything; see what their machine says of them"
"""The message of a `WorkerUnfit` after `check_worker`."""
