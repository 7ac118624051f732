import os
from functools import partial

import pytest

from mercator_design.robot.cli import main
from tests.robot.simulated import SimulatedDevices


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
