"""`mercator-robot` in processes of its own: twins, and what talks with them."""

import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path

from mercator_design.twin.folder import LOG
from tests.robot.ways import MAIN

ROOT = Path(__file__).parents[2]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}
EXPLORE = "--nstates 1 --s0 0 --rwm0 20\n"


def start(*arguments, lead="", **streams):
    line = [sys.executable, "-c", lead + MAIN, *map(str, arguments)]
    return subprocess.Popen(line, env=ENVIRONMENT, text=True, **streams)


@contextlib.contextmanager
def first(process):
    """A process, or this thread (0), but not what it starts, runs before others where that is permitted."""
    with contextlib.suppress(OSError):
        os.sched_setscheduler(process, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(3))
    try:
        yield
    finally:
        with contextlib.suppress(OSError):  # it may have ended
            os.sched_setscheduler(process, os.SCHED_OTHER, os.sched_param(0))


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
