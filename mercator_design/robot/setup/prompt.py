"""Whoever stands beside the robot and does what it cannot do by itself."""

import os
import select
import termios
from collections.abc import Callable

from mercator_design.command import print_message
from mercator_design.errors import RobotError

_STDIN = 0
_LOOK = 0.1  # [s]


def ask(what: str, meanwhile: Callable[[], None]) -> None:
    """Ask the user, or a script that writes a line, to do something; wait for Enter.

    Args:
        what: To do.
        meanwhile: Called again and again, as devices must be heard.

    Raises:
        RobotError: at the end of the input.
    """
    if os.isatty(_STDIN):
        termios.tcflush(_STDIN, termios.TCIFLUSH)  # Enter that was pressed too often is no answer
    print_message(f"{what}, then press Enter.")
    while True:
        while not select.select([_STDIN], [], [], _LOOK)[0]:
            meanwhile()
        byte = os.read(_STDIN, 1)  # not more, as a line further is the answer to another question
        if not byte:
            raise RobotError("no Enter: the input has ended; nothing was changed")
        if byte == b"\n":
            meanwhile()
            return
