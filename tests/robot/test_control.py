"""Control of a robot: what counts as a time in which nobody listened, and its end."""

import contextlib
import os
import signal
import sys
import time

from mercator_design.errors import Signalled
from mercator_design.robot.devices.settings import Settings, SwarmSettings
from mercator_design.robot.run.control import Control, in_control
from mercator_design.robot.run.mercator import Mercator
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


@contextlib.contextmanager
def interrupted(after):
    """SIGTERM comes when so many lines of the end have run after the context, if it still means something then."""
    has_begun = False

    def trace(frame, event, _argument):
        nonlocal after, has_begun
        has_begun = has_begun or frame.f_code is in_control.__wrapped__.__code__
        after -= has_begun and event == "line"
        if after == 0 and callable(signal.getsignal(signal.SIGTERM)):
            os.kill(os.getpid(), signal.SIGTERM)
        return trace

    yield
    sys.settrace(trace)


def test_a_signal_at_any_time_of_the_end_leaves_no_robot_running(simulated, monkeypatch):
    closed, interruptions = [], 0
    # Python drops what callbacks of garbage collection and of weak references raise; the brake is pulled before.
    monkeypatch.setattr(sys, "unraisablehook", lambda _: None)

    def close(robot):
        closed.append(robot)

    monkeypatch.setattr(Mercator, "start", lambda _: None)
    monkeypatch.setattr(Mercator, "close", close)
    settings = Settings(ports=simulated.names, swarm=SwarmSettings(port=None))
    for number in range(1, 100):
        try:
            with in_control(settings, [], {"black": (0, 0, 0)}, None), interrupted(number):
                pass
        except Signalled:
            interruptions += 1
        finally:
            sys.settrace(None)
        assert len(closed) == number
    assert interruptions > 5
