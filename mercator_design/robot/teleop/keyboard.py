"""Keys and a status line of a terminal, which is restored on every way out but SIGKILL."""

import contextlib
import math
import os
import re
import sys
import termios
import time
from collections.abc import Iterator
from typing import Literal, TypeAlias

from mercator_design.errors import RobotError, RobotStopped, printable

Key: TypeAlias = Literal["forward", "back", "left", "right", "quit", "stop"]

_ARROWS: dict[bytes, Key] = {b"A": "forward", b"B": "back", b"C": "right", b"D": "left"}
_KEYS: dict[bytes, Key] = {
    b"w": "forward",
    b"s": "back",
    b"a": "left",
    b"d": "right",
    b"q": "quit",
    b"\x04": "quit",
    **{start + letter: key for start in (b"\x1b[", b"\x1bO") for letter, key in _ARROWS.items()},
}
# Keys, including those of the Linux console with [[ and those with Alt; clicks, which begin with [M; and reports of
# terminals, which begin with ] or P.
_KEY = re.compile(
    rb"\x1b(?:\[\[.|\[M[^\x1b]{3}|\[[0-?]*[ -/]*[@-~]|O.|[]P][^\a\x1b]{0,200}(?:\a|\x1b\\)|[^\x1b])|.", re.DOTALL
)
_BEGUN = re.compile(  # its other bytes may follow
    rb"\x1b(?:\[(?:\[|M[^\x1b]{0,2}|[0-?]*[ -/]*)|O|[]P][^\a\x1b]{0,200}\x1b?)?\Z"
)
_MAX_SPLIT = 0.3  # [s] between the bytes of a key
_CLEAR_LINE = "\r\x1b[K"


def keys(data: bytes) -> tuple[list[Key], bytes]:
    """The keys in bytes from a terminal, and the bytes of an incomplete last key."""
    rest = begun[0] if (begun := _BEGUN.search(data)) else b""
    pressed = _KEY.findall(data.removesuffix(rest) if rest else data)
    return [_KEYS.get(each.lower() if len(each) == 1 else each, "stop") for each in pressed], rest


class Keyboard:
    """A terminal that sends keys at once, without echo; keys for signals still work."""

    def __init__(self, terminal: int) -> None:
        """Make one from a terminal that was opened for reading without waiting."""
        self._terminal, self._rest = terminal, b""
        self._came = -math.inf

    def pressed(self) -> list[Key]:
        """The keys that were pressed since the last call.

        Raises:
            RobotStopped: if the terminal is gone.
        """
        try:
            data = os.read(self._terminal, 1000)
        except BlockingIOError:
            if not self._rest:
                return []
            if time.monotonic() - self._came > _MAX_SPLIT:  # Escape, or Alt with P or ]: no more bytes follow
                self._rest = b""
            return ["stop"]
        except OSError:  # on Linux, the other end of a pseudo-terminal is closed
            data = b""
        if not data:
            raise RobotStopped("the terminal is lost")
        self._came = time.monotonic()
        found, self._rest = keys(self._rest + data)
        return found

    def show(self, status: str) -> None:
        """Replace the status line, if the terminal is there; `pressed` raises if it is not."""
        with contextlib.suppress(OSError):
            width = os.get_terminal_size(self._terminal).columns or 80
            os.write(self._terminal, (_CLEAR_LINE + printable(status)[: width - 1]).encode())

    def write_line(self, text: str) -> None:
        """Write a line above the status, if the terminal is there."""
        with contextlib.suppress(OSError):
            os.write(self._terminal, f"{_CLEAR_LINE}{printable(text)}\n".encode())


@contextlib.contextmanager
def keyboard() -> Iterator[Keyboard]:
    """The terminal of this program's input, with changed settings within the context.

    Raises:
        RobotError: if it cannot be opened.
    """
    terminal = _open()
    usual, changed = termios.tcgetattr(terminal), termios.tcgetattr(terminal)
    changed[0] &= ~termios.IXON  # Ctrl-S would stop the status
    changed[3] &= ~(termios.ICANON | termios.ECHO)
    changed[6][termios.VMIN], changed[6][termios.VTIME] = 1, 0
    try:
        termios.tcsetattr(terminal, termios.TCSANOW, changed)
        termios.tcflush(terminal, termios.TCIFLUSH)  # ignore keys from before
        yield Keyboard(terminal)
    finally:
        with contextlib.suppress(termios.error, OSError):  # the terminal is gone
            termios.tcflush(terminal, termios.TCIFLUSH)  # the shell must not get keys of the drive
            termios.tcsetattr(terminal, termios.TCSANOW, usual)
            os.write(terminal, b"\n")
        os.close(terminal)


def _open() -> int:
    """Open the terminal again: the shell's descriptor must go on to wait for keys."""
    flags = os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK
    with contextlib.suppress(OSError):  # of another user, after `su`, or without a name, as in containers
        return os.open(os.ttyname(sys.stdin.fileno()), flags)
    with contextlib.suppress(OSError):
        return os.open("/dev/tty", flags)
    raise RobotError("the terminal cannot be opened")
