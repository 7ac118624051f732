"""The cache of page parts that workers compute, shared by all readers of a job."""

import threading
import time
from collections import Counter, OrderedDict
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from mercator_design.errors import MercatorError
from mercator_design.race.session.journal import is_locked
from mercator_design.results.analysis.comparison import COMPARISON
from mercator_design.results.files import JOURNAL
from mercator_design.results.provenance import PROVENANCE
from mercator_design.serve.jobs.races import length_of
from mercator_design.serve.workers.pool import CURRENT_USER, Busy, WorkerPool
from mercator_design.serve.workers.races import PagePart

_PERIOD = 2.0
"""Minimum time between two computations of a part [s]."""
_SHARE = 0.2  # of the time that a worker may spend on one part
_MAX_WAIT = 20.0  # seconds between two computations
_MAX_KEPT = 200  # parts that are kept


class FolderState(NamedTuple):
    """State of the folder of a job.

    length: That of the journal, or another number that grows while the job runs.
    turns: What changes seldom; a change shows at once.
    """

    length: int
    turns: tuple[object, ...]


@dataclass(slots=True)
class _Entry:
    is_alive: bool = False  # whether it is being computed
    part: PagePart | None = None  # the latest
    problem: MercatorError | None = None  # why there is no newer one
    state: FolderState | None = None  # of the folder, as the part shows it
    again: float = 0.0  # from when on it may be computed again


class PartCache:
    """Cache of page parts; safe for several threads.

    A part is computed again only after a change of the run folder, by one request at a time, and during a race only so
    often that it takes a small share of a worker's time. All other requests get the latest part at once.

    Args:
        pool: Workers that compute the parts.
        workers: Number of workers; a user has at most half of them at a time.
        clock: Monotonic time [s].
    """

    def __init__(self, pool: WorkerPool, workers: int, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._pool, self._clock = pool, clock
        self._entries: OrderedDict[tuple[str, str], _Entry] = OrderedDict()
        self._lock = threading.Lock()
        self._max_of_user, self._at_work = max(1, workers // 2), Counter[str]()  # computations of a user at a time

    def get(
        self, make: Callable[[Path], PagePart], folder: Path, state: FolderState | None = None
    ) -> tuple[PagePart | None, bool]:
        """A part of a job's page, or None if it is being computed, and whether it is up to date.

        Args:
            make: Function of `workers/races.py` or `workers/studies.py` that computes it.
            folder: The folder of the job.
            state: That of the folder; by default that of a run folder.

        Raises:
            MercatorError: It cannot be computed.
        """
        entry, state = self._entry((make.__name__, folder.name)), state or _state(folder)
        is_same = entry.state == state
        if is_same or (entry.state is not None and entry.state.turns == state.turns and self._clock() < entry.again):
            if entry.problem is not None:
                raise copy(entry.problem)  # each raising adds to the traceback of an error
            return entry.part, is_same
        user = CURRENT_USER.get()
        if not self._begin(entry, user):
            return entry.part, False
        try:
            begin = self._clock()
            entry.problem = None
            try:
                entry.part = self._pool.run(make, folder.resolve())
            except Busy:
                return entry.part, False
            except MercatorError as error:
                entry.problem = error
            entry.state = state
            entry.again = self._clock() + min(_MAX_WAIT, max(_PERIOD, (self._clock() - begin) / _SHARE))
            if entry.problem is not None:
                raise copy(entry.problem)
            return entry.part, True
        finally:
            with self._lock:
                self._at_work[user] -= 1
                entry.is_alive = False

    def _begin(self, entry: _Entry, user: str) -> bool:
        """Begin a computation, unless this part has one or the user too many; return whether it has begun."""
        with self._lock:
            if entry.is_alive or self._at_work[user] >= self._max_of_user:
                return False
            entry.is_alive = True
            self._at_work[user] += 1
            return True

    def _entry(self, key: tuple[str, str]) -> _Entry:
        with self._lock:
            entry = self._entries.setdefault(key, _Entry())
            self._entries.move_to_end(key)
            while len(self._entries) > _MAX_KEPT:
                self._entries.popitem(last=False)
            return entry


def _state(folder: Path) -> FolderState:
    turns: list[object] = [is_locked(folder / JOURNAL)]
    for name in (PROVENANCE, COMPARISON):
        try:
            status = (folder / name).stat()
            turns.append((status.st_ino, status.st_size, status.st_mtime_ns))
        except OSError:
            turns.append(None)
    return FolderState(length_of(folder / JOURNAL), tuple(turns))
