import os
from functools import partial

import pytest

from mercator_design.robot.cli import main
from mercator_design.robot.setup import computer
from tests.robot.simulated import SimulatedDevices, SimulatedRun


@pytest.fixture
def robot_command(run_command):
    """Run mercator-robot with arguments."""
    return partial(run_command, "mercator-robot", main)


@pytest.fixture(autouse=True)
def as_urgent_as_others():
    """A run in this process lets it go before all others, and a program of its own would end then."""
    yield
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


@pytest.fixture
def simulated():
    """A robot's devices in simulated time."""
    with SimulatedDevices() as devices:
        yield devices


@pytest.fixture
def robot(simulated, robot_command, tmp_path, monkeypatch):
    """A run in simulated time, in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    simulated.wall = 2.0
    return SimulatedRun(simulated, robot_command, tmp_path)


@pytest.fixture
def processes(tmp_path, monkeypatch):
    """Sets what else runs: names and arguments."""
    folder = tmp_path / "proc"
    folder.mkdir()
    monkeypatch.setattr(computer, "PROCESSES", folder)
    monkeypatch.setattr(computer, "RULES", tmp_path / "99-mercator.rules")
    monkeypatch.setattr(computer, "TIMESYNC", tmp_path / "timesync")
    monkeypatch.setattr(computer, "RASPI_CONFIG", tmp_path / "raspi-config")

    def run(*lines):
        for number, (name, *arguments) in enumerate(map(str.split, lines)):
            (folder / str(number)).mkdir()
            (folder / str(number) / "comm").write_text(f"{name}\n")
            (folder / str(number) / "cmdline").write_text("\0".join([f"/usr/sbin/{name}", *arguments, ""]))

    return run
