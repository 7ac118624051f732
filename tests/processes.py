"""Processes that tests start, and waiting for what they do."""

import contextlib
import os
import subprocess
import threading
import time

LIMIT = 600.0  # [s] only reached when something is wrong, however busy the machine is


@contextlib.contextmanager
def started(*command, **options):
    """A process of this command, killed at the end if it still runs: a failed assertion does not wait for it."""
    with subprocess.Popen([*map(str, command)], **{"text": True, **options}) as process:
        try:
            yield process
        finally:
            process.kill()


def wait_until(condition, limit=LIMIT):
    """Wait for a condition and return its value."""
    end = time.monotonic() + limit
    while not (value := condition()):
        assert time.monotonic() < end, f"not within {limit:g} s"
        time.sleep(0.01)
    return value


@contextlib.contextmanager
def signal_when(condition, number):
    """Send a signal to this process when a condition holds; what runs meanwhile must not end before that."""

    def send():
        wait_until(condition)
        os.kill(os.getpid(), number)

    thread = threading.Thread(target=send)
    thread.start()
    try:
        yield
    finally:
        thread.join()
