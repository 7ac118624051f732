"""The audit log: changes and failed logins, with their users; a line of JSON for each."""

import json
import logging
import os
from collections.abc import Callable
from datetime import datetime
from logging.handlers import RotatingFileHandler
from pathlib import Path
from typing import IO

from mercator_design.errors import printable

FILE = "audit.log"
_SIZE = 10_000_000  # bytes after which a new file is begun
_OLD = 9  # files that are kept
_MAX_TEXT = 300  # characters of a value

_log = logging.getLogger(__name__)


class AuditLog:
    """Writer of the audit log; safe for several threads.

    Args:
        file: The log; older ones are beside it, as audit.log.1.
        now: The time.
        size: Bytes after which a new file is begun; 0: never.
    """

    def __init__(self, file: Path, now: Callable[[], datetime], size: int = _SIZE) -> None:
        self._handler = _PrivateFile(file, maxBytes=size, backupCount=_OLD, encoding="ascii", delay=True)
        self._now = now

    def write(self, *, user: str, address: str, what: str, job: str, answer: int) -> None:
        """Write a line.

        Args:
            user: The name of the user; empty if it is not known.
            address: Address of the client, or the account on the machine.
            what: Method and path of the request, or the command.
            job: Id of the changed job; empty if there is none.
            answer: The status of the answer, or the exit code.
        """
        texts = {"user": user, "address": address, "what": what, "job": job}
        line = {"time": self._now().isoformat(timespec="milliseconds")}
        line |= {key: printable(text[:_MAX_TEXT]) for key, text in texts.items()}
        self._handler.handle(logging.makeLogRecord({"msg": json.dumps(line | {"answer": answer})}))

    def close(self) -> None:
        self._handler.close()


class _PrivateFile(RotatingFileHandler):
    """Log files that only their owner may read."""

    def _open(self) -> IO[str]:  # type: ignore[override]
        def private(path: str, flags: int) -> int:
            return os.open(path, flags | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)

        return open(self.baseFilename, self.mode, encoding=self.encoding, opener=private)

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - of logging
        """Report what cannot be written, for example because the disk is full; the service goes on."""
        _log.exception("audit: this line cannot be written: %s", record.getMessage())
