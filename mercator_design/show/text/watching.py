"""Follows a race by its journal, which another process writes."""

import time
from collections.abc import Callable
from pathlib import Path

from mercator_design.race.session.events import Event, SessionStopped
from mercator_design.race.session.journal import Reading, is_locked
from mercator_design.race.session.record import Record
from mercator_design.results.files import JOURNAL, read_provenance, resume_command, task_of
from mercator_design.show.text.progress import Mode, RaceDisplay

_POLL_EVERY = 0.5
"""Seconds between two looks at the journal."""

Sleep = Callable[[float], None]


def follow(path: Path, mode: Mode, *, announce: Callable[[str], None], sleep: Sleep = time.sleep) -> None:
    """Show the progress of the race of a run folder until it has ended.

    Args:
        path: The run folder; it may not be there yet.
        mode: How to show it.
        announce: Called with a message when it waits.
        sleep: Waits for so many seconds.

    Raises:
        RaceError: The journal or the provenance is damaged.
        MercatorError: The race's files have changed.
    """
    reading, events = _begun(path, announce, sleep)
    provenance, task = read_provenance(path), task_of(path)
    record, plan = reading.record, task.optimizer.progress
    with RaceDisplay(task, record.view, provenance.testing, mode, plan=plan) as display:
        display.known = len(record.experiments)
        is_announced = False
        while True:
            is_running = is_locked(reading.path)  # first, because a race that ends writes and then unlocks
            reading.read_on(events.append)
            for event in events:
                display.note(event)
            events.clear()
            if is_running:
                is_announced = False
            elif record.is_complete and len(record.tests) >= display.n_tests:
                return
            elif not is_announced:
                announce(_interruption(path, record))
                is_announced = True
            sleep(_POLL_EVERY)


def _begun(path: Path, announce: Callable[[str], None], sleep: Sleep) -> tuple[Reading, list[Event]]:
    """Wait for the start of a race; returns its journal so far, and the events in it."""
    reading, events = Reading(path / JOURNAL), list[Event]()
    is_announced = False
    while True:
        if reading.path.exists():
            reading.read_on(events.append)
        if reading.record.start:
            return reading, events
        if not is_announced:
            announce(f"{path}: no race has begun here yet; waiting for it")
            is_announced = True
        sleep(_POLL_EVERY)


def _interruption(path: Path, record: Record) -> str:
    last = record.sessions[-1] if record.sessions else None
    why = f" ({last.why}, {last.time})" if isinstance(last, SessionStopped) else ""
    what = "tests" if record.is_complete else "race"
    resume = resume_command(path, record.start["task"])
    return f"{path}: the {what} stopped{why} after {len(record.experiments)} experiments; waiting for: {resume}"
