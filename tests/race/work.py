"""What executors run in tests. Workers import this module, so it imports little."""

import os
import signal
import sys
import time

from mercator_design import jit
from mercator_design.errors import MissionError

SLOW = 0.03
"""Seconds of `slow`."""


def square(x):
    time.sleep(0.01 * (x % 3 == 0))
    return x * x


def compiles(x):
    """As if something were not in the cache of compiled code."""
    jit._missed()
    return x


def slow(x):
    time.sleep(SLOW)
    return x


def fails(x):
    if x == 3:
        raise MissionError("three is not allowed")
    if x == 4:
        return 1 / 0
    if x == 5:
        raise Stubborn(lambda: None)
    return x


class FailsInSteps:
    """Doubles in three steps; three items fail."""

    def in_steps(self, x):
        for k, step in enumerate(("first", "second", "last"), start=3):
            if x == k:
                raise ValueError(f"{step} step")
            if step != "last":
                yield
        return 2 * x

    def __call__(self, x):
        steps = self.in_steps(x)
        while True:
            try:
                next(steps)
            except StopIteration as end:
                return end.value


class Stubborn(Exception):  # noqa: N818
    """Cannot be carried to another process."""


class Leave(BaseException):
    """As a library may have it."""


class Mute(Exception):  # noqa: N818
    """Cannot say what is wrong."""

    def __str__(self):
        raise ValueError


def leaves(x):
    """Raises what would end a program."""
    match x:
        case 1:
            sys.exit(0)
        case 2:
            raise KeyboardInterrupt
        case 3:
            raise Leave("now")
        case 4:
            raise Mute
    return x


class Dies:
    """Kills its process at some items: always, or as long as a file is not there."""

    def __init__(self, folder, *, always):
        self.folder = folder
        self.always = always

    def __call__(self, x):
        if x in self.always:
            os.kill(os.getpid(), signal.SIGKILL)
        mark = self.folder / str(x)
        if x == 2 and not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return x


class DiesLate(Dies):
    """When others wait for the same worker."""

    def __call__(self, x):
        time.sleep(0.3)
        return super().__call__(x)


class Hangs(Dies):
    """The same, but it never ends."""

    def __call__(self, x):
        mark = self.folder / str(x)
        if x in self.always or (x == 2 and not mark.exists()):
            with mark.open("a") as marks:
                marks.write("hangs\n")
            time.sleep(600)
        return x


def refuse():
    raise ValueError("another version")


class Refused:
    def __call__(self, x):
        return x

    def __reduce__(self):
        return refuse, ()


def die():
    os.kill(os.getpid(), signal.SIGKILL)


class DiesLoading:
    """Kills the process that loads it."""

    def __call__(self, x):
        return x

    def __reduce__(self):
        return die, ()


def process_of(_):
    return os.getpid()


def task_of(_):
    """The task of a Dask worker that this is part of."""
    from distributed import get_worker

    return get_worker().get_current_task()


def survives(number):
    os.kill(os.getpid(), number)
    return True


def begins(folder, _):
    """Takes ten minutes, unless it is let go."""
    (folder / "began").touch()
    end = time.monotonic() + 600
    while not (folder / "go").exists() and time.monotonic() < end:
        time.sleep(0.01)
    if time.monotonic() >= end:
        (folder / "ended").touch()
