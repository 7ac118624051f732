"""Prompts for the user beside the robot."""

import os
import select
import termios
from collections.abc import Callable

from mercator_design.command import print_message
from mercator_design.errors import RobotError

STDIN = 0
_TIMEOUT = 0.1  # [s] of waiting for a byte


def ask(what: str, meanwhile: Callable[[], None]) -> None:
    """Ask the user, or a script that writes a line, to do something; wait for Enter.

    `meanwhile` is called repeatedly, to read the devices.

    Raises:
        RobotError: at the end of the input.
    """
    if os.isatty(STDIN):
        termios.tcflush(STDIN, termios.TCIFLUSH)  # ignore what was typed before the prompt
    print_message(f"{what}, then press Enter.")
    while True:
        while not select.select([STDIN], [], [], _TIMEOUT)[0]:
            meanwhile()
        byte = os.read(STDIN, 1)  # the next line is the answer to another prompt
        if not byte:
            raise RobotError("the input has ended without Enter; nothing was changed")
        if byte == b"\n":
            meanwhile()
            return
