"""Control software on many robots at once, over the system's ssh and scp.

The folder of a robot has the program, fsm.txt, its own robot.yaml if a user has put one there, `logs`, `lock`, which is
held while a run is in progress or starts, and `pid` with the number of the process that runs.
"""

import posixpath
import secrets
import tempfile
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

from mercator_design.config.loading import read
from mercator_design.config.schema import FieldError, Length, checked
from mercator_design.errors import RobotError, SettingsError
from mercator_design.fleet.bundle import bundle
from mercator_design.fleet.ssh import RemoteRobot, on, run, shell
from mercator_design.software.needed import FLAVOUR_FILE, PLUGINS

PROGRAM, FSM = "mercator-robot.pyz", "fsm.txt"
_MAX_CONNECTIONS = 100  # at a time

_HOLD = "exec 9>lock && flock -n 9 && rm -f pid"
"""Succeeds if nothing is in progress; then nothing else starts before this script ends. A run keeps its lock."""
BE_IDLE = f"""
if ! {{ {_HOLD}; }}; then echo 'a run is in progress; end it first: mdesign deploy --robots ... --stop' >&2; exit 1; fi
"""
_TAKE = f"""
trap 'rm -rf "$1"' EXIT
{BE_IDLE}
find new -mindepth 1 -maxdepth 1 -mmin +60 -exec rm -rf {{}} +
if [ -f "$1/{FSM}" ]; then rm -rf {FLAVOUR_FILE} {PLUGINS}; fi
mv "$1"/* . && python3 {PROGRAM} --version
"""
"""Also removes what copies that failed more than an hour ago have left."""
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
_COUNT_LOGS = "find logs/* -type f 2>/dev/null | wc -l"


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """The robots of an experiment."""

    schema: Literal[1] = 1  # version of this format
    robots: Annotated[tuple[RemoteRobot, ...], Length(1)]

    def __post_init__(self) -> None:
        checked(self._mistakes())

    def _mistakes(self) -> Iterator[FieldError]:
        names: set[str] = set()
        places: set[RemoteRobot] = set()
        for number, robot in enumerate(self.robots):
            place = replace(robot, name="", host=robot.host.lower(), folder=posixpath.normpath(robot.folder))
            if robot.name in names:
                yield FieldError(f"robots[{number}].name", f"there are two robots {robot.name}")
            if place in places:
                yield FieldError(f"robots[{number}].host", "another robot is at the same place")
            names.add(robot.name)
            places.add(place)


@dataclass(frozen=True)
class RobotOutcome:
    """The outcome on one robot."""

    robot: RemoteRobot
    is_done: bool
    words: str


def read_fleet(path: Path) -> Fleet:
    """The robots in a YAML file.

    Raises:
        SettingsError: with file, line, key, what was expected and what was found.
    """
    return read(path, Fleet, error=SettingsError)


def copy(fleet: Fleet, files: Mapping[str, bytes], timeout: float) -> list[RobotOutcome]:
    """Copy the program and files to all robots without a run in progress, which may still import modules.

    Args:
        fleet: The robots.
        files: Contents of files by their paths there: FSM, with the flavour and plugins that it needs; none if only the
            program is to be copied.
        timeout: Time limit of each connection [s].
    """
    with tempfile.TemporaryDirectory() as folder:
        for name, data in {PROGRAM: bundle(), **files}.items():
            Path(folder, name).parent.mkdir(parents=True, exist_ok=True)
            Path(folder, name).write_bytes(data)
        sent = sorted(Path(folder).iterdir())
        new = f"new/{secrets.token_hex(4)}"  # of this copy only: others may copy at the same time

        def to(robot: RemoteRobot) -> str:
            make = f"mkdir -p {robot.folder} && cd {robot.folder} || exit 1\n{BE_IDLE}\nmkdir -p {new}"
            shell(robot, make, timeout, folder=".")
            run("scp", robot, ["-r", *map(str, sent), on(robot, f"{new}/")], timeout)
            return shell(robot, _TAKE, timeout, [new])

        return on_all(fleet, to)


def stop(fleet: Fleet, timeout: float) -> list[RobotOutcome]:
    """Stop the runs on all robots; done if the run has ended."""
    return on_all(fleet, lambda robot: shell(robot, _STOP, timeout))


def collect(fleet: Fleet, folder: Path, timeout: float) -> list[RobotOutcome]:
    """Copy the logs of each robot, with those in subfolders, to a folder of its name."""

    def of(robot: RemoteRobot) -> str:
        count = shell(robot, _COUNT_LOGS, timeout)
        if count == "0":
            return "no logs"
        to = folder / robot.name
        to.mkdir(parents=True, exist_ok=True)
        # Absolute: scp takes a name with a colon before its first slash as a host.
        run("scp", robot, ["-rp", on(robot, "logs/*"), str(to.resolve())], timeout)
        return f"{count} files in {to}"

    return on_all(fleet, of)


def on_all(fleet: Fleet, do: Callable[[RemoteRobot], str]) -> list[RobotOutcome]:
    """Call `do` for all robots at the same time; done if it returns a message and does not raise."""

    def one(robot: RemoteRobot) -> RobotOutcome:
        try:
            return RobotOutcome(robot, is_done=True, words=do(robot))
        except (RobotError, OSError) as error:
            return RobotOutcome(robot, is_done=False, words=str(error))

    with ThreadPoolExecutor(min(_MAX_CONNECTIONS, len(fleet.robots))) as pool:
        return list(pool.map(one, fleet.robots))
