"""The settings of the service: limits of jobs and requests, from serve.yaml in its data folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from mercator_design.config.loading import read
from mercator_design.config.schema import FilePath, Range
from mercator_design.errors import MercatorError

FILE = "serve.yaml"
SERVICE = ".service"
"""Folder in the data folder for everything but run folders."""
MAX_WORKERS = 64
"""Maximum number of processes for short work."""
_Count = Annotated[int, Range(1)]
_Megabytes = Annotated[int, Range(0)]


class ServiceError(MercatorError):
    """The service cannot be run, or its settings are not valid."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UserLimits:
    """Limits of a user."""

    budget: _Count = 100_000  # experiments of a job
    robots: _Count = 100  # of a mission
    duration: Annotated[float, Range(0.0, exclusive_low=True)] = 3600.0  # [s] of an experiment
    hours: Annotated[float, Range(0.0, exclusive_low=True)] = 48.0  # a job may run
    jobs: _Count = 1000  # of a user that have not ended
    running: _Count = 100  # of a user at the same time
    runs: _Count = 1000  # instances of an evaluation
    designs: _Count = 500  # of a user
    requests: _Count = 120  # of a user that are answered at the same time, event streams apart
    streams: _Count = 40  # of events, of a user at the same time
    disk: _Megabytes = 20_000  # of a user's jobs [MB]
    free_disk: _Megabytes = 200  # below it, races pause [MB]


class Extensions(NamedTuple):
    """What the administrator has placed for all users."""

    plugins: tuple[str, ...] = ()
    flavours: tuple[str, ...] = ()

    def load(self) -> None:
        """Run the plugins, and enter the flavours, in this process.

        Raises:
            ServiceError: One cannot be read, or fails when it is run.
        """
        from mercator_design.modules.flavour import load_flavour
        from mercator_design.plugins.loading import load_plugin

        for key, files, load in (("plugins", self.plugins, load_plugin), ("flavours", self.flavours, load_flavour)):
            try:
                for file in files:
                    load(file)
            except MercatorError as error:
                raise ServiceError(*(f"{key}: {message}" for message in error.messages)) from None


@dataclass(frozen=True, slots=True, kw_only=True)
class ServiceSettings:
    """The contents of serve.yaml."""

    schema: Literal[1] = 1  # version of this format
    races: _Count = 1  # that run at the same time
    jobs: Annotated[int, Range(0)] = 0  # experiments of a race at the same time; 0: all cores, shared by the races
    workers: Annotated[int, Range(1, MAX_WORKERS)] = 3  # processes for short work; a user has at most all but one
    worker_seconds: Annotated[float, Range(0.0, exclusive_low=True)] = 60.0  # after which such work is refused
    worker_memory: Annotated[int, Range(600)] = 2000  # of a worker, above which such work is refused [MB]
    scheduler: str = ""  # address of a Dask scheduler, which runs the experiments
    plugins: tuple[
        Annotated[str, FilePath()], ...
    ] = ()  # Python files, and folders of packages; they run as the service's user
    packages: tuple[str, ...] = ()  # names of plugins of installed packages; the same
    flavours: tuple[Annotated[str, FilePath()], ...] = ()  # files of flavours that users may choose, too
    hosts: tuple[str, ...] = ()  # further names by which browsers reach the service, as behind a proxy
    proxies: tuple[str, ...] = ("127.0.0.1", "::1")  # addresses or networks of the proxy, for --behind-proxy
    limits: UserLimits = UserLimits()

    @property
    def extensions(self) -> Extensions:
        return Extensions((*self.plugins, *self.packages), self.flavours)


def load_settings(folder: Path) -> ServiceSettings:
    """The settings in the file of a folder; without a file, the defaults.

    Raises:
        ServiceError: The settings are not valid; with file, line and key.
    """
    file = folder / FILE
    return read(file, ServiceSettings, error=ServiceError) if file.exists() else ServiceSettings()
