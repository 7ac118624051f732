"""The service: its parts, put together for a data folder."""

import fcntl
import os
import sqlite3
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from mercator_design.race.running.executors import available_jobs
from mercator_design.serve.accounts.accounts import Accounts
from mercator_design.serve.designs import Designs
from mercator_design.serve.desk.desk import Desk
from mercator_design.serve.jobs.index import Index
from mercator_design.serve.jobs.operations import Operations
from mercator_design.serve.jobs.processes import Launcher
from mercator_design.serve.jobs.store import Store
from mercator_design.serve.jobs.supervisor import Supervisor
from mercator_design.serve.settings import SERVICE, ServiceError, Settings, load_settings


@dataclass(slots=True)
class Service:
    """All parts of a running service; a context manager that starts and ends it.

    Raises (on entering):
        ServiceError: The data folder cannot be used, another service uses it, or its settings are not valid.
    """

    data: Path
    settings: Settings = field(init=False)
    store: Store = field(init=False)
    index: Index = field(init=False)
    supervisor: Supervisor = field(init=False)
    jobs: Operations = field(init=False)
    desk: Desk = field(init=False)
    designs: Designs = field(init=False)
    accounts: Accounts = field(init=False)
    cores: int = field(init=False)  # experiments of a race that run at the same time
    _lock: int = field(init=False)
    _empty: "tempfile.TemporaryDirectory[str]" = field(init=False)

    def __enter__(self) -> Self:
        try:
            self.store = Store(self.data)
            self._lock = _locked(self.data)
        except OSError as error:
            raise ServiceError(f"{self.data}: cannot be used: {error.strerror or error}") from None
        try:
            self.settings = settings = load_settings(self.data)
            self.index = Index(self.data / SERVICE / "index.sqlite")
        except BaseException as error:
            os.close(self._lock)
            if isinstance(error, (OSError, sqlite3.Error)):
                raise ServiceError(f"{self.data / SERVICE}: the index cannot be used: {error}") from None
            raise
        self.cores = settings.jobs or max(1, available_jobs() // settings.races)
        self.supervisor = Supervisor(self.store, self.index, settings, Launcher(self.store, settings, self.cores))
        self.jobs = Operations(self.store, self.index, self.supervisor, settings.limits)
        self.designs = Designs(self.data / SERVICE / "designs", settings.limits)
        self._empty = tempfile.TemporaryDirectory(prefix="mercator_design-")
        self.desk = Desk(
            settings.helpers, settings.helper_seconds, settings.helper_memory, settings.plugins, Path(self._empty.name)
        )
        self.accounts = Accounts(self.data)
        self.supervisor.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.desk.close()
        self.supervisor.stop()
        self.accounts.close()
        self.index.close()
        self._empty.cleanup()
        os.close(self._lock)


def _locked(data: Path) -> int:
    """The file that one service at a time has locked."""
    file = os.open(data / SERVICE / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(file)
        raise ServiceError(f"{data}: another service runs on this folder") from None
    return file
