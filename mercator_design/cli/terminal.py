"""What the verbs share of talking to people: messages, Ctrl-C, and files that cannot be written."""

import contextlib
import shutil
import signal
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import FrameType, TracebackType
from typing import Self

import click

from mercator_design.errors import MercatorError, printable


def tell(message: str) -> None:
    """Say something that is no result."""
    click.echo(printable(message), err=True)


def warn(doubts: Iterable[str]) -> None:
    """Say what may not be meant."""
    for doubt in doubts:
        tell(f"Warning: {doubt}")


def terminal_width() -> int | None:
    """Characters in a line of the terminal that stdout is; None if it is no terminal."""
    return shutil.get_terminal_size().columns if sys.stdout is not None and sys.stdout.isatty() else None


class Interrupt:
    """Ctrl-C while experiments run: noted at once, acted on between batches; the second time acted on at once.

    An exception raised wherever the signal happens to arrive can be swallowed by a C library's callback.
    """

    def __init__(self) -> None:
        self._came = False

    def __enter__(self) -> Self:
        self._usual = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        signal.signal(signal.SIGINT, self._usual)

    def _note(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002 - as signal handlers are called
        self._came = True
        signal.signal(signal.SIGINT, self._usual)

    def check(self, what: str) -> None:
        """Stop, and say what there is, if Ctrl-C came."""
        if self._came:
            tell(what)
            raise KeyboardInterrupt


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """What cannot be written is named as the user did."""
    try:
        yield
    except OSError as error:
        raise MercatorError(f"{path}: cannot be written: {error.strerror or error}") from None
