"""Runs the races of jobs: starts them in turn, follows, pauses and ends them; and starts them again after a crash.

All that a job is follows from its file and its run folder, so the service may be killed at any time.
"""

import logging
import shutil
import sqlite3
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from mercator_design.errors import MercatorError, RaceError
from mercator_design.race.running.journal import is_locked, now
from mercator_design.runs.files import JOURNAL
from mercator_design.serve.jobs.index import Index, Row
from mercator_design.serve.jobs.job import ENDED, Job, state_of
from mercator_design.serve.jobs.processes import RaceProcess, last_error
from mercator_design.serve.jobs.races import RaceStatus
from mercator_design.serve.jobs.scheduler import next_job
from mercator_design.serve.jobs.store import OUTPUT, Store
from mercator_design.serve.settings import ServiceError, Settings

_log = logging.getLogger(__name__)

_PERIOD = 0.25
"""Seconds between two looks at the processes."""
_GRACE = 30.0
"""Seconds after which a process that was asked to stop is killed."""
_MAX_DEATHS = 3
"""Deaths of a job's process without progress after which the job fails."""
_INTERRUPTED = (75, 130)
"""Exit codes of a race that can be resumed."""
_FULL = "No space left on device"
_MB = 1_000_000

Why: TypeAlias = Literal["", "wish", "disk", "time", "service"]


@dataclass(slots=True)
class _Run:
    """A race that a process of ours runs."""

    job: Job
    process: RaceProcess
    status: RaceStatus
    started: float
    stopped_for: Why = ""
    stopped_at: float = 0.0

    def stop(self, why: Why, clock: float) -> None:
        if not self.stopped_for:
            self.stopped_for, self.stopped_at = why, clock
            self.process.interrupt()


