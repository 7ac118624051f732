"""The work of a job in its folder, a race or a study: how far it is, and whether a process is at it."""

from pathlib import Path
from typing import Protocol

from mercator_design.race.session.journal import is_locked
from mercator_design.results.files import JOURNAL
from mercator_design.serve.jobs.job import Request, StudyRequest
from mercator_design.serve.jobs.races import RaceStatus
from mercator_design.show.study.folder import PAGE
from mercator_design.studies.folder import FACTS, lock_file
from mercator_design.studies.reading import StudyReading


class WorkStatus(Protocol):
    """State of a race or study, which may be running, from its folder."""

    folder: Path

    def read_on(self) -> object:
        """Read what is new.

        Raises:
            RaceError, StudyError: A file is damaged.
        """

    @property
    def n_experiments(self) -> int:
        """Experiments that have run, at the last reading."""

    def is_finished(self, budget: int) -> bool:
        """Whether it has ended under a budget, and its result is written."""


class StudyWork:
    """State of a study; of its cells, `read_on` reads only what is new."""

    def __init__(self, folder: Path) -> None:
        self.folder, self._reading = folder, StudyReading(folder)
        self.n_experiments, self._is_done = 0, False

    def read_on(self) -> None:
        """Read what is new.

        Raises:
            StudyError: A file is damaged.
        """
        if (self.folder / FACTS).exists():
            status = self._reading.read()
            self.n_experiments, self._is_done = status.done, status.is_done

    def is_finished(self, budget: int) -> bool:  # noqa: ARG002 - that of a study does not change
        """Whether all designs are assessed, and the page is written."""
        return self._is_done and (self.folder / PAGE).exists()


def status_of(request: Request, folder: Path) -> WorkStatus:
    """The state of a job's work; nothing is read yet."""
    return StudyWork(folder) if isinstance(request, StudyRequest) else RaceStatus(folder)


def is_at_work(request: Request, folder: Path) -> bool:
    """Whether a process, of this service or not, runs a job's work."""
    return is_locked(lock_file(folder) if isinstance(request, StudyRequest) else folder / JOURNAL)
