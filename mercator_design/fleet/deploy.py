"""Control software on many robots at once, over the system's ssh and scp.

A robot has in its folder the program, fsm.txt, its own robot.yaml if somebody has put one there, `logs`, `lock`, which
is held while something runs or is about to, and in `pid` the number of the process that runs.
"""

import secrets
import shlex
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

from mercator_design.errors import RobotError, SettingsError
from mercator_design.fleet.bundle import bundle
from mercator_design.loading import FieldError, Length, Name, Pattern, Range, read

PROGRAM, FSM = "mercator-robot.pyz", "fsm.txt"
_OPTIONS = {
    "BatchMode": "yes",
    "ConnectTimeout": "10",
    "LogLevel": "ERROR",
    "ServerAliveCountMax": "3",
    "ServerAliveInterval": "5",
}
_MOST = 100  # robots at a time

_HOLD = "exec 9>lock && flock -n 9 && rm -f pid"
"""Whether nothing is in progress; then nothing else begins before this script ends. A run keeps its start's lock."""
_BE_IDLE = f"""
if ! {{ {_HOLD}; }}; then echo 'a run is in progress; end it first: mdesign deploy --robots ... --stop' >&2; exit 1; fi
"""
_TAKE = f"""
{_BE_IDLE}
mv "$1"/{PROGRAM} "$1"/{FSM} . && rmdir "$1" && python3 {PROGRAM} --version
"""
_START = f"""
{_BE_IDLE}
[ -f robot.yaml ] && export MERCATOR_ROBOT=robot.yaml
mkdir -p logs || exit 1
name=logs/run-$(date +%Y%m%d-%H%M%S) number=
while [ -e "$name$number.jsonl" ] || [ -e "$name$number.txt" ]; do number=$((number - 1)); done
name=$name$number
setsid python3 {PROGRAM} run {FSM} -o "$name.jsonl" "$@" >"$name.txt" 2>&1 </dev/null &
echo $! >pid
for _ in $(seq 200); do
    if [ -s "$name.jsonl" ]; then echo "runs, $name.jsonl"; exit 0; fi
    if ! kill -0 $! 2>/dev/null; then wait $!; code=$?; tail -n 1 "$name.txt" >&2; exit $code; fi
    sleep 0.1
done
kill -TERM $!
echo "has not begun after 20 s, and was ended" >&2
exit 1
"""
_STOP = f"""
if {_HOLD}; then echo "nothing that deploy has started runs"; exit 0; fi
pid=
for _ in $(seq 50); do
    if [ -z "$pid" ] && [ -s pid ]; then pid=$(cat pid); kill -TERM "$pid"; fi
    sleep 0.1
    if {_HOLD}; then echo "stopped"; exit 0; fi
done
echo "process ${{pid:-that copies or starts}} has not ended after 5 s" >&2
exit 1
"""
_COUNT_LOGS = "ls logs 2>/dev/null | wc -l"


@dataclass(frozen=True, kw_only=True)
class Robot:
    """Where a robot is reached."""

    name: Name
    host: Annotated[
        str, Pattern(r"[A-Za-z0-9_:][A-Za-z0-9_.:-]*(%[A-Za-z0-9]+)?", "a name or address, or one of ~/.ssh/config")
    ]
    user: Annotated[str, Pattern(r"[A-Za-z0-9_][A-Za-z0-9_.-]*", "a user's name")] | None = None  # null: as ssh has it
    port: Annotated[int, Range(1, 65535)] | None = None  # of ssh; null: as ssh has it
    folder: Annotated[str, Pattern(r"/?[A-Za-z0-9_][A-Za-z0-9_./-]*", "a path in plain letters")] = "mercator"


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """The robots of an experiment."""

    schema: Literal[1] = 1  # version of this format
    robots: Annotated[tuple[Robot, ...], Length(1)]

    def __post_init__(self) -> None:
        names: set[str] = set()
        places: set[Robot] = set()
        for number, robot in enumerate(self.robots):
            place = replace(robot, name="")
            if robot.name in names:
                raise FieldError(f"robots[{number}].name", f"there are two robots {robot.name}")
            if place in places:
                raise FieldError(f"robots[{number}].host", "another robot is at the same place")
            names.add(robot.name)
            places.add(place)


@dataclass(frozen=True)
class Result:
    """What came of it on one robot."""

    robot: Robot
    is_done: bool
    words: str


