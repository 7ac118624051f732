"""Workers that compile say so while they do it; those that begin at about the same time share a line."""

import contextlib
import threading
from collections.abc import Callable, Iterator

from mercator_design import jit

SETTLE = 2.0
"""Seconds from the first worker that compiles to the message, which counts all until then."""

_has_said = threading.Event()


def _later(seconds: float, function: Callable[[], None]) -> None:
    timer = threading.Timer(seconds, function)
    timer.daemon = True
    timer.start()


class CompilingWorkers:
    """Counts workers that compile, and announces how many they are.

    Args:
        announce: Called with the message, in another thread.
        later: Calls a function after some seconds.
    """

    def __init__(
        self, announce: Callable[[str], None], later: Callable[[float, Callable[[], None]], None] = _later
    ) -> None:
        self._announce, self._later = announce, later
        self._lock = threading.Lock()
        self._reasons: list[str] = []

    def add(self, reason: str) -> None:
        """Count a worker; `reason` says why what it compiles is lost when it ends, and is empty if it is kept."""
        with self._lock:
            self._reasons.append(reason)
            is_first = len(self._reasons) == 1
        if is_first:
            self._later(SETTLE, self._count_out)

    def _count_out(self) -> None:
        with self._lock:
            reasons, self._reasons = self._reasons, []
        n = len(reasons)
        lost = [reason for reason in reasons if reason]
        why = f"; for this run only, {len(lost)} of them: {lost[0]}" if lost else ""
        self._announce(f"{n} worker{'s' * (n != 1)} compile{'s' * (n == 1)}, which may take a minute{why}")


@contextlib.contextmanager
def noting(note: Callable[[str], None]) -> Iterator[None]:
    """In a worker: when this process first compiles, call `note` with the reason that `CompilingWorkers.add` takes."""

    def say() -> None:
        if not _has_said.is_set():
            _has_said.set()
            with contextlib.suppress(Exception):  # there may be nobody left to tell; the experiment goes on
                note(jit.cache_warning())

    with jit.announced(say):
        yield
