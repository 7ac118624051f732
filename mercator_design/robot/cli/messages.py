"""The messages of this program on stderr. A thread of its own writes them, so that no message delays the wheels.

A terminal that is paused by Ctrl-S, a full pipe, or a connection that hangs blocks this thread only.
"""

import atexit
import contextlib
import io
import os
import queue
import sys
import threading

from mercator_design.robot.run.safety import raise_priority

MAX_WAITING = 1000  # messages; more are dropped
_IN_TURN = 0.02  # [s] that the program waits for a message to be written, so that it comes before results on stdout
LAST_WAIT = 2.0  # [s] that the program waits at its end for its last messages


def queue_messages() -> None:
    """Let a thread write what is printed on stderr from now on, if stderr is a file."""
    with contextlib.suppress(AttributeError, OSError):  # closed; not a file
        waiting = _Waiting(sys.stderr.fileno())
        atexit.register(waiting.end)
        sys.stderr = io.TextIOWrapper(waiting, sys.stderr.encoding, sys.stderr.errors, write_through=True)


class _Waiting(io.RawIOBase):
    """Bytes that wait until a thread has written them to a file."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self._number = number
        self._texts: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._are_written = threading.Event()
        self._are_written.set()
        self._is_prompt = True  # whether the file took the latest text in time
        threading.Thread(target=self._write_all, daemon=True).start()

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._number

    def isatty(self) -> bool:
        return os.isatty(self._number)

    def write(self, text: "bytes | memoryview") -> int:  # type: ignore[override]
        """Queue text, or drop it if too much waits."""
        if self._texts.qsize() < MAX_WAITING:
            self._are_written.clear()
            self._texts.put(bytes(text))
        return len(text)

    def flush(self) -> None:
        """Wait a little for what is queued, unless the file was slow before."""
        self._is_prompt = self._are_written.wait(_IN_TURN if self._is_prompt else 0.0)

    def end(self) -> None:
        """Wait for what is queued, but not without end."""
        self._are_written.wait(LAST_WAIT)

    def _write_all(self) -> None:
        raise_priority(1)  # it may hold the interpreter's lock, for which the control loop waits
        while True:
            text = self._texts.get()
            with contextlib.suppress(OSError):  # for example, the terminal was closed
                while text:
                    text = text[os.write(self._number, text) :]
            if self._texts.empty():
                self._are_written.set()
