"""What has happened in a race, in memory and in a file that survives whatever stops the race.

A file has an event a line, as JSON with a checksum of the line in it, and is only ever appended to:

    start          what makes the race: digests of all that it depends on, seed, budget, options
    session        a process that began to work on it: its number, host, time, executor
    configuration  one that is raced from now on: its number, its parent's, its values
    experiment     one that has finished, in the order in which they do
    ahead          an experiment that has finished before the race asked for it, and perhaps will not
    iteration      one that has ended, for people who look at the journal
    test           an experiment on a test instance, which the race never sees
    extend         a larger budget, which counts from where the one before has ended
    end            where the race ended under a budget, its winner, and the digest of all up to there
    stop           a process that ended before the race did, and why

The *digest* is of what happened, not of how: the start, configurations and experiments in order of their numbers, and
the ends. So a race that was stopped and resumed has the same as one that was not, whatever ran its experiments, and a
race that was tested the same as one that was not.
"""

import contextlib
import errno
import fcntl
import hashlib
import json
import os
import socket
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

from mercator_design.checked_lines import Event, from_line, to_line
from mercator_design.errors import RaceError, excerpt
from mercator_design.files import sync_folder
from mercator_design.race.parameter import Configuration
from mercator_design.race.race import Experiment

FORMAT = 1
SYNC_EVERY = 1.0
"""Seconds after which what was written is forced to the disk: as much is lost when the power is."""


class Measured(NamedTuple):
    """What came of an experiment."""

    score: float
    outcome: str  # digest of what happened in it


@dataclass(frozen=True, slots=True, kw_only=True)
class Finished:
    """An experiment that has run."""

    experiment: int  # its number, from 0, in the order in which the race asked for them
    iteration: int
    configuration: int
    instance: int
    seed: int
    score: float | None  # None if it failed
    outcome: str = ""  # digest of what happened in it
    failure: str = ""  # why it failed


@dataclass(frozen=True, slots=True, kw_only=True)
class Tested:
    """A test that has run."""

    configuration: int
    instance: int  # of the test instances, from 0
    seed: int
    score: float | None  # None if it failed
    outcome: str = ""  # digest of what happened in it
    failure: str = ""  # why it failed


@dataclass(frozen=True, slots=True, kw_only=True)
class Iteration:
    """An iteration that has ended; see `summary.IterationSummary`."""

    iteration: int
    postselection: bool
    budget: int
    used: int
    configurations: int
    instances: int
    alive: int
    elites: tuple[int, ...]  # best first
    stagnant: int
    note: str


@dataclass(frozen=True, slots=True, kw_only=True)
class End:
    """Where a race ended under one of its budgets."""

    budget: int
    experiments: int
    winner: int  # the number of a configuration
    digest: str = ""


