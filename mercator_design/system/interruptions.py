"""Distinguishes exceptions of signal handlers from those of a user's code, also KeyboardInterrupt."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType

_NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextlib.contextmanager
def signals_first() -> Iterator[None]:
    """Raise an exception of a signal handler at the end of the block, even if code in the block catches it.

    So the code may treat any other exception, also KeyboardInterrupt, as a failure of the function that it calls.
    Python calls handlers only in the main thread: in other threads this does nothing.
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
