"""Finding frames in a stream of bytes that may be split, damaged, or joined in the middle."""

import re
from collections.abc import Callable
from itertools import takewhile
from typing import Generic, NamedTuple, TypeVar

Event = TypeVar("Event")


class Counts(NamedTuple):
    """Of what came over a line.

    received: Bytes.
    lost: Bytes that were of no sound frame.
    refused: Beginnings of frames among the lost bytes.
    """

    received: int = 0
    lost: int = 0
    refused: int = 0


class Decoder(Generic[Event]):
    """Bytes in, in pieces of any size; events out. Raises nothing, whatever the bytes.

    Every place where a frame may begin is tried. Of those that hold a sound one, the one that ends first is taken. So
    the events do not depend on how the bytes were split, and a damaged beginning that promises a long frame holds up
    none of those that follow. Kept between calls is less than the longest frame.

    counts: Of all that came so far; bytes that may still become a frame are received, and not lost.
    """

    def __init__(
        self, starts: re.Pattern[bytes], size: Callable[[bytes, int], int], read: Callable[[bytes], Event | None]
    ) -> None:
        """Make a decoder of one format.

        Args:
            starts: Matches where a frame may begin, also if the bytes end within what it begins with.
            size: Bytes of the frame that would begin at a place: 0 if none does; more than there are if how many it is
                cannot be told yet.
            read: The event of so many bytes; None if they are not sound.
        """
        self._starts, self._size, self._read = starts, size, read
        self._kept = b""
        self.counts = Counts()

    @property
    def lost(self) -> int:
        """Bytes so far that were of no sound frame."""
        return self.counts.lost

    def receive(self, data: bytes) -> list[Event]:
        """The events that these bytes complete, in order."""
        self.counts = self.counts._replace(received=self.counts.received + len(data))
        data = self._kept + data
        events: list[Event] = []
        done = 0
        while True:
            found: Event | None = None
            unfinished, start, end = len(data), 0, len(data) + 1
            for match in self._starts.finditer(data, done):
                place = match.start()
                if place >= end:
                    break
                size = self._size(data, place)
                if place + size > len(data):
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
        """Count bytes that are of no sound frame."""
        if start == end:
            return
        places = (match.start() for match in self._starts.finditer(data, start))
        refused = sum(self._size(data, place) > 0 for place in takewhile(lambda place: place < end, places))
        received, lost, before = self.counts
        self.counts = Counts(received, lost + end - start, before + refused)
