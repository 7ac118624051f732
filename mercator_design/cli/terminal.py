"""What the verbs share of talking to people: messages, Ctrl-C, and files that cannot be written."""

import contextlib
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Self, TextIO

import click

from mercator_design.errors import MercatorError, printable

if TYPE_CHECKING:
    from mercator_design.fsm.modules import Module
    from mercator_design.sim.simulate import Simulator


def tell(message: str) -> None:
    """Say something that is no result, if there is still somebody to hear it."""
    try:
        click.echo(printable(message), err=True)
    except OSError:  # such as that the terminal was closed
        discard(sys.stderr)


def discard(stream: TextIO) -> None:
    """Let what could not be written, and would be tried again at the end, go nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def warn(doubts: Iterable[str]) -> None:
    """Say what may not be meant."""
    for doubt in doubts:
        tell(f"Warning: {doubt}")


def warn_of_doubts(simulator: "Simulator", flavour: str, modules: "Iterable[tuple[str, Module]]") -> None:
    """Say what makes no difference when a mission's robots run modules of a flavour."""
    from mercator_design.sim.doubts import doubts

    warn(doubts(simulator.mission, simulator.robot_model, flavour, modules))


def terminal_width() -> int | None:
    """Characters in a line of the terminal that stdout is; None if it is no terminal."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


class Terminated(BaseException):
    """SIGTERM came, as a scheduler sends it some time before it kills, or SIGHUP, as a terminal that is closed does."""


@contextlib.contextmanager
def terminable() -> Iterator[None]:
    """SIGTERM and SIGHUP are `Terminated`, as Ctrl-C is KeyboardInterrupt."""
    usual = {number: signal.signal(number, _terminate) for number in (signal.SIGTERM, *_hang_up())}
    try:
        yield
    finally:
        for number, handler in usual.items():
            signal.signal(number, handler)


def _hang_up() -> list[signal.Signals]:
    """SIGHUP, unless it is ignored, as nohup has it."""
    return [] if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else [signal.SIGHUP]


def _terminate(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - as signal handlers are called
    if number == signal.SIGHUP:  # the shell and the system both send it
        signal.signal(number, signal.SIG_IGN)
    raise Terminated


class Interrupt:
    """Ctrl-C, SIGTERM and SIGHUP while experiments run: noted at once, acted on between them.

    An exception raised wherever the signal happens to arrive can be swallowed by a C library's callback. The second
    time it is raised at once, but for SIGHUP, which comes twice when a terminal is closed.

    Args:
        then: Called when one comes.
    """

    def __init__(self, *, then: Callable[[], None] = lambda: None) -> None:
        self._came: int | None = None
        self._then = then

    def __enter__(self) -> Self:
        numbers = (signal.SIGINT, signal.SIGTERM, *_hang_up())
        self._usual = {number: signal.signal(number, self._note) for number in numbers}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for number, handler in self._usual.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002 - as signal handlers are called
        self._came = number
        self._then()
        if number != signal.SIGHUP:
            signal.signal(number, self._usual[signal.Signals(number)])

    def came(self) -> bool:
        """Whether to stop."""
        return self._came is not None

    def check(self, what: str) -> None:
        """Stop, and say what there is, if a signal came."""
        if self._came is not None:
            tell(what)
            raise KeyboardInterrupt if self._came == signal.SIGINT else Terminated


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """What cannot be written is named as the user did."""
    try:
        yield
    except OSError as error:
        raise MercatorError(f"{path}: cannot be written: {error.strerror or error}") from None
