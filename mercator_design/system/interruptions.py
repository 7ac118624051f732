"""Ends a user's code: at an interruption, however it handles KeyboardInterrupt, or when it takes too long."""

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


@contextlib.contextmanager
def processor_limit(seconds: float) -> Iterator[None]:
    """Raise TimeoutError in a block of Python code that uses more time of the processor.

    Compiled code is not ended before it returns. Outside the main thread there is no limit.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        raise TimeoutError(f"it has not ended after {seconds:g} s; has it a loop that never ends?")

    usual = signal.signal(signal.SIGVTALRM, end)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, usual)
