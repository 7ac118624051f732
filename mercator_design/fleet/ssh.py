"""A robot over the system's ssh and scp: shell scripts, and copies of files."""

import contextlib
import os
import re
import selectors
import shlex
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import IO, Annotated

from mercator_design.config.schema import Name, Pattern, Range
from mercator_design.errors import RobotError
from mercator_design.robot.protocols.lines import LineSplitter

_OPTIONS = {
    "BatchMode": "yes",
    "ConnectTimeout": "10",
    "LogLevel": "ERROR",
    "ServerAliveCountMax": "3",
    "ServerAliveInterval": "5",
}
END_WAIT = 0.3  # [s] for ssh to end after its last output
_CHUNK = 65_536  # [bytes]
_OWN_FAULT = 255  # exit code of ssh if ssh itself has failed
# Lines of OpenSSH; other lines may follow, such as scp's.
_KEY_CHANGED = re.compile(r"^Host key for (\S+) has changed", re.MULTILINE)
_KEY_UNKNOWN = re.compile(r"^Host key verification failed|^No \S+ host key is known for", re.MULTILINE)
_REFUSED = re.compile(r"^.*: Permission denied \(.*publickey.*\)", re.MULTILINE)


@dataclass(frozen=True, kw_only=True)
class RemoteRobot:
    """The address of a robot."""

    name: Name
    host: Annotated[
        str, Pattern(r"[A-Za-z0-9_:][A-Za-z0-9_.:-]*(%[A-Za-z0-9]+)?", "a name or address, or one of ~/.ssh/config")
    ]
    user: Annotated[str, Pattern(r"[A-Za-z0-9_][A-Za-z0-9_.-]*", "a user's name")] | None = None  # null: as ssh has it
    port: Annotated[int, Range(1, 65535)] | None = None  # of ssh; null: as ssh has it
    folder: Annotated[
        str, Pattern(r"(?!.*/\.\.(/|$))/?[A-Za-z0-9_][A-Za-z0-9_./-]*", "a path in plain letters, without ..")
    ] = "mercator"


class Conversation:
    """A shell script in the folder of a robot, with a dialogue line by line.

    has_ended: Whether ssh has ended.
    words: The last line of stderr then, or what to do if a key is not accepted.
    """

    def __init__(self, robot: RemoteRobot, script: str, arguments: Iterable[str] = ()) -> None:
        """Start the script; Ctrl-C here does not reach it.

        Raises:
            RobotError: if there is no ssh.
        """
        self.has_ended, self.words = False, ""
        self._robot = robot
        self._splitter = LineSplitter()
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - until `close`
        try:
            self._process = subprocess.Popen(  # noqa: S603 - no shell here; the robot's file allows plain words only
                _command("ssh", robot, _shell(robot, script, arguments)),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                bufsize=0,
                start_new_session=True,
            )
        except FileNotFoundError:
            self._errors.close()
            raise _missing("ssh") from None
        assert self._process.stdin is not None  # noqa: S101 - pipes
        assert self._process.stdout is not None  # noqa: S101
        self._in, self._out = self._process.stdin, self._process.stdout

    def fileno(self) -> int:
        """The file descriptor of its output, for select."""
        return self._out.fileno()

    def read(self) -> list[bytes] | None:
        """Wait for lines, and return them; None if the conversation has ended."""
        data = os.read(self.fileno(), _CHUNK)
        if not data:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(END_WAIT)
            self.has_ended = True
            code = self._process.returncode
            has_not = "the connection has ended, ssh has not"
            self.words = _failure(self._errors, self._robot) or (has_not if code is None else f"ssh: exit code {code}")
            return None
        return self._splitter.receive(data)

    @property
    def is_known_to_have_ended(self) -> bool:
        """Whether the script has ended, and not only the connection."""
        code = self._process.returncode
        return self.has_ended and code is not None and 0 <= code < _OWN_FAULT

    def send(self, line: str) -> None:
        """Send a line; only an answer shows that it arrived."""
        with contextlib.suppress(OSError):
            self._in.write(line.encode())

    def close(self) -> None:
        """End the connection; the script may continue."""
        for pipe in (self._in, self._out):
            with contextlib.suppress(OSError):
                pipe.close()
        self._process.kill()
        self._process.wait()
        self._errors.close()


