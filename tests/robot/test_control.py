"""Control of a robot: what counts as a time in which nobody listened."""

import time

from mercator_design.robot.run.control import Control
from mercator_design.robot.run.safety import STALL


class Robot:
    """Takes three seconds to start, by a clock of its own."""

    def __init__(self):
        self.now = 100.0
        self.times_sensed_anew = 0

    def start(self):
        self.now += 3.0

    def sense_anew(self):
        self.times_sensed_anew += 1


def test_starting_up_is_no_hold_up(monkeypatch):
    robot = Robot()
    monkeypatch.setattr(time, "monotonic", lambda: robot.now)
    control = Control(robot, None, None)
    control.start()
    control.refresh()
    assert robot.times_sensed_anew == 0
    robot.now += 1.1 * STALL
    control.refresh()
    assert robot.times_sensed_anew == 1
