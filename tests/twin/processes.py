"""`mercator-robot` in processes of its own: twins, and what talks with them."""

import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path

from mercator_design.twin.terminals import LOG

ROOT = Path(__file__).parents[2]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}
EXPLORE = "--nstates 1 --s0 0 --rwm0 20\n"
COMMAND = [sys.executable, "-c", "from mercator_design.robot.cli import main; main()"]


def start(*arguments, **streams):
    return subprocess.Popen([*COMMAND, *map(str, arguments)], env=ENVIRONMENT, text=True, **streams)


@contextlib.contextmanager
def twin(folder, robots, *arguments):
    line = ["twin", "aggregation", "--no-noise", "--folder", folder, "--set", f"robots={robots}", *arguments]
    with start(*line, stdout=subprocess.PIPE) as process:
        try:
            for _ in range(robots):
                assert process.stdout.readline().startswith("robot ")
            yield process
        finally:
            process.terminate()


def events(folder, kind):
    lines = map(json.loads, (folder / LOG).read_text().splitlines())
    return [event for event in lines if event["event"] == kind]
