"""The race in a run folder: its state for lists, and its events for event streams."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mercator_design.config.checked_lines import checked_text
from mercator_design.errors import MercatorError
from mercator_design.race.session.journal import Reading
from mercator_design.race.session.record import Record
from mercator_design.race.session.view import RaceView
from mercator_design.results.files import JOURNAL, TASKS, read_provenance

_EVENT, _AFTER = b'{"event":"', b',"after":"'  # at the ends of a line
CHUNK = 64 * 1024
"""Size of a read [bytes]."""


class RaceStatus:
    """State of a race, which may be running, from its run folder; `read_on` reads new events."""

    def __init__(self, folder: Path) -> None:
        self.folder, self._reading = folder, Reading(folder / JOURNAL)

    def read_on(self) -> Record:
        """The record so far; an empty one if no race has begun.

        Raises:
            RaceError: The journal is damaged.
        """
        if self._reading.path.exists():
            self._reading.read_on()
        return self._reading.record

    @property
    def view(self) -> RaceView:
        """State of the race at the last reading."""
        return self._reading.record.view

    @property
    def n_experiments(self) -> int:
        """Experiments that have run, at the last reading."""
        return self.view.n_experiments

    def is_finished(self, budget: int) -> bool:
        """Whether the race has ended under a budget, and its winner is written."""
        if not (self.view.is_complete and self.view.budget >= budget):
            return False
        try:
            provenance = read_provenance(self.folder)
        except MercatorError:
            return False
        winner = TASKS[str(provenance.race["task"])].WINNER
        return provenance.budget == self.view.budget and (self.folder / winner).exists()


class JournalEvent(NamedTuple):
    """An event of a journal.

    place: Byte offset of its end in the journal, from which to read on.
    kind: Kind, such as "experiment".
    data: The event as JSON, as `mdesign race --json-lines` prints it.
    """

    place: int
    kind: bytes
    data: bytes


def check_place(journal: Path, place: int) -> None:
    """Check that a byte offset in a journal is 0 or the end of an event.

    Raises:
        ValueError: It is not.
    """
    if not place:
        return
    if place <= length_of(journal):  # that of a pipe is 0: opening one would wait
        with journal.open("rb") as file:
            file.seek(place - 1)
            if file.read(1) == b"\n":
                return
    raise ValueError(f"expected the place of an event, found {place}")


def lines_from(journal: Path, place: int) -> bytes:
    """Whole lines of a journal from a place on, of about CHUNK bytes; none if there are no more yet.

    Args:
        journal: Its file.
        place: One that `check_place` accepts.
    """
    try:
        with journal.open("rb") as file:
            file.seek(place)
            data = file.read(CHUNK) + file.readline()
    except FileNotFoundError:
        return b""
    return data[: data.rfind(b"\n") + 1]


def events_in(lines: bytes, place: int) -> Iterator[JournalEvent]:
    """The events in whole lines of a journal that begin at a place.

    Iterating raises:
        ValueError: The journal is damaged.
    """
    for line in lines.splitlines(keepends=True):
        place += len(line)
        yield _event(line, place)


def _event(line: bytes, place: int) -> JournalEvent:
    """The event of a line, cut out as text: hundreds may follow a race, and parsing takes much longer."""
    text = checked_text(line)
    if not text.startswith(_EVENT):
        raise ValueError("expected an event")
    kind = text[len(_EVENT) : text.find(b'"', len(_EVENT))]
    before, after, _ = text.rpartition(_AFTER)
    is_chained = after and len(before) == len(text) - len(_AFTER) - len('00000000"}')
    return JournalEvent(place, kind, before + b"}" if is_chained else text)


def end_of(journal: BinaryIO) -> int:
    """The place after the last event of a journal that another process may be writing."""
    place = journal.seek(0, os.SEEK_END)
    while place > 0:
        start = max(0, place - CHUNK)
        journal.seek(start)
        if (found := journal.read(place - start).rfind(b"\n")) >= 0:
            return start + found + 1
        place = start
    return 0


def length_of(journal: Path) -> int:
    """The number of bytes of a journal; 0 if there is none."""
    try:
        return os.stat(journal).st_size  # noqa: PTH116 - hot: asked several times a second for each who follows
    except FileNotFoundError:
        return 0
