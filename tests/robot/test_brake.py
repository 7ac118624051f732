"""The brake: what passes it, and that nothing does after a stop, whoever pulls it and when."""

import math
import os
import signal
import sys
import threading
import time
import weakref

import pytest

from mercator_design.errors import RobotError, RobotStopped, Signalled
from mercator_design.robot.protocols import rvr
from mercator_design.robot.run.safety import STALL, Brake, Signals


class Wire:
    """What is sent: speeds, or "zero"."""

    def __init__(self):
        self.sent = []
        self.during = None  # what happens while a command is being sent
        self.is_lost = False

    def write(self, data):
        if self.is_lost:
            raise RobotError("rvr: lost")
        if self.during and data != b"zero":
            self.during()
        self.sent.append(data)


@pytest.fixture(autouse=True)
def passes(monkeypatch):
    """Lets time pass, which stands still otherwise."""
    now = [1000.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])

    def passes(seconds):
        now[0] += seconds

    return passes


@pytest.fixture
def wire():
    return Wire()


@pytest.fixture
def brake(wire):
    return Brake(wire.write, lambda left, right: f"{left:g} {right:g}".encode(), b"zero", 0.3)


def test_what_is_in_range_passes(wire, brake):
    brake.drive(0.3, -0.3)
    brake.drive(0.0, 0.1)
    assert wire.sent == [b"0.3 -0.3", b"0 0.1"]


@pytest.mark.parametrize("speeds", [(0.3001, 0.0), (0.0, -0.3001), (math.nan, 0.0), (0.0, math.nan), (math.inf, 0.0)])
def test_what_is_not_stops_for_good(wire, brake, speeds):
    with pytest.raises(RobotStopped, match="wheels: expected speeds from"):
        brake.drive(*speeds)
    assert wire.sent == [b"zero"] * 2
    with pytest.raises(RobotStopped, match="wheels"):
        brake.drive(0.1, 0.1)
    assert wire.sent == [b"zero"] * 2


def test_the_first_reason_stays_and_every_stop_is_sent(wire, brake):
    brake.stop("one")
    brake.stop("another")
    assert brake.why == "one"
    assert wire.sent == [b"zero"] * 4


def test_a_lost_line_raises_when_driving_and_not_when_stopping(wire, brake):
    wire.is_lost = True
    with pytest.raises(RobotError, match="lost"):
        brake.drive(0.1, 0.1)
    brake.stop("the end")
    assert brake.why == "the end"


def test_a_stop_waits_for_a_command_that_is_being_sent_but_not_for_long(wire, brake):
    """Another thread's stop, while a command to drive is stuck: zero has the last word."""

    def other():
        thread = threading.Thread(target=brake.stop, args=["stuck"])
        thread.start()
        thread.join()

    wire.during = other
    brake.drive(0.2, 0.2)
    assert wire.sent[:3] == [b"zero", b"zero", b"0.2 0.2"]
    assert wire.sent[3:] == [b"zero"] * 2


def test_a_stop_by_a_signal_handler_while_a_command_is_being_sent(wire, brake):
    wire.during = lambda: brake.stop("SIGTERM")
    brake.drive(0.2, 0.2)
    assert wire.sent[-2:] == [b"zero"] * 2


def test_a_loop_that_was_suspended_does_not_drive_again(wire, brake, passes):
    """It may go on before the watchdog does."""
    brake.arm()
    brake.drive(0.1, 0.1)
    passes(STALL + 0.02)
    with pytest.raises(RobotStopped, match=r"the control loop stalled: no command for 0\.20 s"):
        brake.drive(0.1, 0.1)
    assert wire.sent == [b"0.1 0.1", b"zero", b"zero"]


def test_nor_if_it_was_suspended_while_a_command_was_being_sent(wire, brake, passes):
    brake.arm()
    wire.during = lambda: passes(STALL + 0.02)
    brake.drive(0.1, 0.1)
    assert wire.sent[0] == b"0.1 0.1"
    assert set(wire.sent[1:]) == {b"zero"}
    with pytest.raises(RobotStopped, match="the control loop stalled"):
        brake.drive(0.1, 0.1)


def test_before_it_is_armed_commands_need_not_follow_each_other(wire, brake, passes):
    brake.drive(0.0, 0.0)
    passes(STALL + 0.02)
    brake.check_stall()
    brake.drive(0.0, 0.0)
    assert wire.sent == [b"0 0"] * 2


