"""A race's record in a file that survives whatever stops the race.

A file has an event a line, as JSON, and is only ever appended to. Each line ends in its checksum, which covers the
checksum of the line before ("after"): so damage is found, be it a line that is missing, changed, doubled or out of
order. It is no seal: who edits a journal can compute the checksums anew. Then a line that is there twice is found (but
for sessions and stops), and one that is missing where numbers have no gaps: configurations, iterations, and the
experiments of iterations that have ended. Found by nothing are changed scores (but by the digest, of a race that has
ended), and missing lines of what is run again: tests, experiments ahead or of the last iteration, the end. The lines of
format 1 have no "after"; such a journal is read, and continued, as it is, and may repeat itself. Events:

    start          what makes the race: digests of all that it depends on, seed, budget, options
    session        a process that began to work on it: its number, host, time, executor
    configuration  one that is raced from now on: its number, its parent's, its values
    experiment     one that has finished, in the order in which they do
    ahead          an experiment that has finished before the race asked for it, and perhaps will not
    revised        a score that has replaced another one, as an evaluator has compared configurations anew
    iteration      one that has ended, for people who look at the journal
    test           an experiment on a test instance, which the race never sees
    extend         a larger budget, which counts from where the one before has ended
    end            where the race ended under a budget, its winner, and the digest of all up to there
    stop           a process that ended before the race did, and why
"""

import contextlib
import errno
import fcntl
import os
import socket
import time
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from mercator_design.config.checked_lines import checksum, from_line, to_line
from mercator_design.errors import RaceError, excerpt
from mercator_design.race.running.events import Event, RaceEnded, SessionStarted, SessionStopped, event_of, to_json
from mercator_design.race.running.record import Record
from mercator_design.system.files import sync_folder

SYNC_EVERY = 1.0
"""Seconds after which what was written is forced to the disk: as much is lost when the power is."""
_FIRST = "0" * 8
"""What the first line has as the checksum of the line before."""


@dataclass(frozen=True, slots=True)
class Reading:
    """What there is in a journal's file."""

    record: Record
    length: int  # of its whole lines [bytes]
    lines: int  # that are whole
    torn: str  # what is wrong with what comes after them, if anything does
    last: str  # checksum of the last whole line


def read(path: Path) -> Reading:
    """A journal's file as it is; others may be writing it.

    Raises:
        RaceError: It cannot be read, or is corrupt before its end: with the line.
    """
    record, length, lines, torn, before = Record(), 0, 0, "", _FIRST
    try:
        if path.exists() and not path.is_file():  # opening a pipe would wait
            raise RaceError(f"{path}: expected a regular file, found a folder, device or pipe")
        with path.open("rb") as file:
            for number, line in enumerate(file, start=1):
                try:
                    data = from_line(line)
                except ValueError as error:
                    torn = torn or f"line {number}: {error}"
                    continue
                if torn:  # a whole line after it
                    raise RaceError(f"{path}, {torn}; {_advice(lines)}")
                try:
                    _take(record, data, before)
                except RaceError as error:
                    raise RaceError(f"{path}, line {number}: {error}; {_advice(lines)}") from None
                length += len(line)
                lines, before = number, checksum(line)
    except OSError as error:
        raise RaceError(f"{path}: cannot be read: {error.strerror or error}") from None
    for place, end in enumerate(record.ends, start=1):
        if (found := record.digest(place)) != end.digest:
            expected = f"expected {end.digest}, found {found}"
            raise RaceError(f"{path}: digest of the first {end.experiments} experiments: {expected}")
    return Reading(record, length, lines, torn, before)


def _advice(lines: int) -> str:
    """What to do where so many lines are whole, and others after them are not."""
    advice = "the journal was damaged or changed after it was written"
    if lines:
        advice += f". Lines 1 to {lines} are whole: delete those after them to run again what they were about"
    return advice


def _take(record: Record, data: dict[str, Any], before: str) -> None:
    """Take in the data of a line."""
    is_start = data.get("event") == "start"
    if (data if is_start else record.start).get("format") != 1:
        after = data.pop("after", None)
        if after != before:
            raise RaceError(
                f"expected a line that was written after one with the checksum {before}, found {excerpt(str(after))}: "
                "lines are missing, were added, or are out of order"
            )
    if is_start:
        del data["event"]
        record.begin(data)
    else:
        record.note(event_of(data))


