"""The service: its parts, put together for a data folder."""

import fcntl
import os
import sqlite3
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Self

from mercator_design.plugins.loading import snapshot
from mercator_design.race.executors.executor import available_jobs
from mercator_design.serve.accounts.accounts import Accounts
from mercator_design.serve.designs import Designs
from mercator_design.serve.jobs.index import Index
from mercator_design.serve.jobs.operations import Operations
from mercator_design.serve.jobs.processes import Launcher
from mercator_design.serve.jobs.store import Store
from mercator_design.serve.jobs.supervisor import Supervisor
from mercator_design.serve.settings import SERVICE, ServiceError, load_settings
from mercator_design.serve.workers.pool import WorkerPool


class Service:
    """All parts of a running service; a context manager that starts and ends it.

    Raises (on entering):
        ServiceError: The data folder cannot be used, another service uses it, or its settings are not valid.
    """

    def __init__(self, data: Path) -> None:
        self.data = data

    def __enter__(self) -> Self:
        with ExitStack() as ends:
            try:
                self.store = Store(self.data)
                ends.callback(os.close, _lock_folder(self.data))
                self.store.finish_deletions()
            except OSError as error:
                raise ServiceError(f"{self.data}: cannot be used: {error.strerror or error}") from None
            self.settings = settings = load_settings(self.data)
            empty = ends.enter_context(tempfile.TemporaryDirectory(prefix="mercator_design-"))
            try:
                self.index = Index(self.data / SERVICE / "index.sqlite")
                ends.callback(self.index.close)
                self.accounts = Accounts(self.data, settings.limits)
                ends.callback(self.accounts.close)
                self.designs = Designs(self.data / SERVICE / "designs", settings.limits)
            except (OSError, sqlite3.Error) as error:
                raise ServiceError(f"{self.data / SERVICE}: cannot be used: {error}") from None
            self.cores = settings.jobs or max(1, available_jobs() // settings.races)  # of a race
            self.supervisor = Supervisor(self.store, self.index, settings, Launcher(self.store, settings, self.cores))
            self.jobs = Operations(self.store, self.index, self.supervisor, settings.limits)
            ends.callback(self.supervisor.stop)
            self.workers = WorkerPool(
                settings.workers, settings.worker_seconds, settings.worker_memory, settings.extensions, Path(empty)
            )
            ends.callback(self.workers.close)
            self.workers.check_extensions()
            ends.callback(snapshot())
            settings.extensions.load()
            self.supervisor.start()
            self._ends = ends.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.close()


def _lock_folder(data: Path) -> int:
    """Locked file, which keeps a second service from the same folder."""
    file = os.open(data / SERVICE / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(file)
        raise ServiceError(f"{data}: another service runs on this folder") from None
    return file
