"""Logs of runs and recordings: files that can be read while they are written and after any crash.

Each line is an event (config/checked_lines.py) with the number of the line, so that missing lines are noticed. Lines
are only appended. For the events of a recording see recording.py. Those of a run are:

    start   the PFSM, the constants that interpret it, seed, robot, facts on its devices; for a run that began together
            with others, `clock`: how far this computer's time of day was `ahead` of the `reference`, the computer that
            started them, and the `uncertainty` [s]
    cycle   its number, the time since the log's start [s], the state that acted and the next one, readings, draws,
            wheels (null if not finite), led_colour and signal (null if wrong), processor time of the cycle (cpu) and,
            since the previous cycle, of the whole program (program_cpu) [s], the neighbours' distances [m] and bearings
            [rad], the age [s] and values of each sensor's latest sample (sensed): a distance is null where nothing is
            in sight, and 0 where something is too near; and the numbers of each device's line (lines), as in events.py
    turn    a turn of the lidar, and the robot's yaws and places since the one before (turns.py)
    note    a note on a device, and its time
    end     why the run ended

Readings, draws and wheels have all their digits: `replay` repeats the decision of each cycle, and compares.
"""

import contextlib
import math
import os
import queue
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from mercator_design.config.checked_lines import from_line, to_line
from mercator_design.errors import FsmError, RobotError
from mercator_design.modules.architecture import Software
from mercator_design.modules.reference import WRONG, Actions, Readings, led_colour_of, signal_of
from mercator_design.robot.logs.events import (
    CycleDone,
    EventReader,
    LogEnded,
    LogEvent,
    LogKind,
    LogStart,
    NoteTaken,
    RunStarted,
    now,
    to_json,
)
from mercator_design.software import Controller, architecture_of
from mercator_design.software.needed import ready
from mercator_design.system.files import sync_folder, writing

SYNC_EVERY = 1.0
"""[s] after which a written event is forced to the disk: a power failure loses those of the last second at most."""
NO_END = "the log has no end: it is still being written, or the program was killed"
DISK_LIMIT = 10.0  # [s] for which events may wait for the disk
_ROUNDING = 1e-9  # of wheels, between processors
_MAX_LINE = 1 << 20  # bytes


class Log:
    """A log that a thread of its own writes, so that a slow disk does not delay the wheels. A context manager.

    The file exists from the beginning of the context, and is removed at the end unless `begin` was called.

    began: Time of `begin` [s, of time.monotonic()].
    failure: Why it cannot be written any more; empty if it can.
    """

    def __init__(self, path: Path, ending: str = "The duration is over") -> None:
        """Make one; entering its context makes a new file. `ending` is why it ends, if there is no error.

        Raises:
            RobotError: on entering, if the file cannot be written, or exists.
        """
        self.path, self._ending = path, ending
        self.began = math.nan
        self.failure = ""
        self._events: queue.SimpleQueue[LogEvent | None] = queue.SimpleQueue()
        self._waits_since = math.inf
        self._thread = threading.Thread(target=self._write_all, daemon=True)

    def __enter__(self) -> Self:
        with writing(self.path, RobotError):
            self._file = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        try:
            with contextlib.suppress(OSError):  # a folder that may be written, but not read
                sync_folder(self.path.parent)
            self._thread.start()
        except BaseException:  # a signal
            os.close(self._file)
            self.path.unlink(missing_ok=True)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        why = self._ending if error is None else str(error) or type(error).__name__
        has_begun = math.isfinite(self.began)
        if has_begun:
            self.note(LogEnded(why=why, time=now()))
        self._events.put(None)
        self._thread.join(DISK_LIMIT)
        if self._thread.is_alive():
            self._fail("the disk hangs")
        else:
            os.close(self._file)
            if not has_begun:
                self.path.unlink(missing_ok=True)
        if error is not None and self.failure not in str(error):
            error.add_note(self.failure)

    def begin(self, start: LogStart) -> None:
        """Append the start, the first event."""
        self.began = time.monotonic()
        self.note(start)

    def note(self, event: LogEvent) -> None:
        at = time.monotonic()
        if self._events.empty():
            self._waits_since = at
        self._events.put(event)
        if at - self._waits_since > DISK_LIMIT and not self.failure:
            self._fail("the disk hangs")

    def remark(self, text: str) -> None:
        """Append a note with the present time."""
        self.note(NoteTaken(time=round(time.monotonic() - self.began, 4), text=text))

    def _fail(self, why: str) -> None:
        self.failure = f"{self.path}: cannot be written: {why}"

    def _write_all(self) -> None:
        try:
            for text in to_lines(map(to_json, self._arriving())):
                line = text.encode()
                while line:
                    line = line[os.write(self._file, line) :]
            os.fsync(self._file)
        except Exception as error:  # noqa: BLE001 - no error may let the run go on without a log
            self._fail(getattr(error, "strerror", None) or repr(error))

    def _arriving(self) -> Iterator[LogEvent]:
        """The events until the end; those that were written are forced to the disk when it is time."""
        due = math.inf  # time of the next sync
        while True:
            if (at := time.monotonic()) >= due:
                os.fsync(self._file)
                due = math.inf
            try:
                event = self._events.get(timeout=None if due == math.inf else due - at)
            except queue.Empty:
                continue
            if event is None:
                return
            yield event
            due = min(due, time.monotonic() + SYNC_EVERY)


