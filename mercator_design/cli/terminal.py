"""Messages and signals of all verbs."""

import contextlib
import shlex
import shutil
import signal
import sys
import textwrap
from collections.abc import Callable, Iterator
from os import EX_TEMPFAIL
from types import FrameType
from typing import Self

from mercator_design.command import print_message
from mercator_design.errors import Signalled


def command_line() -> str:
    """The command as the user gave it, for the captions of pictures, or to be given again."""
    return shlex.join(["mdesign", *sys.argv[1:]])


def terminal_width() -> int | None:
    """Width of the terminal on stdout; None if stdout is no terminal."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


def wrapped(text: str, width: int | None) -> str:
    """A text whose longer lines are broken between words, further to the right; None: as it is."""
    if width is None:
        return text
    lines = []
    for line in text.split("\n"):
        indent = " " * (len(line) - len(line.lstrip()) + 2)
        broken = textwrap.wrap(
            line, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False, drop_whitespace=True
        )
        lines += broken or [line]
    return "\n".join(lines)


@contextlib.contextmanager
def terminable() -> Iterator[None]:
    """SIGTERM and SIGHUP raise `Signalled`, as Ctrl-C raises KeyboardInterrupt."""
    usual = {number: signal.signal(number, _terminate) for number in (signal.SIGTERM, *_hang_up())}
    try:
        yield
    finally:
        for number, handler in usual.items():
            signal.signal(number, handler)


def _hang_up() -> list[signal.Signals]:
    """SIGHUP, unless it is ignored, as under nohup."""
    return [] if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else [signal.SIGHUP]


def _terminate(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - as signal handlers are called
    # When a terminal is closed, the shell and the system both send it.
    signal.signal(number, signal.SIG_IGN if number == signal.SIGHUP else signal.SIG_DFL)
    raise _terminated()


def _terminated() -> Signalled:
    """The exception for SIGTERM, which a scheduler sends before it kills, and for SIGHUP: the race can be resumed."""
    return Signalled("Terminated.", EX_TEMPFAIL)


class Interrupt:
    """Handles Ctrl-C, SIGTERM and SIGHUP between experiments.

    If a signal handler raised an exception at once, a callback of a C library could swallow it. So the first signal is
    only recorded. The second one raises at once, except SIGHUP, which comes twice when a terminal is closed.

    Args:
        then: Called at the first signal.
        notice: Printed when `came` is first called after a signal.
        stopped: Printed if a signal has stopped an executor.
    """

    def __init__(
        self, *, then: Callable[[], None] = lambda: None, notice: str = "", stopped: str = "interrupted"
    ) -> None:
        self._came: int | None = None
        self._then = then
        self._notice = notice
        self._stopped = stopped

    def __enter__(self) -> Self:
        numbers = (signal.SIGINT, signal.SIGTERM, *_hang_up())
        self._usual = {number: signal.signal(number, self._note) for number in numbers}
        return self

    def __exit__(self, _: object, error: object, __: object) -> None:
        for number, handler in self._usual.items():
            signal.signal(number, handler)
        from mercator_design.race.executors.executor import ExecutorStopped  # not for `terminable`: numpy comes with it

        if isinstance(error, ExecutorStopped):
            self.check(self._stopped)

    def _note(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002 - as signal handlers are called
        is_first, self._came = self._came is None, number
        if is_first:  # another signal may come while this runs, when what it uses may be locked
            self._then()
        if number != signal.SIGHUP:
            signal.signal(number, self._usual[signal.Signals(number)])

    def came(self) -> bool:
        """Whether to stop."""
        if self._came is not None and self._notice:
            print_message(self._notice)
            self._notice = ""
        return self._came is not None

    def check(self, what: str) -> None:
        """Print a message and stop, if a signal came."""
        if self._came is not None:
            print_message(what)
            raise KeyboardInterrupt if self._came == signal.SIGINT else _terminated()