def read_fleet(path: Path) -> Fleet:
    """The robots in a YAML file.

    Raises:
        SettingsError: with file, line, key, what was expected and what was found.
    """
    return read(path, Fleet, error=SettingsError)


def copy(fleet: Fleet, fsm: Path, timeout: float) -> list[Result]:
    """Put the program and an fsm.txt on all robots on which no run is in progress, as that may yet import something.

    Args:
        fleet: The robots.
        fsm: The file.
        timeout: [s] for each connection.
    """
    with tempfile.TemporaryDirectory() as folder:
        sent = [Path(folder, PROGRAM), Path(folder, FSM)]
        sent[0].write_bytes(bundle())
        sent[1].write_bytes(fsm.read_bytes())

        new = f"new/{secrets.token_hex(4)}"  # of this copy alone, as others may copy at the same time

        def to(robot: Robot) -> str:
            make = f"mkdir -p {robot.folder}/{new} && cd {robot.folder} || exit 1\n{_BE_IDLE}"
            _ssh(robot, make, timeout, folder=".")
            _run("scp", robot, [*map(str, sent), _on(robot, f"{new}/")], timeout)
            return _ssh(robot, _TAKE, timeout, [new])

        return _on_all(fleet, to)


def start(fleet: Fleet, options: Iterable[str], timeout: float) -> list[Result]:
    """Run what was copied on all robots, with options of `mercator-robot run`; done where its log has begun."""
    return _on_all(fleet, lambda robot: _ssh(robot, _START, timeout, options))


def stop(fleet: Fleet, timeout: float) -> list[Result]:
    """End what runs on all robots; done where it has ended."""
    return _on_all(fleet, lambda robot: _ssh(robot, _STOP, timeout))


def collect(fleet: Fleet, folder: Path, timeout: float) -> list[Result]:
    """Copy the logs of all robots, each robot's to a folder of its name."""

    def of(robot: Robot) -> str:
        count = _ssh(robot, _COUNT_LOGS, timeout)
        if count == "0":
            return "no logs"
        to = folder / robot.name
        to.mkdir(parents=True, exist_ok=True)
        # Absolute, as scp takes what has a colon before its first slash for a host.
        _run("scp", robot, ["-p", _on(robot, "logs/*"), str(to.resolve())], timeout)
        return f"{count} files in {to}"

    return _on_all(fleet, of)


def _on_all(fleet: Fleet, do: Callable[[Robot], str]) -> list[Result]:
    def one(robot: Robot) -> Result:
        try:
            return Result(robot, is_done=True, words=do(robot))
        except (RobotError, OSError) as error:
            return Result(robot, is_done=False, words=str(error))

    with ThreadPoolExecutor(min(_MOST, len(fleet.robots))) as pool:
        return list(pool.map(one, fleet.robots))


def _on(robot: Robot, path: str) -> str:
    """A path in a robot's folder, for scp; the brackets keep an IPv6 address from ending at its first colon."""
    return f"[{robot.host}]:{robot.folder}/{path}"


def _ssh(robot: Robot, script: str, timeout: float, arguments: Iterable[str] = (), folder: str | None = None) -> str:
    """Run a script of the shell in a robot's folder, or in another: the last line that it prints."""
    script = f"cd {folder or robot.folder} || exit 1\n{script}"
    return _run("ssh", robot, [robot.host, shlex.join(["sh", "-c", script, "sh", *arguments])], timeout)


def _run(program: str, robot: Robot, arguments: Sequence[str], timeout: float) -> str:
    """Run ssh or scp: the last line that it prints.

    Raises:
        RobotError: if it fails, with the last line of what it says.
    """
    given = {"User": robot.user, "Port": robot.port}
    settings = _OPTIONS | {name: str(value) for name, value in given.items() if value is not None}
    options = [word for name, value in settings.items() for word in ("-o", f"{name}={value}")]
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:  # what scp has begun might keep a pipe open
        try:
            done = subprocess.run(  # noqa: S603 - no shell here; the robot's file allows plain words only
                [program, *options, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                timeout=timeout,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise RobotError(f"{program}: not done after {timeout:g} s") from None
        except FileNotFoundError:
            raise RobotError(f"{program}: no such program here; install OpenSSH") from None
        said = []
        for file in (out, err):
            file.seek(0)
            said.append(file.read().decode(errors="replace").strip().rpartition("\n")[2])
    if done.returncode:
        raise RobotError(said[1] or said[0] or f"{program}: exit code {done.returncode}")
    return said[0]
