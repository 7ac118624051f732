"""Finding frames in a stream of bytes that may be split, damaged, or joined in the middle."""

import re
from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

Event = TypeVar("Event")


class Counts(NamedTuple):
    """Counts of the bytes that came over a line."""

    received: int = 0
    lost: int = 0  # outside of valid frames
    refused: int = 0  # frame starts among the lost bytes


class Decoder(Generic[Event]):
    """Takes bytes in pieces of any size and returns events. No bytes make it raise an exception.

    Every place where a frame may begin is tried. Of the valid frames the one that ends first is taken. So the events do
    not depend on how the bytes were split, and a damaged start of a long frame does not delay the frames that follow.
    Between calls it keeps less than the longest frame.
    """

    def __init__(
        self, starts: re.Pattern[bytes], size: Callable[[bytes, int], int], read: Callable[[bytes], Event | None]
    ) -> None:
        """Make a decoder of one format.

        Args:
            starts: Matches where a frame may begin, also if the bytes end within its first bytes.
            size: Returns the number of bytes of a frame that begins at a place: 0 if none can; more than there are
                while the number is unknown.
            read: Returns the event of the bytes of a frame; None if they are not valid.
        """
        self._starts, self._size, self._read = starts, size, read
        self._kept = b""
        self._received = self._lost = self._refused = 0

    @property
    def counts(self) -> Counts:
        """Counts of all bytes so far; bytes that may still become a frame are received, and not lost."""
        return Counts(self._received, self._lost, self._refused)

    def receive(self, data: bytes) -> list[Event]:
        """Return the events that these bytes complete, in order."""
        self._received += len(data)
        data = self._kept + data
        there = len(data)
        events: list[Event] = []
        done = 0
        while True:
            found: Event | None = None
            unfinished, start, end = there, 0, there + 1
            for match in self._starts.finditer(data, done):
                place = match.start()
                if place >= end:
                    break
                size = self._size(data, place)
                if place + size > there:
                    unfinished = min(unfinished, place)
                elif size and place + size < end and (event := self._read(data[place : place + size])) is not None:
                    found, start, end = event, place, place + size
            if found is None:
                self._lose(data, done, unfinished)
                self._kept = data[unfinished:]
                return events
            events.append(found)
            self._lose(data, done, start)
            done = end

    def _lose(self, data: bytes, start: int, end: int) -> None:
        """Count bytes outside of valid frames."""
        if start == end:
            return
        self._lost += end - start
        for match in self._starts.finditer(data, start):
            if match.start() >= end:
                break
            self._refused += self._size(data, match.start()) > 0
