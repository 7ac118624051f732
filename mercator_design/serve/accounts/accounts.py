"""The accounts of a service: users, their sessions and open requests, and the audit log."""

import asyncio
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from mercator_design.serve.accounts import audit, sessions
from mercator_design.serve.accounts.audit import AuditLog
from mercator_design.serve.accounts.audit_rate import AuditRateLimit
from mercator_design.serve.accounts.concurrency import ConcurrencyLimit
from mercator_design.serve.accounts.sessions import Sessions
from mercator_design.serve.accounts.users import Holder, Users
from mercator_design.serve.settings import SERVICE, UserLimits

MAX_REQUESTS, MAX_STREAMS = 800, 600
"""Maximum number of requests of all users at the same time, without event streams; of event streams."""


class Accounts:
    """Users, sessions, open requests and audit log of a service; safe for several threads.

    Args:
        data: The data folder.
        limits: Limits of a user.
        now: The time.
        clock: Monotonic time [s].

    Attributes:
        audit_rate: Lines of unknown senders in the audit log.
        answers: The number of answers by their status.
        requests: Limit of open requests, without event streams.
        streams: Limit of open event streams.

    Raises:
        OSError, sqlite3.Error: The files in the data folder cannot be made.
    """

    def __init__(
        self,
        data: Path,
        limits: UserLimits = UserLimits(),  # noqa: B008 - frozen
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.users = Users(data, now)
        self.sessions = Sessions(data / SERVICE / sessions.FILE, now)
        self.audit = AuditLog(data / SERVICE / audit.FILE, now)
        self.audit_rate = AuditRateLimit(clock)
        self.answers: Counter[int] = Counter()
        self.requests = ConcurrencyLimit("requests", limits.requests, MAX_REQUESTS)
        self.streams = ConcurrencyLimit("event streams", limits.streams, MAX_STREAMS)
        self._ends: set[asyncio.Event] = set()

    def close(self) -> None:
        self.sessions.close()
        self.audit.close()

    @contextmanager
    def streaming(self, name: str, ended: asyncio.Event) -> Iterator[None]:
        """Count an event stream of a user while it is open; the event is set when it has to end.

        Raises:
            Refusal: There are too many.
        """
        with self.streams.count(name):
            self._ends.add(ended)
            try:
                yield
            finally:
                self._ends.discard(ended)

    def end_streams(self) -> None:
        """End all event streams, because the service ends."""
        for ended in self._ends:
            ended.set()

    def holder_of_session(self, secret: str) -> Holder | None:
        """Holder of a session; None if it has ended, or its token was revoked or has expired.

        Raises:
            ServiceError: The file of users is not valid.
            sqlite3.Error: The file of sessions cannot be read.
        """
        token = self.sessions.token(secret)
        return None if token is None else self.users.holder(token)