@dataclass(slots=True)
class Record:
    """What has happened in a race, in memory."""

    start: Event = field(default_factory=dict)
    configurations: dict[int, Configuration] = field(default_factory=dict)
    parents: dict[int, int | None] = field(default_factory=dict)
    experiments: dict[int, Finished] = field(default_factory=dict)
    ahead: dict[Experiment, Measured] = field(default_factory=dict)
    tests: dict[Experiment, Tested] = field(default_factory=dict)
    iterations: dict[int, Iteration] = field(default_factory=dict)
    budgets: list[int] = field(default_factory=list)  # growing
    ends: list[End] = field(default_factory=list)
    sessions: list[Event] = field(default_factory=list)  # starts and stops of processes

    @property
    def budget(self) -> int:
        """The largest that was given."""
        return self.budgets[-1]

    @property
    def is_complete(self) -> bool:
        """Whether the race has ended under the largest budget."""
        return len(self.ends) == len(self.budgets)

    def test_scores(self) -> dict[int, tuple[float, ...]]:
        """The scores of each configuration on the test instances, in order of these; without tests that failed."""
        found: dict[int, list[float]] = {}
        for where in sorted(self.tests):
            if (score := self.tests[where].score) is not None:
                found.setdefault(where.configuration, []).append(score)
        return {configuration: tuple(scores) for configuration, scores in found.items()}

    def digest(self, n_ends: int | None = None) -> str:
        """Of the start and all that happened up to one of the ends (by default the last), as hexadecimal text."""
        ends = self.ends[:n_ends]
        most = ends[-1].experiments if ends else len(self.experiments)
        counted = sorted(number for number in self.experiments if number < most)
        digest = hashlib.sha256(_text(self.start).encode())
        raced = {self.experiments[number].configuration for number in counted}
        for number in sorted(raced):
            digest.update(f"\n{number} {self.parents[number]} {_text(self.configurations[number])}".encode())
        for number in counted:
            e = self.experiments[number]
            words = f"\n{number} {e.iteration} {e.configuration} {e.instance} {e.seed} {e.score!r} {e.outcome}"
            digest.update(words.encode())
        for end in ends:
            digest.update(f"\nend {end.budget} {end.experiments} {end.winner}".encode())
        return digest.hexdigest()

    def note(self, events: Sequence[Event]) -> None:
        """Take in events.

        Raises:
            RaceError: One does not fit to those before.
        """
        for event in events:
            self._take(event)

    def begin(self, start: Mapping[str, Any]) -> None:
        """Take in what makes the race."""
        self.note([{"event": "start", "format": FORMAT, **start}])

    def note_experiments(self, finished: Sequence[Finished]) -> None:
        """Take in experiments that have finished."""
        self.note([{"event": "experiment"} | {name: getattr(one, name) for name in _FIELDS} for one in finished])

    def note_iteration(self, iteration: Iteration) -> None:
        """Take in that an iteration has ended."""
        self.note([{"event": "iteration", **asdict(iteration)}])

    def note_test(self, tested: Tested) -> None:
        """Take in a test that has finished."""
        self.note([{"event": "test", **asdict(tested)}])

    def note_ahead(self, experiment: Experiment, measured: Measured) -> None:
        """Take in an experiment that the race has not asked for yet."""
        self.note([{"event": "ahead", **experiment._asdict(), **measured._asdict()}])

    def note_end(self, end: End) -> None:
        """Take in that the race has ended, with the digest of all up to there."""
        self.ends.append(end)
        digest = self.digest()
        self.ends.pop()
        self.note(
            [
                {
                    "event": "end",
                    "budget": end.budget,
                    "experiments": end.experiments,
                    "winner": end.winner,
                    "digest": digest,
                }
            ]
        )

    def _take(self, event: Event) -> None:
        event = {**event}
        kind = event.pop("event", None)
        try:
            if not self.start and kind != "start":
                raise ValueError(f"expected the start of a race first, found {excerpt(str(kind))}")  # noqa: TRY301
            match kind:
                case "experiment":
                    one = Finished(**event)
                    if self.experiments.setdefault(one.experiment, one) != one:
                        raise ValueError(f"experiment {one.experiment} finished twice, with different results")  # noqa: TRY301
                case "ahead":
                    where = Experiment(event["configuration"], event["instance"])
                    self.ahead[where] = Measured(event["score"], event["outcome"])
                case "iteration":
                    ended = Iteration(**event | {"elites": tuple(event["elites"])})
                    self.iterations[ended.iteration] = ended
                case "test":
                    test = Tested(**event)
                    where = Experiment(test.configuration, test.instance)
                    if self.tests.setdefault(where, test) != test:
                        raise ValueError(  # noqa: TRY301
                            f"configuration {test.configuration} was tested twice on instance {test.instance}, with "
                            "different results"
                        )
                case "configuration":
                    # Their names are those of other configurations: once in memory is enough.
                    values = {sys.intern(name): value for name, value in event["values"].items()}
                    self.configurations[event["configuration"]] = values
                    self.parents[event["configuration"]] = event["parent"]
                case "start":
                    if self.start or event.get("format") != FORMAT:
                        found = "a second start" if self.start else f"format {event.get('format')}"
                        raise ValueError(f"expected one start, of format {FORMAT}, found {found}")  # noqa: TRY301
                    self.start = event
                    self.budgets = [event["budget"]]
                case "extend":
                    if event["budget"] <= self.budget:
                        raise ValueError(f"expected a budget larger than {self.budget}, found {event['budget']}")  # noqa: TRY301
                    self.budgets.append(event["budget"])
                case "end":
                    self.ends.append(End(**event))
                case "session" | "stop":
                    self.sessions.append({"event": kind, **event})
                case _:
                    raise ValueError(f"expected an event, found {excerpt(str(kind))}")  # noqa: TRY301
        except (ValueError, TypeError, KeyError) as error:
            what = f"{kind} without {error}" if isinstance(error, KeyError) else str(error)
            raise RaceError(what) from None


