"""What the verbs share of talking to people: messages and Ctrl-C."""

import contextlib
import shutil
import signal
import sys
from collections.abc import Callable, Iterator
from os import EX_TEMPFAIL
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Self

from mercator_design.command import print_message, warn
from mercator_design.errors import Signalled

if TYPE_CHECKING:
    from mercator_design.fsm.pfsm import Pfsm
    from mercator_design.sim.simulate import Simulator


def warn_of_no_effect(simulator: "Simulator", flavour: str, pfsm: "Pfsm | None" = None) -> None:
    """Say what makes no difference when a mission's robots run a PFSM, or any of a flavour."""
    from mercator_design.sim.checks.no_effect import no_effect_warnings

    warn(no_effect_warnings(simulator.mission, simulator.robot_model, flavour, pfsm))


def warn_of_mission(simulator: "Simulator", *, refuse: bool) -> None:
    """Say what of a mission cannot be, or is hardly meant.

    Raises:
        MissionError: of what cannot be, if that is to be refused.
    """
    warn(warning.message for warning in simulator.warnings if not (refuse and warning.is_impossible))
    if refuse:
        simulator.refuse_impossible()


def terminal_width() -> int | None:
    """Characters in a line of the terminal that stdout is; None if it is no terminal."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


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
    """SIGHUP, unless it is ignored, as nohup has it."""
    return [] if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else [signal.SIGHUP]


def _terminate(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - as signal handlers are called
    # When a terminal is closed, the shell and the system both send it.
    signal.signal(number, signal.SIG_IGN if number == signal.SIGHUP else signal.SIG_DFL)
    raise _terminated()


def _terminated() -> Signalled:
    """Of SIGTERM, as a scheduler sends it some time before it kills, or of SIGHUP: what is done can be resumed."""
    return Signalled("Terminated.", EX_TEMPFAIL)


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
            print_message(what)
            raise KeyboardInterrupt if self._came == signal.SIGINT else _terminated()
