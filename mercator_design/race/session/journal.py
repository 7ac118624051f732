"""The journal: the record of a race in a file, which survives an interruption.

The file has one event per line, as JSON, and is only appended to. Each line ends in a checksum, which also covers the
checksum of the line before ("after"). So a missing, changed, duplicate or misplaced line is found. The checksums do not
protect against editing: an editor can compute them again. After that, duplicate lines are still found (except sessions
and stops), and so are missing configurations, iterations, and experiments of ended iterations, because their numbers
have no gaps. Not found are changed scores (except by the digest of a race that has ended) and missing lines of tests,
of speculative experiments, of experiments of the last iteration, and of the end: these are run again. Events:

    start          all that determines the race: digests of its inputs, seed, budget, options
    session        a process has begun to work on the race: its number, host, time, executor
    configuration  a new configuration: its number, its parent's number, its values
    experiment     an experiment has finished; in the order in which they finish
    ahead          a speculative experiment has finished
    revised        a score has been replaced, because an evaluator has compared configurations again
    iteration      an iteration has ended; for readers of the journal
    test           an experiment on a test instance, which does not influence the race
    extend         the budget has been extended, after the end under the budget before
    end            the race has ended under a budget: its winner, and the digest up to here
    stop           a process has ended before the race, and why
"""

import contextlib
import errno
import fcntl
import os
import socket
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

from mercator_design.config.checked_lines import checksum, from_line, to_line
from mercator_design.errors import RaceError, excerpt
from mercator_design.race.session.events import Event, SessionStarted, SessionStopped, event_of, to_json
from mercator_design.race.session.record import OtherVersion, Record
from mercator_design.system.files import sync_folder

SYNC_EVERY = 1.0
"""Seconds between two syncs to the disk: a loss of power loses at most as much."""
_FIRST = "0" * 8
"""The checksum of the line before the first one."""


@dataclass(slots=True)
class Reading:
    """The contents of a journal's file so far; `read_on` reads what another process has appended to it."""

    path: Path
    record: Record = field(default_factory=Record)
    length: int = 0  # of its complete lines [bytes]
    lines: int = 0  # number of complete lines
    torn: str = ""  # what is wrong with the rest of the file; empty if there is no rest
    last: str = _FIRST  # checksum of the last complete line

    def read_on(self, seen: Callable[[Event], object] | None = None) -> None:
        """Read further lines.

        Args:
            seen: Called with each new event but the start of the race, when it is in the record.

        Raises:
            OtherVersion: The file has another format.
            RaceError: The file cannot be read, or is corrupt before its end; with the line.
        """
        path, n_ends = self.path, len(self.record.ends)
        self.torn = ""
        try:
            if path.exists() and not path.is_file():  # opening a pipe would wait
                raise RaceError(f"{path}: expected a regular file, found a folder, device or pipe")
            with path.open("rb") as file:
                if file.seek(0, os.SEEK_END) < self.length:
                    raise RaceError(f"{path}: expected at least {self.length} bytes, as before, found fewer")
                file.seek(self.length)
                for number, line in enumerate(file, start=self.lines + 1):
                    try:
                        data = from_line(line)
                    except ValueError as error:
                        self.torn = self.torn or f"line {number}: {error}"
                        if line.endswith(b"\n"):
                            continue
                        break  # its process may write the rest at this moment, which would look like another line
                    if self.torn:  # this line is complete and comes after it
                        raise RaceError(f"{path}, {self.torn}; {_advice(self.lines)}")
                    try:
                        event = _take(self.record, data, self.last)
                    except OtherVersion as error:
                        raise OtherVersion(f"{path}, line {number}: {error}") from None
                    except RaceError as error:
                        raise RaceError(f"{path}, line {number}: {error}; {_advice(self.lines)}") from None
                    self.length += len(line)
                    self.lines, self.last = number, checksum(line)
                    if seen is not None and event is not None:
                        seen(event)
        except OSError as error:
            raise RaceError(f"{path}: cannot be read: {error.strerror or error}") from None
        for place, end in enumerate(self.record.ends[n_ends:], start=n_ends + 1):
            if (found := self.record.digest(place)) != end.digest:
                expected = f"expected {end.digest}, found {found}"
                raise RaceError(f"{path}: digest of the first {end.experiments} experiments: {expected}")


def read(path: Path) -> Reading:
    """Read a journal's file, which another process may be writing.

    Raises:
        RaceError: It cannot be read, or is corrupt before its end; with the line.
    """
    reading = Reading(path)
    reading.read_on()
    return reading


def _advice(lines: int) -> str:
    """The advice for a file of which only the first lines are valid."""
    advice = "the journal was damaged or changed after it was written"
    if lines:
        advice += f". Lines 1 to {lines} are valid: delete the others; --resume runs their experiments again"
    return advice


