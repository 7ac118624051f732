"""The supervisor of races and studies: starts, follows, pauses and ends their processes, also after a crash.

The state of a job follows from its file and its folder, so the service may be killed at any time.
"""

import contextlib
import logging
import math
import shutil
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

from mercator_design.errors import MercatorError, RaceError, StudyError, described
from mercator_design.race.session.journal import Reading, is_locked, now
from mercator_design.results.files import JOURNAL
from mercator_design.serve.jobs.index import Index, IndexRow
from mercator_design.serve.jobs.job import ENDED, Job
from mercator_design.serve.jobs.processes import RaceProcess
from mercator_design.serve.jobs.rows import changed_row, figures_of, row_of_folder, row_of_job
from mercator_design.serve.jobs.running_race import NO_SPACE, RunningRace
from mercator_design.serve.jobs.scheduler import next_job
from mercator_design.serve.jobs.store import OUTPUT, Store
from mercator_design.serve.jobs.work import WorkStatus, is_at_work, status_of
from mercator_design.serve.settings import ServiceError, ServiceSettings

_log = logging.getLogger(__name__)

_PERIOD = 0.25
"""Seconds between two rounds."""
_READ_PERIOD = 1.0
"""Seconds between two reads of a race's journal."""
_SAVE_PERIOD = 60.0
"""Seconds between two saves of a job's run time."""
_GRACE = 30.0
"""Time limit of a process after SIGTERM [s]; then it is killed."""
_RETRY = 5.0
"""Minimum waiting time before a retry [s]."""
_OTHERS = 3.0
"""Seconds between two looks at run folders that processes of others may run."""
_MB = 1_000_000


class _FolderState(NamedTuple):
    """State of a run folder's journal; it changes while the race goes on."""

    inode: int  # of the journal
    length: int
    is_locked: bool