_FIELDS = Finished.__slots__


@dataclass(frozen=True, slots=True)
class Reading:
    """What there is in a journal's file."""

    record: Record
    length: int  # of its whole lines [bytes]
    lines: int  # that are whole
    torn: str  # what is wrong with what comes after them, if anything does


def read(path: Path) -> Reading:
    """A journal's file as it is; others may be writing it.

    Raises:
        RaceError: It cannot be read, or is corrupt before its end: with the line.
    """
    record, length, lines, torn = Record(), 0, 0, ""
    try:
        with path.open("rb") as file:
            for number, line in enumerate(file, start=1):
                try:
                    event = from_line(line)
                except ValueError as error:
                    torn = torn or f"line {number}: {error}"
                    continue
                if torn:  # a whole line after it
                    raise RaceError(
                        f"{path}, {torn}; the journal was damaged or changed after it was written. Lines 1 to {lines} "
                        "are whole: delete those after them to run again what they were about"
                    )
                try:
                    record.note([event])
                except RaceError as error:
                    raise RaceError(f"{path}, line {number}: {error}") from None
                length += len(line)
                lines = number
    except OSError as error:
        raise RaceError(f"{path}: cannot be read: {error.strerror or error}") from None
    return Reading(record, length, lines, torn)


class Journal(Record):
    """A record that is also in a file; a context manager that closes it.

    One process at a time has it: it is locked, and the lock goes with the process, however that ends.
    """

    __slots__ = ("_file", "_length", "_synced", "notes", "path")

    def __init__(self, path: Path, *, new: bool) -> None:
        """Open a new or an old one.

        Raises:
            RaceError: Another process has it, or it is corrupt.
            OSError: It cannot be opened.
        """
        super().__init__()
        self.path = path
        self.notes: list[str] = []  # what a user should know
        self._file = os.open(
            path, os.O_RDWR | os.O_APPEND | os.O_CLOEXEC | (os.O_CREAT | os.O_EXCL if new else 0), 0o666
        )
        self._length = 0
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
                self.note([{"event": "stop", "why": kind.__name__, "time": now()}])
            self.sync()
        os.close(self._file)

    def open_session(self, **how: object) -> None:
        """Note that this process begins to work on the race.

        Args:
            how: it does.
        """
        self.note([{"event": "session", "process": os.getpid(), "host": socket.gethostname(), "time": now(), **how}])

    def note(self, events: Sequence[Event]) -> None:
        """Take in events and append them to the file, whole or not at all.

        Raises:
            RaceError: One does not fit to those before, or they cannot be written.
        """
        super().note(events)
        self._write("".join(map(to_line, events)).encode())

    def sync(self) -> None:
        """Force what was written to the disk."""
        os.fsync(self._file)
        self._synced = time.monotonic()

    def _write(self, data: bytes) -> None:
        try:
            if os.write(self._file, data) != len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))  # noqa: TRY301 - as if it had said so
            self._length += len(data)
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
        for name in Record.__slots__:
            setattr(self, name, getattr(reading.record, name))
        self._length = reading.length
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
        if sessions and sessions[-1]["event"] == "session":
            return f"process {sessions[-1].get('process')} on {sessions[-1].get('host')}"
    return "another process"


def _text(value: Mapping[str, Any]) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