class Journal:
    """A record and the file that it is kept in; a context manager that closes the file.

    One process at a time has it: it is locked, and the lock goes with the process, however that ends.

    Attributes:
        path: Of the file.
        record: What is in it.
        notes: What a user should know.
    """

    def __init__(self, path: Path, *, new: bool) -> None:
        """Open a new or an old one.

        Raises:
            RaceError: Another process has it, or it is corrupt.
            OSError: It cannot be opened.
        """
        self.path = path
        self.record = Record()
        self.notes: list[str] = []
        self._file = os.open(
            path, os.O_RDWR | os.O_APPEND | os.O_CLOEXEC | (os.O_CREAT | os.O_EXCL if new else 0), 0o666
        )
        self._length = 0
        self._last = _FIRST
        self._synced = time.monotonic()
        try:
            self._lock()
            if not new:
                self._resume()
            else:
                sync_folder(self.path.parent)
        except BaseException:
            os.close(self._file)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        with contextlib.suppress(OSError, RaceError):  # what went wrong before matters more
            if kind is not None:
                self.note(SessionStopped(why=kind.__name__, time=now()))
            self.sync()
        os.close(self._file)

    def open_session(self, executor: str = "", jobs: int = 0) -> None:
        """Note that this process begins to work on the race.

        Args:
            executor: What runs experiments.
            jobs: How many at once.
        """
        host = socket.gethostname()
        self.note(SessionStarted(process=os.getpid(), host=host, time=now(), executor=executor, jobs=jobs))

    def begin(self, start: Mapping[str, Any]) -> None:
        """As `Record.begin`; the start is appended to the file.

        Raises:
            RaceError: As there, or it cannot be written.
        """
        self.record.begin(start)
        self._append({"event": "start", **self.record.start})

    def note(self, *events: Event) -> None:
        """Take in events and append them to the file, whole or not at all.

        Raises:
            RaceError: One does not fit to those before, or they cannot be written.
        """
        self.record.note(*events)
        self._append(*map(to_json, events))

    def note_end(self, end: RaceEnded) -> None:
        """As `Record.note_end`, appended to the file.

        Raises:
            RaceError: As `note`.
        """
        self.note(self.record.with_digest(end))

    def sync(self) -> None:
        """Force what was written to the disk."""
        os.fsync(self._file)
        self._synced = time.monotonic()

    def _append(self, *lines: dict[str, Any]) -> None:
        is_chained, last, texts = self.record.start["format"] != 1, self._last, []
        for line in lines:
            if is_chained:
                line["after"] = last
            texts.append(to_line(line))
            last = checksum(texts[-1])
        self._write("".join(texts).encode(), last)

    def _write(self, data: bytes, last: str) -> None:
        try:
            if os.write(self._file, data) != len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))  # noqa: TRY301 - as if it had said so
            self._length += len(data)
            self._last = last  # also if they cannot be forced to the disk: the next line comes after them
            if time.monotonic() - self._synced > SYNC_EVERY:
                self.sync()
        except OSError as error:
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self._length)
            raise RaceError(
                f"{self.path.parent}: cannot write results there: {error.strerror}; what finished before is in "
                f"{self.path.name}, and the race can be resumed when there is room"
            ) from None

    def _lock(self) -> None:
        try:
            for _ in range(10):  # whoever looks whether it is locked has it for a moment
                with contextlib.suppress(BlockingIOError):
                    fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    return
                time.sleep(0.02)
            raise RaceError(f"{self.path.parent}: {_holder(self.path)} is running this race")
        except OSError as error:  # some network file systems have no locks
            self.notes.append(
                f"{self.path.parent}: this file system has no locks ({error.strerror}): "
                "see to it that no other process runs this race"
            )

    def _resume(self) -> None:
        reading = read(self.path)
        self.record, self._length, self._last = reading.record, reading.length, reading.last
        if reading.torn:
            self.notes.append(f"{self.path}, {reading.torn}: cut off there; what it was about is run again")
            os.ftruncate(self._file, reading.length)
            self.sync()


def is_locked(path: Path) -> bool:
    """Whether a process has a journal."""
    try:
        file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    else:
        return False
    finally:
        os.close(file)


def now() -> str:
    """The time, for people."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def _holder(path: Path) -> str:
    """Who has a journal, as far as it says so."""
    with contextlib.suppress(RaceError):
        sessions = read(path).record.sessions
        if sessions and isinstance(last := sessions[-1], SessionStarted):
            return f"process {last.process} on {last.host}"
    return "another process"