class Supervisor:
    """Supervisor of the processes of races; keeps the index up to date."""

    def __init__(
        self,
        store: Store,
        index: Index,
        settings: ServiceSettings,
        launch: Callable[[Job], RaceProcess],
        *,
        clock: Callable[[], float] = time.monotonic,
        free: Callable[[], int] | None = None,
    ) -> None:
        self._store, self._index, self._settings = store, index, settings
        self._launch, self._clock = launch, clock
        self._free = free or (lambda: shutil.disk_usage(store.data).free)
        self._runs: dict[str, RunningRace] = {}
        self._held: dict[str, tuple[str, float]] = {}  # jobs that wait: for what, and until when at least
        self._deaths: dict[str, tuple[int, int]] = {}  # by job: deaths without progress, experiments at the last one
        self._served: dict[str, int] = {}
        # Run folders of no job, with what was read of those that run.
        self._others: dict[str, tuple[_FolderState, Reading | None]] = {}
        self._followed: dict[str, WorkStatus] = {}  # jobs that processes of others run
        self._looked = -math.inf  # when the run folders of others were looked at
        self._is_disk_low = False
        self._problems: dict[str, str] = {}  # that are logged already
        self.lock = threading.RLock()  # for all changes of jobs
        self._wake = threading.Event()
        self._is_stopping = False
        self._thread: threading.Thread | None = None

    @property
    def shortage(self) -> str:
        """Reason for which all jobs wait; empty if they can run."""
        return f"waits until {self._settings.limits.free_disk} MB are free on the disk" if self._is_disk_low else ""

    @property
    def is_alive(self) -> bool:
        """Whether its thread works."""
        return self._thread is not None and self._thread.is_alive() and not self._is_stopping

    def start(self) -> None:
        """Make the index agree with the data folder, and begin to run jobs."""
        self.reconcile()
        self._thread = threading.Thread(target=self._loop, name="supervisor", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop all races and wait for their end; they can be resumed."""
        self._is_stopping = True
        self._wake.set()
        if self._thread is not None:
            self._thread.join()

    def wake(self) -> None:
        """Start a round now."""
        self._wake.set()

    def reconcile(self) -> None:
        """Make the index agree with the data folder: new, changed and vanished jobs and run folders."""
        with self.lock:
            known = {row.id: row for row in self._index.all() if row.is_job}
            ids = self._store.ids()
            self._index.remove(*(known.keys() - {*ids}))
            for identity in ids:
                with self._logging_errors(identity):
                    row = known.get(identity)
                    if row is None or row.state not in ENDED or row.job != self._store.read(identity):
                        self.refresh(identity)
            self._look_at_others()

    def refresh(self, identity: str) -> IndexRow | None:
        """Update the row of a job from its files; None if the job was deleted."""
        with self.lock:
            if not self._store.file(identity).exists():
                self._index.remove(identity)
                return None
            try:
                job = self._store.read(identity)
            except ServiceError as error:
                return self._damaged(identity, error)
            folder, run, problem = self._store.run_folder(identity), self._runs.get(identity), ""
            followed = self._followed.pop(identity, None) if run is None else run.status
            status = followed or status_of(job.request, folder)
            try:
                status.read_on()
            except (RaceError, StudyError) as error:
                problem = self._store.without_data_folder(error.messages[0])
            is_running = run is not None or is_at_work(job.request, folder)
            if run is None and is_running and not problem:
                self._followed[identity] = status
            return self._put_row(row_of_job(job, status, problem, is_running=is_running), job)

    def refresh_from_file(self, identity: str) -> IndexRow | None:
        """Update the row of a job from its changed file, without reading the journal, which may be long."""
        with self.lock:
            row, run = self._index.get(identity), self._runs.get(identity)
            if row is None or (row.state == "running" and run is None):
                return self.refresh(identity)
            job = self._store.read(identity)
            is_running = run is not None or is_at_work(job.request, self._store.run_folder(identity))
            return self._put_row(changed_row(row, job, is_running=is_running), job)

    def _put_row(self, row: IndexRow, job: Job) -> IndexRow:
        """Put the row of a job into the index, with the state of its process."""
        if (run := self._runs.get(job.id)) is not None:
            run.job = job
            clock = self._clock()
            row = replace(row, job=run.job_at(clock), message=run.message, left=run.left(clock))
        elif row.state == "queued" and job.id in self._held:
            row = replace(row, state="paused", message=self._held[job.id][0])
        elif row.state == "queued":
            row = replace(row, message=self.shortage)
        self._index.put(row)
        return row

    def _damaged(self, identity: str, error: ServiceError) -> IndexRow | None:
        """The row of a job whose file is damaged; None if its owner is not known."""
        _log.error("%s", error)
        row = self._index.get(identity)
        if row is not None:
            row = self._index.change(identity, state="failed", message="the file of this job is damaged")
        return row

    @contextlib.contextmanager
    def _logging_errors(self, identity: str) -> Iterator[None]:
        """Log an error of a job once, and suppress it; the next round tries again."""
        try:
            yield
        except (OSError, MercatorError, sqlite3.Error, KeyError) as error:  # for example, the disk is full
            if self._problems.get(identity) != str(error):
                self._problems[identity] = str(error)
                _log.error("job %s: %s", identity, described(error))
        else:
            self._problems.pop(identity, None)

    def _loop(self) -> None:
        while not (self._is_stopping and not self._runs):
            self._wake.wait(_PERIOD)
            self._wake.clear()
            try:
                with self._logging_errors("*"):
                    self.tick()
            except Exception:  # noqa: BLE001 - a fault of this program: what runs must still be followed and stopped
                _log.exception("jobs")
                time.sleep(_PERIOD)

    def tick(self) -> None:
        """One round: follow running races, and start queued ones."""
        with self.lock:
            self._check_space()
            for run in [*self._runs.values()]:
                with self._logging_errors(run.job.id):
                    self._follow(run)
            if self._is_stopping:
                return
            if not self._is_disk_low:
                for identity in [one for one, (_, until) in self._held.items() if self._clock() >= until]:
                    del self._held[identity]
                    self.refresh(identity)
                self._start_queued()
            if self._clock() - self._looked >= _OTHERS:
                self._look_at_others()

    def _check_space(self) -> None:
        with self._logging_errors("free space"):
            before, self._is_disk_low = self._is_disk_low, self._free() < self._settings.limits.free_disk * _MB
            if before != self._is_disk_low:
                self._index.set_queued_message(self.shortage)

    def _follow(self, run: RunningRace) -> None:
        clock = self._clock()
        if (code := run.process.poll()) is not None:
            self._finish(run, code)
            return
        if self._is_stopping:
            run.stop("service", clock)
        elif self._is_disk_low:
            run.stop("disk", clock)
        if run.stopped_for and clock - run.stopped_at > _GRACE:
            run.process.kill()
        job = self._job_of(run)
        if job.wish != "run":
            run.stop("wish", clock)
        elif run.seconds(clock) - job.limit_from > self._settings.limits.hours * 3600:
            run.stop("time", clock)
        if clock - run.read_at >= _READ_PERIOD:
            run.read_at = clock
            self._note_progress(run, clock)

    def _job_of(self, run: RunningRace) -> Job:
        """The job of a running race; the last known one if its file is damaged."""
        with contextlib.suppress(ServiceError):
            run.job = self._store.read(run.job.id)
        return run.job

    def _note_progress(self, run: RunningRace, clock: float) -> None:
        run.read_on()
        found = figures_of(run.status)
        self._index.change(run.job.id, job=run.job_at(clock), left=run.left(clock), message=run.message, **found)
        if clock - run.unsaved_since >= _SAVE_PERIOD:
            run.job, run.unsaved_since = self._store.update(run.job.id, seconds=run.seconds(clock)), clock

    def _finish(self, run: RunningRace, code: int) -> None:
        identity = run.job.id
        job = self._job_of(run)
        run.status = status_of(job.request, run.status.folder)
        run.read_on()
        is_finished = run.status.is_finished(job.request.budget) and not run.is_interrupted(code)
        has_died = code < 0 and not run.stopped_for  # else this service has killed it
        deaths = self._deaths_of(run) if has_died else (0, -1)
        held = "" if is_finished else run.reason_to_wait(code, self.shortage)
        failure = "" if is_finished or held else run.failure(code, deaths[0], self._settings.limits.hours)
        ended = now() if is_finished or failure or job.wish == "cancel" else ""
        try:
            self._store.update(identity, seconds=run.seconds(self._clock()), failure=failure, ended=ended)
        except ServiceError as error:  # its file is damaged: its row will say so
            _log.error("%s", error)
        except OSError:
            if not self._is_stopping:  # the disk is full: this is tried again, and the job waits until then
                self._index.change(identity, state="paused", message=self.shortage or NO_SPACE)
                raise
        del self._runs[identity]
        self._deaths.pop(identity, None)
        if held:
            self._held[identity] = held, self._clock() + _RETRY
        elif has_died and not failure:
            self._deaths[identity] = deaths
        row = self.refresh(identity)
        _log.info("job %s: %s (its process ended with code %d)", identity, row.state if row else "gone", code)

    def _deaths_of(self, run: RunningRace) -> tuple[int, int]:
        """Number of deaths of a job's processes without progress, and of its experiments at the last one."""
        done = run.status.n_experiments
        deaths, before = self._deaths.get(run.job.id, (0, -1))
        return (deaths + 1 if done == before else 1), done

    def _look_at_others(self) -> None:
        """Run folders of no job come, grow and go; jobs may run in processes of a service that was killed."""
        self._looked = self._clock()
        found = {path.name: path for path in self._store.others()}
        self._index.remove(*(row.id for row in self._index.of_no_job() if row.id not in found))
        self._others = {name: one for name, one in self._others.items() if name in found}
        for name, path in found.items():
            with self._logging_errors(name):
                journal = path / JOURNAL
                file = journal.stat()
                state = _FolderState(file.st_ino, file.st_size, is_locked(journal))
                before, reading = self._others.get(name, (None, None))
                if state == before:
                    continue
                if reading is None or before is None or before.inode != state.inode or state.length < reading.length:
                    reading = Reading(journal)
                if (row := row_of_folder(path, reading)) is not None:
                    self._index.put(replace(row, message=self._store.without_data_folder(row.message)))
                is_running = row is not None and row.state == "running"
                self._others[name] = state, reading if is_running else None
        rows, _ = self._index.find(None, states=("running",), limit=-1)
        for row in rows:
            if row.is_job and row.id not in self._runs:
                self.refresh(row.id)

    def _start_queued(self) -> None:
        limits = self._settings.limits
        while len(self._runs) < self._settings.races:
            rows, _ = self._index.find(None, states=("queued",), descending=False, limit=-1)
            running = [row for row in map(self._index.get, self._runs) if row is not None]
            row = next_job(rows, running, self._served, limits.running)
            if row is None or not self._start_job(row.id):
                return

    def _start_job(self, identity: str) -> bool:
        """Start the process of a queued job; return whether to look for another job."""
        row = self.refresh(identity)
        if row is None or row.state != "queued":  # for example, another process runs it, or its file is damaged
            return True
        job = self._store.read(identity)
        try:
            process = self._launch(job)
        except OSError as error:
            _log.error("job %s: its process cannot be started: %s", identity, error)
            self._held[identity] = f"its process cannot be started: {error.strerror or error}", self._clock() + _RETRY
            self.refresh(identity)
            return False
        self._served[job.owner] = max(self._served.values(), default=-1) + 1
        self._runs[identity] = RunningRace(
            job=job,
            process=process,
            status=status_of(job.request, self._store.run_folder(identity)),
            output=self._store.folder(identity) / OUTPUT,
            unsaved_since=self._clock(),
            budget=job.request.budget,
            n_before=row.experiments,
        )
        self.refresh(identity)
        _log.info("job %s: started", identity)
        return True
