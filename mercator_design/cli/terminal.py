"""What the verbs share of talking to people: messages, Ctrl-C, and files that cannot be written."""

import contextlib
import shutil
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from os import EX_TEMPFAIL
from pathlib import Path
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Self

from mercator_design.command import Signalled, tell, warn
from mercator_design.errors import MercatorError

if TYPE_CHECKING:
    from mercator_design.fsm.modules import Module
    from mercator_design.sim.simulate import Simulator


def warn_of_doubts(simulator: "Simulator", flavour: str, modules: "Iterable[tuple[str, Module]]") -> None:
    """Say what makes no difference when a mission's robots run modules of a flavour."""
    from mercator_design.sim.doubts import doubts

    warn(doubts(simulator.mission, simulator.robot_model, flavour, modules))


def terminal_width() -> int | None:
    """Characters in a line of the terminal that stdout is; None if it is no terminal."""
    return shutil.get_terminal_size().columns if sys.stdout is not None and sys.stdout.isatty() else None


class Interrupt:
    """Ctrl-C while experiments run: noted at once, acted on between them; the second time acted on at once.

    An exception raised wherever the signal happens to arrive can be swallowed by a C library's callback.

    Args:
        terminable: Whether SIGTERM is noted too, and acted on by `Signalled`: as a
            scheduler sends it some time before it kills, what is done can be resumed.
        then: Called when one comes.
    """

    def __init__(self, *, terminable: bool = False, then: Callable[[], None] = lambda: None) -> None:
        self._came: int | None = None
        self._then = then
        self._numbers = [signal.SIGINT, *([signal.SIGTERM] if terminable else [])]

    def __enter__(self) -> Self:
        self._usual = {number: signal.signal(number, self._note) for number in self._numbers}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for number, handler in self._usual.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002 - as signal handlers are called
        self._came = number
        self._then()
        signal.signal(number, self._usual[signal.Signals(number)])

    def came(self) -> bool:
        """Whether to stop."""
        return self._came is not None

    def check(self, what: str) -> None:
        """Stop, and say what there is, if a signal came."""
        if self._came is not None:
            tell(what)
            raise KeyboardInterrupt if self._came == signal.SIGINT else Signalled("Terminated.", EX_TEMPFAIL)


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """What cannot be written is named as the user did."""
    try:
        yield
    except OSError as error:
        raise MercatorError(f"{path}: cannot be written: {error.strerror or error}") from None
