"""What signals raise, told apart from what code raises."""

import contextlib
import os
import signal
import threading

import pytest

from mercator_design.cli.terminal import Interrupt
from mercator_design.system.interruptions import signals_first


def interrupt():
    os.kill(os.getpid(), signal.SIGINT)


def swallow():
    with contextlib.suppress(BaseException):  # as a user may have it
        interrupt()


def replace():
    try:
        interrupt()
    except BaseException:  # noqa: BLE001 - as a user may have it
        raise ValueError from None


@pytest.mark.parametrize("work", [interrupt, swallow, replace])
def test_a_signal_comes_out(work):
    usual = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), signals_first():
        work()
    assert signal.getsignal(signal.SIGINT) is usual


def stop(kind):
    try:
        raise kind  # noqa: TRY301 - this is what is tested
    except BaseException:  # noqa: BLE001 - as a user may have it
        raise ArithmeticError from None


@pytest.mark.parametrize("kind", [KeyboardInterrupt, ValueError])
def test_what_code_raises_can_be_taken(kind):
    with pytest.raises(ArithmeticError), signals_first():
        stop(kind)


def test_a_handler_that_notes_it_and_makes_way_for_another():
    noted = []
    usual = signal.getsignal(signal.SIGINT)

    def note(number, _):
        noted.append(number)
        signal.signal(number, signal.SIG_IGN)

    signal.signal(signal.SIGINT, note)
    try:
        with signals_first():
            interrupt()
            interrupt()
        assert noted == [signal.SIGINT]
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        with signals_first():
            interrupt()
    finally:
        signal.signal(signal.SIGINT, usual)


def test_another_thread_has_none():
    found = []

    def work():
        with signals_first():
            found.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [signal.getsignal(signal.SIGINT)]


def test_a_signal_that_comes_while_another_is_handled():
    """What is called at the first one may hold a lock that it would wait for."""
    calls = []

    def then():
        calls.append(signal.SIGTERM)
        if len(calls) < 9:
            os.kill(os.getpid(), signal.SIGHUP)
            os.kill(os.getpid(), signal.SIGHUP)

    with Interrupt(then=then) as interrupt:
        os.kill(os.getpid(), signal.SIGTERM)
        assert interrupt.came()
    assert calls == [signal.SIGTERM]
