"""Operations of users on jobs: submit, pause, resume, cancel, extend, share, delete."""

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Any

from mercator_design.errors import MercatorError
from mercator_design.race.session.journal import now
from mercator_design.serve.jobs.index import Index, IndexRow
from mercator_design.serve.jobs.job import STATES, Job, Request, State, StudyRequest
from mercator_design.serve.jobs.store import Store, size_of
from mercator_design.serve.jobs.supervisor import Supervisor
from mercator_design.serve.jobs.work import is_at_work
from mercator_design.serve.settings import UserLimits

_OPEN: tuple[State, ...] = ("queued", "running", "paused")
_MB = 1_000_000


class NotPossible(MercatorError):  # noqa: N818 - the user's request is at odds with the state of the job
    """The operation is not possible in the state of the job."""


class LimitReached(MercatorError):  # noqa: N818 - nothing is wrong with the request
    """A limit of the service is reached."""


class Operations:
    """The operations on jobs."""

    def __init__(self, store: Store, index: Index, supervisor: Supervisor, limits: UserLimits) -> None:
        self._store, self._index, self._supervisor, self._limits = store, index, supervisor, limits

    def submit(self, owner: str, name: str, direction: str, request: Request, key: str = "") -> IndexRow:
        """A new job, whose mission or study has been checked; or the job that was submitted with the same key.

        Raises:
            NotPossible: The key was used for another request.
            LimitReached: see `Limits`.
            ServiceError: A value is not valid.
            OSError: It cannot be written.
        """
        with self._supervisor.lock:
            if key and (row := self._index.find_by_key(owner, key)) is not None:
                return self.resubmitted(row, request)
            for what, experiments in request.experiments.items():
                self._check_budget(experiments, what)
            self._check_number(owner)
            job = self._store.create(owner, name, direction, request, key=key)
            try:
                row = self._supervisor.refresh(job.id)
                assert row is not None  # noqa: S101 - its file was just written
            except BaseException:  # for example, the disk is full: the user will submit it again
                self._store.delete(job.id)
                raise
        self._supervisor.wake()
        return row

    def resubmitted(self, row: IndexRow, request: Request) -> IndexRow:
        """The job of an idempotency key that is used again.

        Raises:
            NotPossible: It was for another request.
        """
        if self._store.request(row.id) != request:
            raise NotPossible(f"the key {row.job.key} was used for another job: {row.id}")
        return row

    def check_disk(self, owner: str) -> None:
        """Check that a user's jobs leave space for one more.

        Raises:
            LimitReached: They do not.
        """
        rows, _ = self._index.find(None, owner=owner, limit=-1)
        used = sum(size_of(self._store.run_folder(row.id)) + size_of(self._store.folder(row.id)) for row in rows)
        if used > self._limits.disk * _MB:
            found = f"found {used / _MB:.0f} MB; delete some"
            raise LimitReached(f"expected the jobs of {owner} to have at most {self._limits.disk} MB, {found}")

    def pause(self, identity: str) -> IndexRow:
        """Stop a job until it is resumed.

        Raises:
            NotPossible: It has ended.
        """
        return self._change(identity, "pause", _OPEN, lambda _: {"wish": "pause"})

    def resume(self, identity: str) -> IndexRow:
        """Resume a job that was paused or has failed.

        Raises:
            NotPossible: It has ended otherwise.
            LimitReached: see `Limits`.
        """
        return self._change(identity, "resume", (*_OPEN, "failed"), _resumed, goes_on=True)

    def cancel(self, identity: str) -> IndexRow:
        """Stop a job for good; its results so far stay.

        Raises:
            NotPossible: It has ended otherwise.
        """
        states = (*_OPEN, "cancelled")
        return self._change(identity, "cancel", states, lambda job: {"wish": "cancel", "ended": job.ended or now()})

    def change(
        self, identity: str, *, budget: int | None = None, priority: int | None = None, shared: bool | None = None
    ) -> IndexRow:
        """Change a job: its budget, with which it goes on; its priority; whether all users may see it.

        Raises:
            NotPossible: With a budget: it was cancelled, the budget is not larger, or it is a study. Nothing changes.
            LimitReached: see `Limits`.
        """
        if budget is not None:
            self._check_budget(budget)

        def changes(job: Job) -> dict[str, Any]:
            request = job.request
            if priority is not None:
                request = replace(request, priority=priority)
            found: dict[str, Any] = {} if shared is None else {"shared": shared}
            if budget is not None:
                if isinstance(request, StudyRequest):
                    raise NotPossible(f"{identity}: the budgets of a study are in its file: submit another study")
                if budget <= request.budget:
                    raise NotPossible(f"{identity}: expected a budget above {request.budget}, found {budget}")
                request = replace(request, budget=budget)
                found |= _resumed(job)
            return {"request": request, **found}

        if budget is None:
            return self._change(identity, "change", STATES, changes)
        return self._change(identity, "extend", (*_OPEN, "finished", "failed"), changes, goes_on=True)

    def delete(self, identity: str) -> None:
        """Delete a job that does not run, with its run folder.

        Raises:
            NotPossible: It runs.
            OSError: It cannot be deleted.
        """
        with self._supervisor.lock:
            self._row_in_state(identity, "delete", ("queued", "paused", "finished", "failed", "cancelled"))
            job = self._store.read(identity)
            if is_at_work(job.request, self._store.run_folder(identity)):
                raise NotPossible(f"{identity}: cannot delete it: another process runs its {job.request.kind}")
            self._store.delete(identity)
            self._index.remove(identity)

    def _change(
        self,
        identity: str,
        what: str,
        states: Collection[State],
        changes: Callable[[Job], dict[str, Any]],
        *,
        goes_on: bool = False,
    ) -> IndexRow:
        """Change fields of a job that is in one of some states.

        Args:
            identity: Its id.
            what: The verb, for messages.
            states: The states in which this is possible.
            changes: The changed fields.
            goes_on: Whether the job goes on; the limits of its user have to permit it.
        """
        if goes_on:  # before the lock: measuring folders would keep other changes waiting
            self.check_disk(self._row_in_state(identity, what, states).job.owner)
        with self._supervisor.lock:
            row = self._row_in_state(identity, what, states)
            if goes_on and row.state not in _OPEN:
                self._check_number(row.job.owner)
            self._store.update(identity, **changes(self._store.read(identity)))
            changed = self._supervisor.refresh_from_file(identity)
        self._supervisor.wake()
        return changed or row

    def _check_number(self, owner: str) -> None:
        counts = self._index.counts(owner)
        if (n := sum(counts.get(state, 0) for state in _OPEN)) >= self._limits.jobs:
            raise LimitReached(f"expected at most {self._limits.jobs} jobs of {owner} that have not ended, found {n}")

    def _check_budget(self, experiments: int, key: str = "budget") -> None:
        if experiments > self._limits.budget:
            raise LimitReached(f"{key}: expected at most {self._limits.budget}, found {experiments}")

    def _row_in_state(self, identity: str, what: str, states: Collection[State]) -> IndexRow:
        row = self._index.get(identity)
        if row is None or not row.is_job:
            raise NotPossible(f"{identity}: cannot {what} it: it is not a job of this service")
        if row.state not in states:
            raise NotPossible(f"{identity}: cannot {what} a job that is {row.state}")
        return row


def _resumed(job: Job) -> dict[str, Any]:
    """Changed fields of a resumed job."""
    return {"wish": "run", "failure": "", "ended": "", "limit_from": job.seconds}
