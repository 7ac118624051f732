"""The errors a user may meet.

    MercatorError           exit code 1
      MissionError          3   a mission or robot-model file does not say what it should
      FsmError              3   a controller's text or structure is not a valid PFSM
      RaceError             1   a race cannot be run as asked
      SimulationError       1   an experiment cannot be set up or went wrong
      ProtocolError         1   a device cannot be told what was asked
      RobotError            1   a device of the robot cannot be used
        SettingsError       3   the settings of a robot do not say what they should
        Stopped             4   something stopped a robot's wheels, or a port was lost

Each message names the place (file, line, key, token), what was expected and what was found. Anything else that
reaches a user is a fault of this program.

Names, paths and texts that messages quote come from strangers' files: `printable` keeps them from steering a terminal.
"""

import errno


def printable(text: str) -> str:
    """A text in one line, with all that a terminal would act on or not show written as an escape."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def printable_lines(text: str) -> str:
    """A text of several lines, each printable."""
    return "\n".join(map(printable, text.split("\n")))


def excerpt(text: str) -> str:
    """The beginning of a text, short enough to quote."""
    return text if len(text) <= 60 else text[:57] + "..."


def described(error: BaseException, most: int = 300) -> str:
    """The class of an error and what it says, at most so many characters of it."""
    try:
        text = str(error)
    except Exception:  # noqa: BLE001 - of a stranger's class, which may do anything
        text = ""
    return f"{type(error).__name__}: {text[:most]}" if text else type(error).__name__


class Signalled(BaseException):
    """A signal ends the program, with this exit code."""

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code


def lack_of_memory(error: BaseException | None) -> BaseException | None:
    """What of an error, and of those that it came of, says that there was no memory, for a library or a thread, too."""
    while error is not None:
        of_system = isinstance(error, OSError) and error.errno == errno.ENOMEM
        if of_system or isinstance(error, MemoryError) or any(words in str(error) for words in _NO_MEMORY):
            return error
        error = error.__cause__ or error.__context__
    return None


_NO_MEMORY = ("failed to map segment from shared object", "annot allocate memory", "can't start new thread")


class MercatorError(Exception):
    """Base of all errors that are reported to the user without a traceback.

    It has a message for each mistake, made printable; as text they are lines.
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
    """A mission or robot-model file does not say what it should."""

    exit_code = 3


class FsmError(MercatorError):
    """A controller's text or structure is not a valid PFSM."""

    exit_code = 3


class RaceError(MercatorError):
    """A race cannot be run as asked."""


class SimulationError(MercatorError):
    """An experiment cannot be set up or went wrong."""


class ProtocolError(MercatorError):
    """A device cannot be told what was asked."""


class RobotError(MercatorError):
    """A device of the robot cannot be used.

    device: Which, of the ports of robot.yaml, with which the message begins; empty if it is not of one device.
    """

    def __init__(self, message: str, *more: str, device: str = "") -> None:
        super().__init__(f"{device}: {message}" if device else message, *more)
        self.device = device


class SettingsError(RobotError):
    """The settings of a robot do not say what they should."""

    exit_code = 3


class RobotStopped(RobotError):  # noqa: N818 - a swarm that is told to stop has made no error
    """Something stopped a robot's wheels; they turn no more before the next run."""

    exit_code = 4
