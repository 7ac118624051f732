from functools import partial

import pytest

from mercator_design.robot.cli import main


@pytest.fixture
def robot_command(run_command):
    """Run mercator-robot with arguments."""
    return partial(run_command, "mercator-robot", main)
