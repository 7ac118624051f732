"""The data folder: run folders, and the file of each job. The index can be made again from them.

DATA/ID/                     the folder of a job, as `mdesign race -o` or `mdesign study -o` writes it; or a run folder
                             that was there before
DATA/.service/jobs/ID/       job.json, and output.txt, the messages of its process; of a user's text mission.yaml, or
                             the folder study/, with study.yaml and the files that it names
"""

import shutil
import threading
from collections.abc import Iterator
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

from mercator_design.race.session.journal import now
from mercator_design.results.files import JOURNAL
from mercator_design.serve.jobs.job import Job, RaceRequest, Request
from mercator_design.serve.records import Records, new_id
from mercator_design.serve.settings import SERVICE

MISSION = RaceRequest.FILE
OUTPUT = "output.txt"


class Store(Records[Job]):
    """The jobs of a data folder; safe for several threads.

    Attributes:
        data: The path of the data folder.
    """

    def __init__(self, data: Path) -> None:
        """Open a data folder, which is made if need be.

        Raises:
            OSError: The folder cannot be made.
        """
        super().__init__(data / SERVICE / "jobs", Job, "job.json")
        self.data = data
        (data / SERVICE).chmod(0o700)
        self._lock = threading.RLock()

    def finish_deletions(self) -> None:
        """Delete what is left of jobs without a file; only for the service that has the data folder."""
        for left in self._folder.iterdir():
            if not self.file(left.name).exists():
                self._clear(left.name)

    def create(self, owner: str, name: str, direction: str, request: Request, *, key: str = "") -> Job:
        """A new job. The texts of its mission or study are written to files of their own.

        Raises:
            ServiceError: A value is not valid, for example the name.
            OSError: It cannot be written.
        """
        job = Job(
            id=new_id(name),
            owner=owner,
            name=name,
            direction=direction,
            request=request.with_texts({}),
            submitted=now("microseconds"),  # so exact that it orders submissions
            key=key,
        )
        self.add(job, request.texts)
        return job

    def run_folder(self, identity: str) -> Path:
        """The folder of a job's race or study; it may not be there yet."""
        return self.data / identity

    def others(self) -> Iterator[Path]:
        """Run folders of the data folder that are of no job."""
        for journal in sorted(self.data.glob(f"*/{JOURNAL}")):
            name = journal.parent.name
            if name.isprintable() and not name.startswith(".") and not self.folder(name).exists():
                yield journal.parent

    def without_data_folder(self, text: str) -> str:
        """A text, or HTML, without the path of the data folder."""
        for folder in {str(self.data.absolute()), str(self.data.resolve())}:
            text = text.replace(f"{folder}/", "").replace(f"{escape(folder)}/", "")
        return text

    def request(self, identity: str) -> Request:
        """The request of a job, with the texts of its mission or study.

        Raises:
            ServiceError: A file of the job is damaged.
        """
        request = self.read(identity).request
        folder = self.folder(identity)
        files = [path.relative_to(folder).as_posix() for path in folder.glob(request.TEXTS) if path.is_file()]
        return request.with_texts({file: self.text(identity, file) for file in files})

    def update(self, identity: str, **changes: Any) -> Job:  # noqa: ANN401 - the fields of Job
        """Change fields of a job; it is written only if one of them changes.

        Raises:
            ServiceError: As `read`.
            OSError: It cannot be written; it is as before.
        """
        with self._lock:
            job = replace(before := self.read(identity), **changes)
            if job != before:
                self.write(job)
            return job

    def delete(self, identity: str) -> None:
        """Delete a job with its run folder. After a crash, it is either there or gone.

        Raises:
            OSError: It cannot be deleted.
        """
        self.file(identity).unlink()
        self._clear(identity)

    def _clear(self, identity: str) -> None:
        """Delete the folders of a job without a file; again at the next start, if something cannot be deleted."""
        shutil.rmtree(self.run_folder(identity), ignore_errors=True)
        if not self.run_folder(identity).exists():  # else it would be one of no job, which all users see
            shutil.rmtree(self.folder(identity), ignore_errors=True)


def size_of(folder: Path) -> int:
    """The bytes of all files of a folder."""
    total = 0
    for path in folder.rglob("*"):
        try:
            total += path.stat().st_size if path.is_file() else 0
        except OSError:  # just removed
            continue
    return total
