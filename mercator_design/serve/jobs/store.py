"""The data folder: run folders, and the file of each job. They are the truth; the index only finds them quickly.

DATA/ID/                     the run folder of a job, as `mdesign race -o` writes it; or one that was there before
DATA/.service/jobs/ID/       job.json, mission.yaml if the user sent a text, and output.txt, the messages of its race
"""

import json
import re
import secrets
import shutil
import threading
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from mercator_design.config.json_data import read_json
from mercator_design.config.writing import plain
from mercator_design.errors import printable
from mercator_design.runs.files import JOURNAL
from mercator_design.serve.jobs.job import Job, Request
from mercator_design.serve.settings import ServiceError
from mercator_design.system.files import sync_folder, write_text

SERVICE = ".service"
MISSION = "mission.yaml"
OUTPUT = "output.txt"
_JOB = "job.json"
_DELETED = "deleted-"
_ALPHABET = "23456789abcdefghjkmnpqrstuvwxyz"  # no characters that look alike


class Store:
    """The jobs of a data folder; safe for several threads.

    Attributes:
        data: The path of the data folder.
    """

    def __init__(self, data: Path) -> None:
        """Open a data folder, which is made if need be.

        Raises:
            OSError: The folder cannot be made.
        """
        self.data = data
        self._jobs = data / SERVICE / "jobs"
        self._jobs.mkdir(parents=True, exist_ok=True)
        (data / SERVICE).chmod(0o700)
        self._lock = threading.RLock()
        for left in (data / SERVICE).glob(f"{_DELETED}*"):
            self._finish_deletion(left.name.removeprefix(_DELETED))

    def create(
        self,
        owner: str,
        name: str,
        direction: str,
        request: Request,
        text: str | None,
        *,
        key: str = "",
    ) -> Job:
        """A new job.

        Args:
            owner: The name of its user.
            name: The name of the mission.
            direction: Whether the race maximises or minimises the score.
            request: What it is to do.
            text: The mission, unless it is a shipped one.
            key: As `Job.key`.

        Raises:
            OSError: It cannot be written.
        """
        identity = new_id(name)
        job = Job(id=identity, owner=owner, name=name, direction=direction, request=request, submitted=_time(), key=key)
        folder = self.folder(identity)
        folder.mkdir()
        try:
            if text is not None:
                write_text(folder / MISSION, text)
            self._write(job)
            sync_folder(self._jobs)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        return job

    def folder(self, identity: str) -> Path:
        """The folder of a job's file."""
        return self._jobs / identity

    def run_folder(self, identity: str) -> Path:
        """The run folder of a job; it may not be there yet."""
        return self.data / identity

    def ids(self) -> list[str]:
        """The jobs."""
        return sorted(file.parent.name for file in self._jobs.glob(f"*/{_JOB}"))

    def others(self) -> Iterator[Path]:
        """Run folders of the data folder that are of no job."""
        for journal in sorted(self.data.glob(f"*/{JOURNAL}")):
            name = journal.parent.name
            if name.isprintable() and not name.startswith(".") and not self.folder(name).exists():
                yield journal.parent

    def read(self, identity: str) -> Job:
        """A job.

        Raises:
            ServiceError: Its file is missing or damaged.
        """
        file = self.folder(identity) / _JOB
        job: Job = read_json(file, Job, error=ServiceError)
        if job.id != identity:
            raise ServiceError(f"{file}: id: expected {identity}, as its folder, found {printable(job.id)}")
        return job

    def text(self, identity: str) -> str | None:
        """The mission of a job; None if it is a shipped one."""
        file = self.folder(identity) / MISSION
        return file.read_text(encoding="utf-8") if file.exists() else None

    def update(self, identity: str, **changes: Any) -> Job:  # noqa: ANN401 - the fields of Job
        """Change fields of a job.

        Raises:
            ServiceError: As `read`.
            OSError: It cannot be written; it is as before.
        """
        with self._lock:
            job = replace(self.read(identity), **changes)
            self._write(job)
            return job

    def delete(self, identity: str) -> None:
        """Delete a job with its run folder. After a crash, it is either there or gone.

        Raises:
            OSError: It cannot be deleted.
        """
        with self._lock:
            gone = self.data / SERVICE / f"{_DELETED}{identity}"
            self.folder(identity).rename(gone)
            try:
                self._finish_deletion(identity)
            except OSError:  # else the run folder would be one of no job, which all users see
                gone.rename(self.folder(identity))
                raise

    def _finish_deletion(self, identity: str) -> None:
        """Delete the files of a job whose folder was renamed; again at the next start, if some cannot be deleted."""
        job = self.data / SERVICE / f"{_DELETED}{identity}"
        run, gone = self.run_folder(identity), job / "run"
        if run.exists() and not gone.exists():
            run.rename(gone)
        shutil.rmtree(job, ignore_errors=True)

    def _write(self, job: Job) -> None:
        write_text(self.folder(job.id) / _JOB, json.dumps(plain(job), indent=1) + "\n")


def new_id(name: str) -> str:
    """An id that nothing else has, which begins with a name."""
    stem = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")[:40] or "mission"
    return f"{stem}-{''.join(secrets.choice(_ALPHABET) for _ in range(10))}"


def size_of(folder: Path) -> int:
    """The bytes of all files of a folder."""
    total = 0
    for path in folder.rglob("*"):
        try:
            total += path.stat().st_size if path.is_file() else 0
        except OSError:  # just removed
            continue
    return total


def _time() -> str:
    """The current time, so exact that it orders submissions."""
    return datetime.now(UTC).isoformat(timespec="microseconds")
