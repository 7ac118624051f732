"""The errors that a user may see.

    MercatorError           exit code 1
      MissionError          3   a mission or robot-model file is not valid
      FsmError              3   a controller's text or structure is not a valid PFSM
      RaceError             1   a race cannot be run
      StudyError            2   a study's file or folder is not what it should be
      SimulationError       1   an experiment cannot be set up or went wrong
      ProtocolError         1   a command cannot be sent to a device
      RobotError            1   a device of the robot cannot be used
        SettingsError       3   the settings of a robot are not valid
        RobotStopped        4   a robot's wheels were stopped, or a port was lost

Each message names the place (file, line, key, token), what was expected and what was found. Any other exception is a
fault of this program.

Messages quote names, paths and texts of untrusted files: `printable` escapes what could control a terminal.
"""

import errno

ITEM = "  - "
"""Begins an item of a list in a message; commands print each item on a line of its own."""


def printable(text: str) -> str:
    """A text in one line, with control and invisible characters escaped."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def printable_lines(text: str) -> str:
    """A text of several lines, each printable."""
    return "\n".join(map(printable, text.split("\n")))


def excerpt(text: str) -> str:
    """The beginning of a text, short enough to quote."""
    return text if len(text) <= 60 else text[:57] + "..."


def described(error: BaseException, max_length: int = 300) -> str:
    """The class and the message of an error, with a maximum length."""
    try:
        text = str(error)
    except Exception:  # noqa: BLE001 - a user's class may raise anything
        text = ""
    return f"{type(error).__name__}: {text[:max_length]}" if text else type(error).__name__


class Signalled(BaseException):
    """A signal ends the program with an exit code."""

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code


def lack_of_memory(error: BaseException | None) -> BaseException | None:
    """The error, or its cause, that reports a lack of memory, also of a library or a thread; None if none does."""
    while error is not None:
        of_system = isinstance(error, OSError) and error.errno == errno.ENOMEM
        if of_system or isinstance(error, MemoryError) or any(words in str(error) for words in _NO_MEMORY):
            return error
        error = error.__cause__ or error.__context__
    return None


_NO_MEMORY = ("failed to map segment from shared object", "annot allocate memory", "can't start new thread")


class MercatorError(Exception):
    """Base of all errors that are reported to the user without a traceback.

    It has a printable message for each mistake; as text, one on each line.
    """

    exit_code = 1

    def __init__(self, message: str, *more: str) -> None:
        super().__init__(*map(printable, (message, *more)))

    def __str__(self) -> str:
        return "\n".join(self.messages)

    @property
    def messages(self) -> tuple[str, ...]:
        """A line for each mistake."""
        return self.args


class MissionError(MercatorError):
    """A mission or robot-model file is not valid."""

    exit_code = 3


class FsmError(MercatorError):
    """A controller's text or structure is not a valid PFSM."""

    exit_code = 3


class RaceError(MercatorError):
    """A race cannot be run."""


class StudyError(MercatorError):
    """A study's file is not valid, or its folder has another study."""

    exit_code = 2


class SimulationError(MercatorError):
    """An experiment cannot be set up, or failed."""


class ProtocolError(MercatorError):
    """A command cannot be sent to a device."""


class RobotError(MercatorError):
    """A device of the robot cannot be used.

    device: The device, by its name in `ports` of robot.yaml, with which the message begins; empty if there is none.
    """

    def __init__(self, message: str, *more: str, device: str = "") -> None:
        super().__init__(f"{device}: {message}" if device else message, *more)
        self.device = device


class SettingsError(RobotError):
    """The settings of a robot are not valid."""

    exit_code = 3


class RobotStopped(RobotError):  # noqa: N818 - stopping a swarm is no mistake
    """A robot's wheels were stopped; they stay stopped until the next run."""

    exit_code = 4