class TestRepeat:
    """Of a command that was damaged on its way."""

    def test_the_latest_once(self, wire, brake):
        assert not brake.repeat()  # there is none yet
        brake.drive(0.1, 0.1)
        brake.drive(0.2, 0.1)
        assert (brake.repeat(), brake.repeat()) == (True, False)
        brake.drive(0.2, 0.3)
        assert brake.repeat()
        assert wire.sent == [b"0.1 0.1", b"0.2 0.1", b"0.2 0.1", b"0.2 0.3", b"0.2 0.3"]

    def test_nothing_after_a_stop(self, wire, brake):
        brake.drive(0.1, 0.1)
        brake.stop("SIGTERM")
        assert not brake.repeat()
        assert wire.sent == [b"0.1 0.1", b"zero", b"zero"]

    def test_a_stop_while_it_is_being_sent_has_the_last_word(self, wire, brake):
        brake.drive(0.1, 0.1)
        wire.during = lambda: brake.stop("SIGTERM")
        brake.repeat()
        assert wire.sent[-2:] == [b"zero"] * 2

    def test_it_is_no_sign_that_the_loop_goes_on(self, wire, brake, passes):
        brake.arm()
        brake.drive(0.1, 0.1)
        passes(0.7 * STALL)
        brake.repeat()
        passes(0.5 * STALL)
        brake.check_stall()
        assert brake.why.startswith("the control loop stalled")
        assert wire.sent[-2:] == [b"zero"] * 2

    def test_a_loop_that_has_stalled_repeats_nothing(self, wire, brake, passes):
        brake.arm()
        brake.drive(0.1, 0.1)
        passes(STALL + 0.02)
        assert not brake.repeat()
        assert wire.sent == [b"0.1 0.1", b"zero", b"zero"]


@pytest.mark.parametrize("is_finished", [False, True])
def test_a_stop_in_the_middle_of_a_frame_is_heard(is_finished):
    """The line took a part of a command to drive, then what stops; and then the rest, or nothing any more."""
    host = rvr.Host()
    drive = host.send("drive_tank_si_units", left_velocity=0.275390625, right_velocity=-0.3)
    assert b"\xab" in drive  # an escape, behind which it may be cut, too
    zero = host.send("drive_tank_si_units", left_velocity=0.0, right_velocity=0.0) + host.send("drive_stop")
    for cut in range(1, len(drive)):
        heard = rvr.RvrEnd().receive(drive[:cut] + zero + (drive[cut:] if is_finished else b""))
        assert [command.name for command in heard] == ["drive_tank_si_units", "drive_stop"]
        assert heard[0].values == {"left_velocity": 0.0, "right_velocity": 0.0}


def test_behind_the_end_a_signal_interrupts_nothing(wire, brake):
    signals = Signals()
    with signals.caught():
        signals.guard(brake)
        with signals.until_stopped():
            assert wire.sent == []
        os.kill(os.getpid(), signal.SIGTERM)
    assert wire.sent == [b"zero"] * 2


def test_only_the_first_signal_interrupts(wire, brake):
    """A second one must not keep the robot from being shut down."""
    signals = Signals()
    with signals.caught():
        signals.guard(brake)
        with pytest.raises(Signalled, match="SIGHUP"):
            os.kill(os.getpid(), signal.SIGHUP)
        os.kill(os.getpid(), signal.SIGTERM)
    assert brake.why == "SIGHUP"
    assert wire.sent == [b"zero"] * 2


def test_a_signal_whose_exception_python_drops_stops_what_would_start(wire, brake, monkeypatch):
    class Thing:
        pass

    signals, thing = Signals(), Thing()
    gone = weakref.ref(thing, lambda _: os.kill(os.getpid(), signal.SIGTERM))
    dropped = []
    monkeypatch.setattr(sys, "unraisablehook", lambda what: dropped.append(what.exc_type))
    with signals.caught():
        del thing
        assert gone() is None
        assert dropped == [Signalled]
        with pytest.raises(Signalled, match="SIGTERM"):
            signals.guard(brake)


@pytest.mark.parametrize("number", [signal.SIGTTIN, signal.SIGTTOU])
def test_no_terminal_suspends_it(number):
    """It would not control its robot then."""
    with Signals().caught():
        assert signal.getsignal(number) == signal.SIG_IGN
    assert signal.getsignal(number) == signal.SIG_DFL
