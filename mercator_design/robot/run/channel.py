"""Lines that another program says over the standard input, and is answered over the standard output."""

import os
import select
import sys
import threading
import time
from collections.abc import Callable, Iterable
from typing import Self

from mercator_design.robot.run.safety import go_first

_LOOK = 0.05  # [s] for which to wait for a line
_MOST = 4096  # bytes at a time


class Channel:
    """Hears lines in a thread of its own. A context manager."""

    def __init__(
        self, hear: Callable[[Iterable[bytes] | None, float], None], failed: Callable[[], None] = lambda: None
    ) -> None:
        """Make one; entering its context begins to listen.

        Args:
            hear: Called again and again, with lines, which may be none, and when they came [s]; with None once the
                other end is gone, and then no more.
            failed: Called if the thread ends before its time.
        """
        self._hear, self._failed = hear, failed
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._in, self._out = sys.stdin.fileno(), sys.stdout.fileno()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def say(self, line: str) -> bool:
        """Say a line; whether the other end is there."""
        try:
            os.write(self._out, line.encode())
        except OSError:
            return False
        return True

    def _listen(self) -> None:
        go_first(2)
        begun = b""  # of a line
        is_connected = True
        try:
            while is_connected and not self._over.is_set():
                lines: list[bytes] = []
                if select.select([self._in], [], [], _LOOK)[0]:
                    data = os.read(self._in, _MOST)
                    is_connected = bool(data)
                    *lines, begun = (begun + data).split(b"\n")
                self._hear(lines, time.monotonic())
            if not is_connected:
                self._hear(None, time.monotonic())
        finally:
            if is_connected and not self._over.is_set():
                self._failed()
