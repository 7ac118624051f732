"""The options of a verb that runs races: what runs their experiments."""

import logging
from collections.abc import Callable

import click

from mercator_design.cli.options import jobs_of
from mercator_design.command import NumberRange, print_note
from mercator_design.errors import RaceError
from mercator_design.race.executors.executor import Executor
from mercator_design.race.executors.futures import FuturesExecutor
from mercator_design.race.executors.processes import ProcessExecutor
from mercator_design.race.executors.threads import ThreadExecutor

_DASK_LOGGERS = ("distributed", "distributed.client", "tornado.application")
"""They log tracebacks when a scheduler ends, which the race itself reports."""
_JOBS = jobs_of("the cores that it may use; with Dask, twice the workers' threads")
_EXECUTOR = click.option(
    "--executor",
    "executor_name",
    metavar="[threads|processes|dask|NAME|MODULE:FACTORY]",
    default="threads",
    show_default=True,
    help="Executor of the experiments; results do not depend on it. MODULE:FACTORY, or NAME of an entry point, gives "
    "any executor of concurrent.futures, such as mpi4py.futures:MPIPoolExecutor.",
)
_SCHEDULER = click.option(
    "--scheduler", metavar="ADDRESS", help="Dask scheduler: an address such as tcp://host:8786, or a scheduler file."
)
_TIMEOUT = click.option(
    "--timeout",
    type=NumberRange(0, min_open=True),
    metavar="SECONDS",
    help="Time limit of an experiment (with --executor processes): its worker is killed and it runs once more; then it "
    "fails.",
)


def EXECUTOR(verb: Callable[..., None]) -> Callable[..., None]:  # noqa: N802 - as the options beside it
    """The options --jobs, --executor, --scheduler and --timeout of a verb, for `executor_of`."""
    return _JOBS(_EXECUTOR(_SCHEDULER(_TIMEOUT(verb))))


def executor_of(name: str, jobs: int | None, scheduler: str | None, timeout: float | None) -> Executor:
    """The executor that the options give; what it announces goes to stderr.

    Raises:
        click.UsageError: The options contradict each other, or there is no such executor.
    """
    if (scheduler is not None) != (name == "dask"):
        raise click.UsageError(
            "--executor dask and --scheduler go together; for a scheduler of your own: "
            "dask scheduler --scheduler-file s.json, then --scheduler s.json"
        )
    if timeout is not None and name != "processes":
        raise click.UsageError("--timeout needs --executor processes: only a process can be killed")
    context = click.get_current_context()

    def announce(what: str) -> None:
        with context.scope(cleanup=False):  # in another thread there is none
            print_note(f"Note: {what}")

    if scheduler is not None:
        from mercator_design.race.executors.dask import DaskExecutor

        executor = DaskExecutor(scheduler, jobs, announce=announce)
        for logger in _DASK_LOGGERS:  # not before: Dask sets their levels when it is imported
            logging.getLogger(logger).setLevel(logging.CRITICAL)
        return executor
    if name == "processes":
        return ProcessExecutor(jobs, timeout=timeout)
    if name == "threads":
        return ThreadExecutor(jobs)
    try:
        return FuturesExecutor(name, jobs)
    except RaceError as error:
        raise click.UsageError(f"--executor: {error}") from None
