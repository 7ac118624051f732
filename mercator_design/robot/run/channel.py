"""Lines from another program over the standard input, and answers over the standard output."""

import os
import select
import sys
import threading
import time
from collections.abc import Callable, Iterable
from typing import Self

from mercator_design.robot.protocols.lines import LineSplitter
from mercator_design.robot.run.safety import raise_priority

_TIMEOUT = 0.05  # [s] of waiting for a line
_WRITE_TIMEOUT = 0.1  # [s] after which writing gives up
_MAX_READ = 4096  # bytes


class Channel:
    """Reads lines in a thread of its own. A context manager."""

    def __init__(
        self, receive: Callable[[Iterable[bytes] | None, float], None], failed: Callable[[], None] = lambda: None
    ) -> None:
        """Make a channel; its thread runs within the context.

        Args:
            receive: Called repeatedly with the new lines, which may be none, and their time [s]; with None, the last
                time, when the other end has closed the input.
            failed: Called if the thread ends by an error.
        """
        self._receive, self._failed = receive, failed
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._in, self._out = sys.stdin.fileno(), sys.stdout.fileno()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def write(self, line: str) -> bool:
        """Write a line; return whether that was possible, within `_WRITE_TIMEOUT`."""
        try:
            _, ready, _ = select.select([], [self._out], [], _WRITE_TIMEOUT)
            return bool(ready) and os.write(self._out, line.encode()) > 0
        except OSError:
            return False

    def _listen(self) -> None:
        raise_priority(2)
        splitter, is_connected = LineSplitter(), True
        try:
            while is_connected and not self._over.is_set():
                lines: list[bytes] = []
                if select.select([self._in], [], [], _TIMEOUT)[0]:
                    data = os.read(self._in, _MAX_READ)
                    is_connected = bool(data)
                    lines = splitter.receive(data)
                self._receive(lines, time.monotonic())
            if not is_connected:
                self._receive(None, time.monotonic())
        finally:
            if is_connected and not self._over.is_set():
                self._failed()
