"""A run on devices that a test has in hand; how soon wheels come to rest, whatever drove them.

Time that this machine takes to get to a process when it has much else to do is not the program's, so of a few attempts
the best counts.
"""

import functools
import itertools
import os
import socket
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

from mercator_design.robot.run.network import STOP
from tests.processes import LIMIT
from tests.robot.devices import Devices
from tests.robot.log_events import read

LATEST = 0.25
"""[s] from a fault to wheels at rest."""
ATTEMPTS = 5
BUSY = (
    "the control loop stalled",
    "too busy?",
    "no answer; ",
    "of the commands to it are answered",
    "arrives whole",
    "that a drive command does not end",
    "the start was not confirmed by all robots in time",
    "the time of the start came too late",
)
"""What a run ends with if it, or a test with its devices, does not get to a processor in time."""
GO = "--nstates 1 --s0 0 --rwm0 20"
ALL = "--nstates 2 --s0 2 --att0 2 --n0 1 --n0x0 0 --c0x0 2 --p0x0 0 --s1 0 --rwm1 5"
"""Drives, and reads every sense."""
LAST = "disable_notifications_and_active_commands"
"""What an RVR is told when nobody uses it any more."""

ARGUMENTS = ["fsm.txt", "--robot", "robot.yaml", "-o", "log.jsonl", "--seed", "1"]
"""Of a run, by the names of `write_files`."""

ROOT = Path(__file__).parents[2]
MAIN = "from mercator_design.robot.cli import main; main()"
WAITS = f"""
from mercator_design.robot.devices import link
from mercator_design.robot.run import control, mercator
link.TRIES = 2000
mercator.START_LIMIT = control.FIRST_HEARTBEAT = {LIMIT}
"""
"""Lets a program wait for answers, samples and a first heartbeat as long as threads of a busy machine may take."""
SOON = f"""{WAITS}
mercator.Mercator._watch_commands_end = lambda robot: setattr(robot, "_do_commands_end", True)
"""
"""The same, and start up sooner: it does not look whether commands run out, which tests of the start are about."""
IMPATIENT = "from mercator_design.robot.run import control; control.FIRST_HEARTBEAT = 0.5\n"
"""Lets a program not wait long for a first heartbeat."""
PATIENT = "from mercator_design.robot.run import control, safety; control.STALL = safety.STALL = 60.0\n"
"""Lets a control loop be late, as it may be on a busy machine, in tests that are not about that."""
LATE = "}\nlimits: {rvr: 10, proximity: 10, lidar: 10, rvr_whole: 0, proximity_whole: 0, lidar_whole: 0"
"""Further settings of a run: lets devices be late, and lose what they tell meanwhile, as `PATIENT` the control loop."""
SLOW = """
import time
from mercator_design.robot.run.mercator import Mercator
close = Mercator.close
Mercator.close = lambda robot: (close(robot), time.sleep(0.5))
"""
"""Lets a run keep its ports for a while after its end."""

# What a controller does from the moment on at which there is a file "fault"; it prints when that is.
FAULTS = """
import math, os, sys, time
from mercator_design.software import Controller
step = Controller.step
def faulty(self, readings, draws):
    if os.path.exists("fault"):
        print(time.monotonic(), flush=True)
        {fault}
    return step(self, readings, draws)
Controller.step = faulty
"""


def write_files(folder, names, fsm, port):
    """The fsm.txt and the robot.yaml of a run that hears the swarm at a port, with more settings of it."""
    (folder / "fsm.txt").write_text(fsm)
    (folder / "robot.yaml").write_text(
        f"ports: {{rvr: {names.rvr}, lidar: {names.lidar}, proximity: {names.proximity}}}\nswarm: {{port: {port}}}\n"
    )


class Robot:
    """A run of `mercator-robot` on devices."""

    def __init__(self, folder, devices, fsm, settings, fault, options, lead, stdin):
        self.folder, self.devices, self.port = folder, devices, free_port()
        write_files(folder, devices.names, fsm, f"{self.port}{settings}")
        script = lead + (FAULTS.format(fault=fault) if fault else "") + MAIN
        self.process = subprocess.Popen(
            [sys.executable, "-c", script, "run", *ARGUMENTS, *options],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdin=stdin,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def drives(self):
        """Wait until it has driven for some cycles."""
        self.until(lambda: self.devices.driven() > 1)

    def until(self, done):
        """Wait until something is so, as long as it runs."""
        self.devices.when(lambda: done() or self.process.poll() is not None)
        assert self.process.poll() is None, self.process.stderr.read()

    def fault(self):
        """Let the controller's fault begin; when it has [s]."""
        (self.folder / "fault").touch()
        began = self.process.stdout.readline()
        assert began, self.process.stderr.read()
        return float(began)

    def hears_stop(self, speaker):
        """Tell the swarm to stop, until it has ended."""
        self.devices.when(lambda: speaker.send(STOP) or self.process.poll() is not None)

    def cycles(self):
        """How many its log has."""
        return sum(event["event"] == "cycle" for event in read(self.folder / "log.jsonl"))

    def ended(self):
        """The exit code, and what was said."""
        _, error = self.process.communicate(timeout=LIMIT)
        return self.process.returncode, error


@contextmanager
def running(folder, fsm=GO, settings="", fault="", *options, lead=SOON, stdin=None):
    folder.mkdir(exist_ok=True)
    with Devices() as devices:
        devices.wall = 2.0
        robot = Robot(folder, devices, fsm, settings, fault, options, lead, stdin)
        try:
            yield robot
        finally:
            robot.process.kill()
            robot.process.communicate()


def check(robot, code, words, *, zeros=True):
    """How a run has ended."""
    returned, error = robot.ended()
    assert (returned, words in error) == (code, True), (returned, error)
    if zeros:
        stops = [name for _, name, _ in robot.devices.commands if name == "drive_stop"]
        assert len(stops) >= 2
        *_, end = read(robot.folder / "log.jsonl")
        assert end["event"] == "end"
        assert end["why"] in error
    return error


def in_time(attempt):
    """Make an attempt, and again if the machine was too busy for a run, as its assertions say then."""
    for number in range(ATTEMPTS):
        try:
            return attempt(number)
        except AssertionError as error:
            if not any(words in str(error) for words in BUSY) or number == ATTEMPTS - 1:
                raise
    return None


def made_in_time(test):
    """A test that is an attempt, each with a folder of its own."""

    @functools.wraps(test)
    def made(*arguments, tmp_path, **given):
        def attempt(number):
            folder = tmp_path / str(number)
            folder.mkdir()
            return test(*arguments, tmp_path=folder, **given)

        return in_time(attempt)

    return made


def soonest(attempt, most=LATEST):
    """The least of what an attempt takes, made again if it takes too long."""
    times, numbers = [], itertools.count()
    while len(times) < ATTEMPTS and (not times or min(times) > most):
        times.append(in_time(lambda _: attempt(next(numbers))))
    return min(times)


def asked(devices):
    """How often the robot was asked after its battery."""
    return [name for _, name, _ in devices.commands].count("get_battery_percentage")


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return probe.getsockname()[1]