@contextlib.contextmanager
def conversing(
    robots: Iterable[RemoteRobot], script: str, arguments: Sequence[str]
) -> Iterator[dict[str, Conversation]]:
    """Conversations with robots at the same time, by name, which end on leaving; errors are those of `Conversation`."""
    with contextlib.ExitStack() as stack:
        yield {
            robot.name: stack.enter_context(contextlib.closing(Conversation(robot, script, arguments)))
            for robot in robots
        }


def hear(conversations: Mapping[str, Conversation], seconds: float) -> Iterator[tuple[str, list[bytes] | None]]:
    """The lines of conversations that have not ended, by name; None if one ends now. Wait at most `seconds`."""
    with selectors.DefaultSelector() as selector:
        for name, each in conversations.items():
            if not each.has_ended:
                selector.register(each, selectors.EVENT_READ, name)
        ready = [key.data for key, _ in selector.select(seconds)]
    for name in ready:
        yield name, conversations[name].read()


def on(robot: RemoteRobot, path: str) -> str:
    """A path in a robot's folder, for scp; the brackets are for IPv6 addresses, which have colons."""
    return f"[{robot.host}]:{robot.folder}/{path}"


def shell(
    robot: RemoteRobot, script: str, timeout: float, arguments: Iterable[str] = (), folder: str | None = None
) -> str:
    """Run a script of the shell in a robot's folder, or in another: the last line that it prints; errors as `run`."""
    return run("ssh", robot, _shell(robot, script, arguments, folder), timeout)


def run(program: str, robot: RemoteRobot, arguments: Sequence[str], timeout: float) -> str:
    """Run ssh or scp: the last line that it prints.

    Raises:
        RobotError: if it fails, with the last line of what it says, or what to do if a key is not accepted.
    """
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:  # children of scp might keep a pipe open
        try:
            done = subprocess.run(  # noqa: S603 - no shell here; the robot's file allows plain words only
                _command(program, robot, arguments),
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                timeout=timeout,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise RobotError(f"{program}: not done after {timeout:g} s") from None
        except FileNotFoundError:
            raise _missing(program) from None
        said = _last_line(out)
        if done.returncode:
            raise RobotError(_failure(err, robot) or said or f"{program}: exit code {done.returncode}")
    return said


def _shell(robot: RemoteRobot, script: str, arguments: Iterable[str], folder: str | None = None) -> list[str]:
    """The arguments of ssh for a script of the shell."""
    script = f"cd {folder or robot.folder} || exit 1\n{script}"
    return [robot.host, shlex.join(["sh", "-c", script, "sh", *arguments])]


def _command(program: str, robot: RemoteRobot, arguments: Sequence[str]) -> list[str]:
    given = {"User": robot.user, "Port": robot.port}
    settings = _OPTIONS | {name: str(value) for name, value in given.items() if value is not None}
    return [program, *(word for name, value in settings.items() for word in ("-o", f"{name}={value}")), *arguments]


def _missing(program: str) -> RobotError:
    return RobotError(f"{program}: no such program here; install OpenSSH")


def _last_line(file: IO[bytes]) -> str:
    return _text(file).rpartition("\n")[2]


def _failure(errors: IO[bytes], robot: RemoteRobot) -> str:
    """Why ssh or scp has failed, by what it says: its last line, or what to do if a key is not accepted."""
    said = _text(errors)
    user = "" if robot.user is None else f"{robot.user}@"
    host = ("" if robot.port is None else f"-p {robot.port} ") + user + robot.host
    if changed := _KEY_CHANGED.search(said):
        return (
            "its host key has changed: if it was installed anew, or has the address of another computer, "
            f"`ssh-keygen -R '{changed[1]}'`, then log in once by hand: `ssh {host}`"
        )
    if _KEY_UNKNOWN.search(said):
        return f"its host key is not known here: log in once by hand and accept it: `ssh {host}`"
    if refused := _REFUSED.search(said):
        return f"{refused[0]}: it accepts no key of yours: `ssh-copy-id {host}`"
    return said.rpartition("\n")[2]


def _text(file: IO[bytes]) -> str:
    file.seek(0)
    return file.read().decode(errors="replace").replace("\r", "").strip()