def plain(value: float) -> float | None:
    """A measured value as in JSON: null where nothing is in sight, 0 where something is too near."""
    if math.isinf(value):
        return None if value > 0.0 else 0.0
    return round(value, 6) + 0.0  # not -0.0


def finite(actions: Actions) -> tuple[float | None, float | None]:
    """The speeds of the treads as in a log: None if not finite."""
    left, right = (speed if math.isfinite(speed) else None for speed in (actions.left, actions.right))
    return left, right


def outputs(actions: Actions) -> dict[str, int | None]:
    """The other outputs as in a log: None where a module set a wrong number."""
    found = {"led_colour": led_colour_of(actions), "signal": signal_of(actions)}
    return {name: None if value == WRONG else value for name, value in found.items()}


def to_lines(events: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """The lines of a log, from its events as JSON data."""
    for number, event in enumerate(events, start=1):
        yield to_line({**event, "line": number})


def read(path: Path, kind: LogKind | None = "run") -> Generator[LogEvent, None, None]:
    """The events of a log, which has this kind, or any if it is None. An incomplete last line is ignored.

    Who stops before the last event closes the generator.

    Raises:
        RobotError: if it cannot be read, is not a log or not of that kind, has events that this version does not write,
            or is damaged before its end.
    """
    try:
        if path.exists() and not path.is_file():  # opening a pipe would wait, reading a device might never end
            raise RobotError(f"{path}: expected a robot's log, found a folder, device or pipe")
        with path.open("rb") as file:
            reader = EventReader(kind)
            lines = iter(lambda: file.readline(_MAX_LINE), b"")
            for number, line in enumerate(lines, start=1):
                try:
                    event = reader.read(from_line(line))
                except (ValueError, RobotError) as error:
                    if number > 1 and not line.endswith(b"\n") and next(lines, None) is None:
                        return
                    raise RobotError(f"{path}, line {number}: {error}") from None
                yield event
            if file.tell() == 0:
                raise RobotError(f"{path}: expected a robot's log, found nothing")
    except OSError as error:
        raise RobotError(f"{path}: cannot be read: {error.strerror or error}") from None


@contextlib.contextmanager
def understanding(path: Path) -> Iterator[None]:
    """A context for computing with events of a log, whose values have been checked one by one.

    Raises:
        RobotError: if this version cannot have written them together, or control software in them is not valid here.
    """
    try:
        yield
    except FsmError as error:
        raise RobotError(*(f"{path}: {message}" for message in error.messages)) from None
    except (IndexError, ArithmeticError, UnicodeError) as error:
        raise RobotError(f"{path}: expected what this version writes, found other events: {error!r}") from None


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """A controller's decision in a cycle."""

    cycle: int
    time: float  # [s] since the start of the log
    state: int
    next_state: int
    condition: str  # of the transition that was taken; empty if none was
    readings: Readings
    actions: Actions
    differs: str  # how this decision differs from the log; empty if it does not


def controller_of(start: LogEvent) -> Controller:
    """The controller in the start of a run's log.

    Raises:
        FsmError: if its control software is not valid, or needs a flavour or a plugin that is missing or has changed.
    """
    assert isinstance(start, RunStarted)  # noqa: S101 - `read` has checked it
    ready(start.header or {}, start.flavour, None, "the start of the log", None)
    software = architecture_of(start.flavour).parse(start.fsm, start.flavour, tolerate=lambda _: None)
    return Controller(software, start.reference_model)


def replay(path: Path, warn: Callable[[str], None] = lambda _: None) -> Iterator[tuple[Software, Decision]]:
    """Run the controller of a log again on its readings and draws; `warn` is called if the log has no end.

    Raises:
        RobotError: as `read`, or if this version cannot have written the log.
    """
    with contextlib.closing(read(path)) as events, understanding(path):
        event = next(events)
        controller = controller_of(event)
        for event in events:
            if isinstance(event, CycleDone):
                yield controller.software, _decide(controller, event)
        if not isinstance(event, LogEnded):
            warn(NO_END)


def condition_met(controller: Controller, event: CycleDone) -> str:
    """The condition of the transition that was taken in a cycle, or another reason; empty if the part is the same."""
    if event.next_state == event.state:
        return ""
    return controller.reason(event.state, Readings(*event.readings), event.draws)


def _is_near(decided: float | None, logged: float | None) -> bool:
    """Whether two speeds are the same; another processor's mathematical functions may differ in the last digits."""
    if decided is None or logged is None:
        return decided is logged
    return math.isclose(decided, logged, rel_tol=_ROUNDING, abs_tol=_ROUNDING)


def _decide(controller: Controller, event: CycleDone) -> Decision:
    readings = Readings(*event.readings)
    state = controller.state
    decided = controller.step(readings, event.draws)
    others = outputs(decided)
    found = state, controller.state, *others.values()
    logged = event.state, event.next_state, *(getattr(event, name) for name in others)
    speeds = finite(decided)
    return Decision(
        cycle=event.cycle,
        time=event.time,
        state=state,
        next_state=controller.state,
        condition=condition_met(controller, event),
        readings=readings,
        actions=decided,
        differs=""
        if found == logged and all(map(_is_near, speeds, event.wheels))
        else f"decides {(*found, *speeds)}, the log has {(*logged, *event.wheels)}",
    )