class Supervisor:
    """Runs the races of jobs in processes.

    Args:
        store: The jobs.
        index: Their rows, which the supervisor keeps up to date.
        settings: Of the service.
        launch: Starts the process of a job.
        clock: Seconds that have passed since some time.
        free: Free bytes for the data.
    """

    def __init__(
        self,
        store: Store,
        index: Index,
        settings: Settings,
        launch: Callable[[Job], RaceProcess],
        *,
        clock: Callable[[], float] = time.monotonic,
        free: Callable[[], int] | None = None,
    ) -> None:
        self._store, self._index, self._settings = store, index, settings
        self._launch, self._clock = launch, clock
        self._free = free or (lambda: shutil.disk_usage(store.data).free)
        self._runs: dict[str, _Run] = {}
        self._held: dict[str, str] = {}  # jobs that wait, and for what
        self._deaths: dict[str, tuple[int, int]] = {}  # by job: deaths without progress, experiments at the last one
        self._served: dict[str, int] = {}
        self._lock = threading.RLock()
        self._wake = threading.Event()
        self._is_stopping = False
        self._thread: threading.Thread | None = None

    @property
    def locked(self) -> threading.RLock:
        """The lock of all changes of jobs."""
        return self._lock

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
        """Look at the jobs now: something has changed."""
        self._wake.set()

    def reconcile(self) -> None:
        """Make the index agree with the data folder: new, changed and vanished jobs and run folders."""
        known = {row.id: row for row in self._index.all()}
        ids, others = self._store.ids(), [path.name for path in self._store.others()]
        self._index.remove(*(known.keys() - {*ids, *others}))
        for identity in [*ids, *others]:
            row = known.get(identity)
            if row is None or row.state not in ENDED:
                self.refresh(identity)

    def refresh(self, identity: str) -> Row | None:
        """Make the row of a job or run folder agree with its files; None if it is gone."""
        with self._lock:
            try:
                job = self._store.read(identity) if self._store.folder(identity).exists() else None
            except ServiceError as error:
                _log.error("%s", error)
                return None
            folder = self._store.run_folder(identity)
            status, message = RaceStatus(folder), ""
            try:
                status.read_on()
            except RaceError as error:
                message = error.messages[0]
            row = self._row(identity, job, status, message)
            if row is None:
                self._index.remove(identity)
            else:
                self._index.put(row)
            return row

    def _row(self, identity: str, job: Job | None, status: RaceStatus, problem: str) -> Row | None:
        record = status.record
        start, journal = record.start, status.folder / JOURNAL
        is_running = identity in self._runs or is_locked(journal)
        raced: dict[str, Any] = {"experiments": len(record.experiments), "best": status.best, "tested": status.tested}
        if job is None:
            if not start and not problem:
                return None
            is_finished = record.is_complete if start else False
            began = record.sessions[0].time if record.sessions else ""
            return Row(
                id=identity, owner="", name=str(start.get("name", identity)), method=str(start.get("method", "")),
                flavour=str(start.get("flavour") or ""), seed=int(start.get("seed", 0)), submitted=began,
                state="running" if is_running else "succeeded" if is_finished else "failed" if problem else "paused",
                message=problem, budget=record.budget if start else 0, direction=_direction(status), **raced,
            )  # fmt: skip
        request = job.request
        state = state_of(job, is_finished=status.is_finished(request.budget), is_running=is_running)
        message = job.failure or problem
        if state == "queued" and (held := self._held.get(identity)):
            state, message = "paused", held
        if problem and state == "queued":
            state = "failed"
        return Row(
            id=identity, owner=job.owner, name=job.name, state=state, message="" if state == "succeeded" else message,
            method=request.method, flavour=request.flavour, seed=request.seed, budget=request.budget,
            priority=request.priority, direction=job.direction, submitted=job.submitted, ended=job.ended,
            seconds=job.seconds, shared=job.shared, key=job.key, **raced,
        )  # fmt: skip

    def _loop(self) -> None:
        while not (self._is_stopping and not self._runs):
            self._wake.wait(_PERIOD)
            self._wake.clear()
            try:
                self.tick()
            except (OSError, MercatorError, sqlite3.Error) as error:  # for example, the disk is full: try again
                _log.error("jobs: %s", error)
                time.sleep(_PERIOD)

    def tick(self) -> None:
        """One round: look at what runs, and start what can."""
        with self._lock:
            is_short = self._free() < self._settings.limits.free_disk * _MB
            for run in [*self._runs.values()]:
                self._look_at(run, is_short=is_short)
            if is_short or self._is_stopping:
                return
            for identity in [*self._held]:
                del self._held[identity]
                self.refresh(identity)
            self._start_queued()

    def _look_at(self, run: _Run, *, is_short: bool) -> None:
        clock = self._clock()
        if (code := run.process.poll()) is not None:
            self._end(run, code)
            return
        job = run.job = self._store.read(run.job.id)
        seconds = job.seconds + clock - run.started
        message = {"wish": f"stopping, to {job.wish}", "disk": "stopping: the disk is nearly full"}
        try:
            run.status.read_on()
        except RaceError as error:  # the race itself reports it
            _log.warning("%s", error)
        self._index.change(
            job.id,
            experiments=len(run.status.record.experiments),
            best=run.status.best,
            seconds=seconds,
            message=message.get(run.stopped_for, ""),
        )
        if self._is_stopping:
            run.stop("service", clock)
        elif job.wish != "run":
            run.stop("wish", clock)
        elif is_short:
            run.stop("disk", clock)
        elif seconds > self._settings.limits.hours * 3600:
            run.stop("time", clock)
        if run.stopped_for and clock - run.stopped_at > _GRACE:
            run.process.kill()

    def _end(self, run: _Run, code: int) -> None:
        """Note the end of a process."""
        job = run.job
        run.status = RaceStatus(run.status.folder)
        try:
            run.status.read_on()
        except RaceError as error:
            _log.warning("%s", error)
        is_finished = run.status.is_finished(job.request.budget)
        failure = "" if is_finished else self._failure(run, code)
        job = self._store.update(job.id, seconds=round(job.seconds + self._clock() - run.started, 1), failure=failure)
        if is_finished or failure or job.wish == "cancel":
            job = self._store.update(job.id, ended=now())
        del self._runs[job.id]
        row = self.refresh(job.id)
        _log.info("job %s: its process ended with %d; %s", job.id, code, row.state if row else "gone")

    def _failure(self, run: _Run, code: int) -> str:
        """Why a job fails whose process has ended before its race; empty if it goes on."""
        limits, identity = self._settings.limits, run.job.id
        if run.stopped_for == "time":
            return f"it has run for {limits.hours:g} h, the limit of this service; resume it to go on"
        if run.stopped_for == "disk":
            self._held[identity] = f"waits until {limits.free_disk} MB are free on the disk"
        if run.stopped_for or code in _INTERRUPTED:
            return ""
        if code < 0:
            done = len(run.status.record.experiments)
            deaths, before = self._deaths.get(identity, (0, -1))
            deaths = deaths + 1 if done == before else 1
            self._deaths[identity] = deaths, done
            return f"its process was killed {deaths} times, by signal {-code}" if deaths >= _MAX_DEATHS else ""
        error = last_error(self._store.folder(identity) / OUTPUT) or f"its process ended with {code}"
        if _FULL in error:
            self._held[identity] = "waits until there is space on the disk"
            return ""
        return error

    def _start_queued(self) -> None:
        limits = self._settings.limits
        while len(self._runs) < self._settings.races:
            rows, _ = self._index.find(None, states=("queued",), descending=False, limit=-1)
            queued = [row for row in rows if row.id not in self._held]
            running = [row for row in map(self._index.get, self._runs) if row is not None]
            row = next_job(queued, running, self._served, limits.running)
            if row is None or not self._begin(row):
                return

    def _begin(self, row: Row) -> bool:
        """Start the process of a job; return whether another one may be looked for."""
        folder = self._store.run_folder(row.id)
        if is_locked(folder / JOURNAL):  # a process of the service before this one, or of a user
            self._held[row.id] = "waits for another process that runs this race"
            self.refresh(row.id)
            return True
        job = self._store.read(row.id)
        if job.wish != "run" or job.failure:
            self.refresh(row.id)
            return True
        try:
            process = self._launch(job)
        except OSError as error:
            _log.error("job %s: its process cannot be started: %s", row.id, error)
            return False
        self._served[job.owner] = max(self._served.values(), default=-1) + 1
        self._runs[job.id] = _Run(job, process, RaceStatus(folder), self._clock())
        self._index.change(job.id, state="running", message="")
        _log.info("job %s: started", job.id)
        return True


def _direction(status: RaceStatus) -> str:
    """Whether the scores of a run folder of no job are maximised."""
    from mercator_design.runs.files import task_of

    try:
        return "maximise" if task_of(status.folder).maximise else "minimise"
    except MercatorError:
        return "minimise"
