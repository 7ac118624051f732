"""How far apart robots begin that `mdesign deploy --start` starts together: runs on a twin, on one machine.

`python benchmarks/joint_start.py` starts them again and again, and prints for each start when the first and the last
robot's treads were told to drive, by the twin's clock, and what the deploying program has measured by robots' clocks.
ssh is played by a shell on this machine: the network adds to the uncertainty of clocks, not to the spread.
"""

import argparse
import json
import os
import stat
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from mercator_design.fleet.deploy import FSM, Fleet, copy, stop
from mercator_design.fleet.ssh import RemoteRobot
from mercator_design.fleet.start import start

GO = "--nstates 1 --s0 0 --rwm0 20\n"
LOCAL = """#!/bin/sh
while [ "${1#-}" != "$1" ]; do shift 2; done
cd "$(dirname "$0")/../$1" && shift && exec sh -c "$*"
"""
COPY = """#!/bin/sh
while [ "${1#-}" != "$1" ]; do shift 2; done
for last; do :; done
rest=${last#*]:}; home=$(dirname "$0")/../$(echo "${last%%]:*}" | tr -d '[')
while [ $# -gt 1 ]; do cp "$1" "$home/$rest"; shift; done
"""


def first_drives(log: Path, since: float) -> dict[int, float]:
    """When the treads of each robot were first told to drive [s of the twin] after a time."""
    found: dict[int, float] = {}
    for line in log.read_text().splitlines():
        event = json.loads(line)
        if event["event"] == "wheels" and event["time"] > since and (event["left"] or event["right"]):
            found.setdefault(event["robot"], event["time"])
    return found


def now_of(log: Path) -> float:
    """The latest time [s] in a twin's log."""
    return float(json.loads(log.read_text().splitlines()[-1])["time"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=5)
    parser.add_argument("--starts", type=int, default=10)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "bin").mkdir()
        for program, text in (("ssh", LOCAL), ("scp", COPY)):
            file = folder / "bin" / program
            file.write_text(text)
            file.chmod(file.stat().st_mode | stat.S_IXUSR)
        (folder / "bin/python3").symlink_to(sys.executable)
        os.environ["PATH"] = f"{folder / 'bin'}:{os.environ['PATH']}"
        os.environ.pop("PYTHONPATH", None)
        (folder / "fsm.txt").write_text(GO)
        fleet = Fleet(robots=tuple(RemoteRobot(name=f"r{k}", host=f"r{k}") for k in range(given.robots)))
        line = [sys.executable, "-m", "mercator_design.twin", "aggregation", "--set", f"robots={given.robots}"]
        with subprocess.Popen([*line, "--folder", folder / "twin"], stdout=subprocess.PIPE, text=True) as twin:
            if twin.stdout is None or not all(twin.stdout.readline() for _ in fleet.robots):
                sys.exit("the twin has not begun")
            try:
                for k, robot in enumerate(fleet.robots):
                    home = folder / robot.host / robot.folder
                    home.mkdir(parents=True)
                    (home / "robot.yaml").write_text((folder / f"twin/{k}/robot.yaml").read_text())
                for copied in copy(fleet, {FSM: (folder / "fsm.txt").read_bytes()}, 60.0):
                    if not copied.is_done:
                        sys.exit(copied.words)
                for number in range(given.starts):
                    measure(number, fleet, folder / "twin/twin.jsonl")
            finally:
                stop(fleet, 60.0)
                twin.terminate()


def measure(number: int, fleet: Fleet, log: Path) -> None:
    """Start all robots, stop them, and print how far apart they began."""
    since = now_of(log)
    started = start(fleet, ["--duration", "1"], 60.0, 0.1)
    if started.why:
        print(f"start {number}: refused: {started.why}", flush=True)
    else:
        time.sleep(0.5)
        drives = first_drives(log, since)
        seen = 1000.0 * (max(drives.values()) - min(drives.values()))
        print(
            f"start {number}: {len(drives)} robots drove within {seen:.0f} ms; by their clocks they began within "
            f"{1000.0 * started.spread:.1f} ms, give or take {1000.0 * started.uncertainty:.1f} ms",
            flush=True,
        )
    stop(fleet, 60.0)


if __name__ == "__main__":
    main()
