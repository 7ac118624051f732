"""Ctrl-C and other signals, told apart from what the code of a user raises, be it KeyboardInterrupt."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType

_NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextlib.contextmanager
def signals_first() -> Iterator[None]:
    """What the handler of a signal raises in here comes out, whatever the code in here makes of it.

    So the code may take whatever else is raised, KeyboardInterrupt too, for a failure of what it calls. Python calls
    handlers in the main thread only: in others this does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    raised: list[BaseException] = []

    def noting(handler: Callable[[int, FrameType | None], object]) -> Callable[[int, FrameType | None], None]:
        def note(number: int, frame: FrameType | None) -> None:
            try:
                handler(number, frame)
            except BaseException as error:
                raised.append(error)
                raise

        return note

    usual = {number: handler for number in _NUMBERS if callable(handler := signal.getsignal(number))}
    ours = {number: noting(handler) for number, handler in usual.items()}
    try:
        for number, handler in ours.items():
            signal.signal(number, handler)
        yield
    finally:
        for number, handler in ours.items():
            if signal.getsignal(number) is handler:  # else the usual one has put another in its place
                signal.signal(number, usual[number])
        if raised:
            raise raised[0]
