"""The accounts of a service: its users, their sessions, failed attempts, event streams, and the audit log."""

import asyncio
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from mercator_design.serve.accounts import audit, sessions
from mercator_design.serve.accounts.attempts import Attempts
from mercator_design.serve.accounts.audit import Audit
from mercator_design.serve.accounts.refusals import Refusal
from mercator_design.serve.accounts.sessions import Sessions
from mercator_design.serve.accounts.users import Holder, Users
from mercator_design.serve.settings import SERVICE


class TooManyFailures(Refusal):
    """An address has failed to log in too often: it has to wait."""

    def __init__(self, seconds: float) -> None:
        wrong = "too many failed attempts to log in from this address: wait a minute"
        super().__init__(429, "Too many attempts", wrong, {"Retry-After": str(int(seconds) + 1)})


class Accounts:
    """All that the service knows of those who use it; safe for several threads.

    Args:
        data: The data folder.
        now: The time.
        clock: Seconds that have passed since some time.

    Attributes:
        attempts: Failed attempts to log in.
        noise: Other refused changes of unknown senders, which the audit log has.
        answers: The number of answers by their status.
        streams: The number of open event streams by the name of the user.

    Raises:
        OSError, sqlite3.Error: The files in the data folder cannot be made.
    """

    def __init__(
        self,
        data: Path,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.users = Users(data, now)
        self.sessions = Sessions(data / SERVICE / sessions.FILE, now)
        self.audit = Audit(data / SERVICE / audit.FILE, now)
        self.attempts = Attempts(clock)
        self.noise = Attempts(clock)
        self.answers: Counter[int] = Counter()
        self.streams: Counter[str] = Counter()
        self._ends: set[asyncio.Event] = set()
        self._verifier = ThreadPoolExecutor(1, "verifier")  # scrypt is slow on purpose: one at a time

    def close(self) -> None:
        self._verifier.shutdown(cancel_futures=True)
        self.sessions.close()
        self.audit.close()

    @contextmanager
    def streaming(self, name: str, ended: asyncio.Event) -> Iterator[None]:
        """Count an event stream of a user while it is open; the event is set when it has to end."""
        self.streams[name] += 1
        self._ends.add(ended)
        try:
            yield
        finally:
            self._ends.discard(ended)
            self.streams -= Counter([name])

    def end_streams(self) -> None:
        """End all event streams, because the service ends."""
        for ended in self._ends:
            ended.set()

    async def holder_of_token(self, text: str, address: str) -> Holder | None:
        """Whose token an address shows; None if it is not valid, which counts as a failed attempt.

        Raises:
            TooManyFailures: The address has to wait; tokens that it has shown before are still accepted.
            ServiceError: The file of users is not valid.
        """
        holder = self.users.verified(text)
        if holder is not None:
            return holder
        self.check_attempts(address)
        return await asyncio.get_running_loop().run_in_executor(self._verifier, self._try, text, address)

    def _try(self, text: str, address: str) -> Holder | None:
        """Verify a token, one after the other: of many that come at once, each finds the failures before it."""
        if (holder := self.users.verified(text)) is not None:
            return holder
        self.check_attempts(address)
        if (holder := self.users.verify(text)) is None:
            self.attempts.count(address)
        return holder

    def check_attempts(self, address: str) -> None:
        """Refuse an address with too many failed attempts.

        Raises:
            TooManyFailures: It has.
        """
        if seconds := self.attempts.wait(address):
            raise TooManyFailures(seconds)

    def holder_of_session(self, secret: str) -> Holder | None:
        """Whose session this is; None if it has ended, or its token was revoked or has expired.

        Raises:
            ServiceError: The file of users is not valid.
            sqlite3.Error: The file of sessions cannot be read.
        """
        token = self.sessions.token(secret)
        return None if token is None else self.users.holder(token)