def _take(record: Record, data: dict[str, Any], before: str) -> Event | None:
    """Add the event of a line, and return it unless it is the start."""
    after, is_start = data.pop("after", None), data.get("event") == "start"
    if is_start:  # before its "after", which other formats may lack
        del data["event"]
        record.begin(data)
    if after != before:
        raise RaceError(
            f"expected a line that was written after one with the checksum {before}, found {excerpt(str(after))}: "
            "lines are missing, were added, or are out of order"
        )
    if is_start:
        return None
    event = event_of(data)
    record.note(event)
    return event


class Journal:
    """A record with its file; a context manager that closes the file.

    The file is locked for one process. The lock ends with the process, whatever ends it.

    Attributes:
        path: The path of the file.
        record: The record of the race.
        notes: Notes for the user.
    """

    def __init__(self, path: Path, *, new: bool) -> None:
        """Open a new or an existing journal.

        Raises:
            RaceError: Another process has locked it, or it is corrupt.
            OSError: It cannot be opened.
        """
        self.path = path
        self.notes: list[str] = []
        self._file = os.open(
            path, os.O_RDWR | os.O_APPEND | os.O_CLOEXEC | (os.O_CREAT | os.O_EXCL if new else 0), 0o666
        )
        self._synced = time.monotonic()
        try:
            self._lock()
            reading = read(path)
            self.record, self._length, self._last = reading.record, reading.length, reading.last
            if reading.torn:
                self.notes.append(f"{path}, {reading.torn}: the rest was cut off; its experiments run again")
                os.ftruncate(self._file, reading.length)
                self.sync()
            if new:
                sync_folder(path.parent)
        except BaseException:
            os.close(self._file)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is not None:
                with contextlib.suppress(RaceError):  # the first error matters more
                    self.note(SessionStopped(why=kind.__name__, time=now()))
            self.sync()
        except OSError as error:
            if kind is None:
                raise self._unwritten(error) from None
        finally:
            os.close(self._file)

    def open_session(self, executor: str = "", jobs: int = 0) -> None:
        """Record that this process begins to work on the race, with an executor of this name."""
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
        """Add events to the record, and append their lines to the file, all or none of them.

        After an error the record may have events that the file does not have: resume the race from the file.

        Raises:
            RaceError: An event is not consistent with those before, or they cannot be written.
        """
        self.record.note(*events)
        self._append(*map(to_json, events))

    def sync(self) -> None:
        """Sync the file to the disk."""
        os.fsync(self._file)
        self._synced = time.monotonic()

    def _append(self, *lines: dict[str, Any]) -> None:
        last, texts = self._last, []
        for line in lines:
            texts.append(to_line({**line, "after": last}))
            last = checksum(texts[-1])
        data = "".join(texts).encode()
        try:
            if os.write(self._file, data) != len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))  # noqa: TRY301 - handled below
            self._length += len(data)
            self._last = last  # also if the sync fails: the lines are in the file
            if time.monotonic() - self._synced > SYNC_EVERY:
                self.sync()
        except OSError as error:
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self._length)
            raise self._unwritten(error) from None

    def _unwritten(self, error: OSError) -> RaceError:
        return RaceError(
            f"{self.path.parent}: results cannot be written: {error.strerror}; finished experiments are in "
            f"{self.path.name}; resume the race when there is space"
        )

    def _lock(self) -> None:
        try:
            for _ in range(10):  # a process that checks the lock holds it for a moment
                with contextlib.suppress(BlockingIOError):
                    fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    return
                time.sleep(0.02)
            raise RaceError(f"{self.path.parent}: {_holder(self.path)} is running this race")
        except OSError as error:  # some network file systems have no locks
            self.notes.append(
                f"{self.path.parent}: this file system has no locks ({error.strerror}): "
                "make sure that no other process runs this race"
            )


def is_locked(path: Path) -> bool:
    """Whether a process has locked a journal."""
    try:
        file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)  # opening a pipe would wait
    except OSError:
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError as error:  # any other: this file system has no locks
        return isinstance(error, BlockingIOError)
    finally:
        os.close(file)
    return False


def now(timespec: str = "seconds") -> str:
    """The current time as text; `timespec` is that of `datetime.isoformat`."""
    return datetime.now(UTC).isoformat(timespec=timespec)


def _holder(path: Path) -> str:
    """The process that has locked a journal, by its last session."""
    with contextlib.suppress(RaceError):
        sessions = read(path).record.sessions
        if sessions and isinstance(last := sessions[-1], SessionStarted):
            return f"process {last.process} on {last.host}"
    return "another process"
