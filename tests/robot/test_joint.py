"""A run that begins together with others: what its robot does, told over the standard input as by `mdesign deploy`."""

import contextlib
import math
import os
import select
import signal
import subprocess
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from mercator_design.errors import RobotStopped
from mercator_design.robot.protocols import joint_start
from mercator_design.robot.protocols.clocks import Clock, from_line, probe, to_line
from mercator_design.robot.run.joint import AwaitedStart
from mercator_design.robot.run.network import HEARTBEAT, Speaker
from tests.processes import LIMIT
from tests.robot.log_events import read
from tests.robot.ways import GO, LAST, LATE, LATEST, SOON, made_in_time, running, soonest

PATIENT = SOON + "from mercator_design.robot.protocols import joint_start; joint_start.SILENCE = 60.0\n"
"""Lets a robot wait for its leader as long as a busy machine may take."""
LONG = 55.0
"""[s] until a start that is not to come, as the test does something before, however busy the machine is."""


class Leader:
    """Who says when a robot begins, by hand."""

    def __init__(self, robot):
        self._robot, self._streams = robot, (robot.process.stdin, robot.process.stdout)

    def say(self, line):
        try:
            self._streams[0].write(line)
            self._streams[0].flush()
        except BrokenPipeError:
            raise AssertionError(f"the run has ended: {self._robot.process.stderr.read()}") from None

    def hear(self, what):
        """The next line that says something of a kind."""
        for line in self._streams[1]:
            if (said := from_line(line.encode()))["say"] == what:
                return said
            assert said["say"] != "failed", said
        raise AssertionError(f"the connection ended: {self._robot.process.stderr.read()}")

    def measure(self):
        clock = Clock()
        for _ in range(5):
            self.say(probe(time.monotonic()))
            clock.take(self.hear("clock"), time.monotonic())
        return clock.difference

    def offer(self, seconds, offset=1000.0):
        """Say when to begin; that time."""
        at = time.monotonic() + seconds
        self.say(to_line("start", at=at, host="desk", offset=offset, uncertainty=0.004))
        return at

    def hang_up(self):
        self._streams[0].close()
        self._robot.process.stdin = None


@contextlib.contextmanager
def awaiting(folder, fsm=GO, settings=LATE, fault="", *options, lead=PATIENT):
    """A run that has said that it is ready, and its leader."""
    options = ("--await-start", *options)
    with running(folder, fsm, settings, fault, *options, lead=lead, stdin=subprocess.PIPE) as robot:
        leader = Leader(robot)
        assert leader.hear("ready") == {"say": "ready", "log": "log.jsonl"}
        yield robot, leader


def never_drove(robot, words, code=4):
    """It has ended for a reason, at rest, and everything was shut down."""
    returned, error = robot.process.wait(LIMIT), robot.process.stderr.read()
    assert (returned, words in error) == (code, True), (returned, error)
    assert not robot.devices.drives()
    robot.devices.when(lambda: robot.devices.commands[-1][1] == LAST)
    robot.devices.when(lambda: robot.devices.lidar_commands[-2:] == ["force_stop", "stop"])


@pytest.mark.timing
@made_in_time
def test_it_begins_when_it_was_told_to_and_then_needs_nobody(tmp_path):
    with awaiting(tmp_path, GO, LATE, "", "--duration", "0.3") as (robot, leader):
        found = leader.measure()
        assert abs(found.offset) <= found.uncertainty  # of the same clock
        assert not (tmp_path / "log.jsonl").read_text()
        at = leader.offer(0.5, offset=time.time() - time.monotonic() - 7.0)
        leader.hear("accepted")
        leader.say(to_line("go"))
        leader.hear("going")
        began = leader.hear("started")["at"]
        assert 0.0 <= began - at <= 0.1
        leader.say(to_line("confirm"))
        leader.hear("confirmed")
        leader.hang_up()
        assert robot.process.wait(LIMIT) == 0, robot.process.stderr.read()
        first = min(when for when, left, _ in robot.devices.wheels if left)
        assert first >= at
        start, cycle, *_ = (event for event in read(tmp_path / "log.jsonl") if event["event"] != "note")
        assert start["clock"] == {"reference": "desk", "ahead": pytest.approx(7.0, abs=0.05), "uncertainty": 0.004}
        assert cycle["event"] == "cycle"


@pytest.mark.timing
@made_in_time
def test_a_start_in_the_past_is_refused(tmp_path):
    with awaiting(tmp_path) as (robot, leader):
        leader.offer(-0.5)
        never_drove(robot, "the time of the start came too late: it was ")
        assert not (tmp_path / "log.jsonl").exists()


@pytest.mark.timing
@made_in_time
def test_without_go_it_does_not_begin(tmp_path):
    with awaiting(tmp_path) as (robot, leader):
        leader.offer(0.5)
        leader.hear("accepted")
        never_drove(robot, "the start was not confirmed by all robots in time")
        *_, end = read(tmp_path / "log.jsonl")
        assert end["why"] == "the start was not confirmed by all robots in time"


@pytest.mark.timing
@pytest.mark.parametrize("when", ["ready", "accepted", "going"])
@made_in_time
def test_a_connection_that_ends_before_the_start(tmp_path, when):
    with awaiting(tmp_path) as (robot, leader):
        if when != "ready":
            leader.offer(LONG)
            leader.hear("accepted")
        if when == "going":
            leader.say(to_line("go"))
            leader.hear("going")
        leader.hang_up()
        never_drove(robot, "the connection to the computer that starts the robots has ended")


@pytest.mark.timing
@made_in_time
def test_a_leader_that_falls_silent(tmp_path):
    lead = SOON + "from mercator_design.robot.protocols import joint_start; joint_start.SILENCE = 0.5\n"
    with awaiting(tmp_path, lead=lead) as (robot, leader):
        never_drove(robot, "nothing received for 0.5 s from the computer that starts the robots")
        leader.hang_up()


@pytest.mark.timing
@made_in_time
def test_a_start_that_is_called_off(tmp_path):
    with awaiting(tmp_path) as (robot, leader):
        leader.offer(LONG)
        leader.hear("accepted")
        leader.say(to_line("stop", why="the start was called off: r3: its battery is critical"))
        never_drove(robot, "Error: the start was called off: r3: its battery is critical\n")


@pytest.fixture
def waits(robot, monkeypatch):
    """A run in simulated time to which something happens while it waits for its start; gives why it failed."""
    hears, says = os.pipe(), os.pipe()
    monkeypatch.setattr(joint_start, "SILENCE", math.inf)
    said = []

    def has_said(what):
        if select.select([says[0]], [], [], 0.0)[0]:
            said.extend(from_line(line) for line in os.read(says[0], 10_000).splitlines())
        return [each for each in said if each["say"] == what]

    def run(fault):
        robot.act(fault, when=lambda: has_said("ready"))
        with monkeypatch.context() as patched, os.fdopen(os.dup(says[1]), "w") as out:
            patched.setattr("sys.stdin", SimpleNamespace(fileno=lambda: hears[0]))
            patched.setattr("sys.stdout", out)
            robot.run(GO, "--await-start")
        (failed,) = has_said("failed")
        return failed["why"]

    yield run
    for end in (*hears, *says):
        os.close(end)


@pytest.mark.parametrize(
    ("fault", "words", "code"),
    [
        (lambda robot: robot.devices.silent.add("rvr"), "nothing for", 4),
        (lambda robot: setattr(robot.devices.rvr, "level", 5.0), "rvr: the battery is critical; charge it", 4),
        (lambda robot: robot.devices.noisy.add("rvr"), "% of what the rvr sends arrives whole; the limit is 80 %", 4),
        (lambda robot: robot.devices.deaf.add("rvr"), "% of the commands to it are answered; the limit is 80 %", 4),
        (lambda _: os.kill(os.getpid(), signal.SIGTERM), "Stopped by SIGTERM.", 143),
    ],
)
def test_what_stops_a_robot_while_it_waits(robot, waits, fault, words, code):
    assert words in waits(fault)
    returned, error = robot.ended()
    assert (returned, words in error) == (code, True), error
    assert not robot.devices.drives()
    assert robot.devices.lidar_commands[-2:] == ["force_stop", "stop"]
    is_heard = not robot.devices.deaf | robot.devices.silent
    assert (robot.devices.commands[-1][1] == LAST) == is_heard


@pytest.mark.timing
@made_in_time
def test_the_swarm_is_told_to_stop_while_it_waits(tmp_path):
    with awaiting(tmp_path) as (robot, leader), Speaker(["127.0.0.1"], robot.port) as speaker:
        robot.hears_stop(speaker)
        assert next(failures(leader))["why"] == "swarm: stop received from 127.0.0.1"
        never_drove(robot, "swarm: stop received from 127.0.0.1")


@pytest.mark.timing
@made_in_time
def test_a_signal_while_it_waits(tmp_path):
    with awaiting(tmp_path) as (robot, leader):
        robot.process.terminate()
        assert next(failures(leader))["why"] == "Stopped by SIGTERM."
        never_drove(robot, "Stopped by SIGTERM.", 143)


def failures(leader):
    for line in leader._streams[1]:
        if (said := from_line(line.encode()))["say"] == "failed":
            yield said


@pytest.mark.timing
@made_in_time
def test_a_robot_that_is_late_does_not_begin(tmp_path):
    """Its computer was too busy; it tells that, and the others are stopped."""
    late = """
import time
from mercator_design.robot.run import joint
due = joint.AwaitedStart.due
joint.AwaitedStart.wait = lambda joint, control: control.wait(due(joint) + 0.3)
"""
    with awaiting(tmp_path, lead=PATIENT + late) as (robot, leader):
        leader.offer(0.5)
        leader.hear("accepted")
        leader.say(to_line("go"))
        leader.hear("going")
        assert next(failures(leader))["why"].startswith("the start is late by ")
        never_drove(robot, " s: is this computer too busy?")


def drives_on(robot, leader):
    leader.offer(0.5)
    leader.hear("accepted")
    leader.say(to_line("go"))
    leader.hear("started")
    robot.drives()


@pytest.mark.timing
@pytest.mark.parametrize("what", ["stop", "hang up"])
def test_a_start_that_is_called_off_when_it_has_begun(tmp_path, what):
    def attempt(number):
        with awaiting(tmp_path / str(number)) as (robot, leader):
            drives_on(robot, leader)
            began = time.monotonic()
            leader.hang_up() if what == "hang up" else leader.say(to_line("stop", why="r3: it has not answered"))
            words = "the connection to the computer that starts" if what == "hang up" else "r3: it has not answered"
            assert robot.process.wait(LIMIT) == 4
            assert words in robot.process.stderr.read()
            return robot.devices.told_to_rest(began)

    assert soonest(attempt) <= LATEST


@pytest.mark.timing
def test_a_leader_that_is_not_heard_any_more_when_it_has_begun(tmp_path):
    lead = """
from mercator_design.robot.run import joint
begin = joint.AwaitedStart.begin
joint.AwaitedStart.begin = lambda *given: (begin(*given), setattr(joint_start, "SILENCE", 1.0))
"""

    def attempt(number):
        with awaiting(tmp_path / str(number), lead=PATIENT + lead) as (robot, leader):
            leader.offer(0.5)
            leader.say(to_line("go"))
            leader.hear("started")
            began = time.monotonic()
            assert robot.process.wait(LIMIT) == 4
            assert "nothing received for 1 s" in robot.process.stderr.read()
            return robot.devices.told_to_rest(began) - 1.0

    assert soonest(attempt) <= LATEST


@pytest.mark.timing
def test_a_thread_that_fails_does_not_leave_it_without_a_leader(tmp_path):
    joint_start = "from mercator_design.robot.protocols import joint_start"
    fault = f"{joint_start}; joint_start.Follower.check_silence = None; time.sleep(0.1)"

    def attempt(number):
        with awaiting(tmp_path / str(number), fault=fault) as (robot, leader):
            drives_on(robot, leader)
            robot.process.stdout.flush()
            began = time.monotonic()
            (robot.folder / "fault").touch()
            assert robot.process.wait(LIMIT) == 4
            assert "the thread that reads the leader's lines failed" in robot.process.stderr.read()
            return robot.devices.told_to_rest(began) - 0.1

    assert soonest(attempt) <= LATEST


@pytest.mark.timing
@made_in_time
def test_it_is_ready_when_a_heartbeat_was_heard(tmp_path):
    options = ("--await-start",)
    with (
        running(tmp_path, GO, f", heartbeat: 5{LATE}", "", *options, lead=PATIENT, stdin=subprocess.PIPE) as robot,
        Speaker(["127.0.0.1"], robot.port) as speaker,
    ):
        robot.devices.when(lambda: speaker.send(HEARTBEAT) or "scan" in robot.devices.lidar_commands)
        speaker.send(HEARTBEAT)
        leader = Leader(robot)
        leader.hear("ready")
        leader.hang_up()
        never_drove(robot, "the connection to the computer that starts the robots has ended")


class Control:
    """A robot whose devices do nothing, whatever time it waits."""

    wait = refresh = lambda self, *_: None

    def __init__(self):
        self.robot = SimpleNamespace(
            brake=SimpleNamespace(why="", stop=self._stop), check_ages=lambda: None, query=lambda: None
        )

    def _stop(self, why):
        self.robot.brake.why = why

    def await_heartbeat(self):
        pass


@pytest.fixture
def joint(monkeypatch):
    """A joint run on a connection; gives it, and the leader's ends."""
    hears, says = os.pipe(), os.pipe()
    monkeypatch.setattr("sys.stdin", SimpleNamespace(fileno=lambda: hears[0]))
    monkeypatch.setattr("sys.stdout", SimpleNamespace(fileno=lambda: says[1]))
    yield AwaitedStart(), hears[1], says[1]
    for end in (*hears, *says):
        os.close(end)


def test_the_wheels_stop_before_the_leader_is_informed(joint, monkeypatch):
    joint, _, _ = joint
    control, told = Control(), []
    monkeypatch.setattr(joint._channel, "write", lambda line: told.append((control.robot.brake.why, line)) or True)
    joint._follower.at = 0.0
    words = "the controller failed"
    with pytest.raises(ValueError, match=words), joint.taking_part(control, Path("log.jsonl")):
        raise ValueError(words)
    assert told[-1] == (words, to_line("failed", why=words))


def test_a_leader_that_reads_nothing_holds_up_nothing(joint):
    joint, _, says = joint
    os.set_blocking(says, False)
    with contextlib.suppress(BlockingIOError):
        while os.write(says, b"x"):
            pass
    os.set_blocking(says, True)
    assert not joint._channel.write("a line\n")


def test_a_thread_that_has_failed_before_the_robot_is_ready(joint, monkeypatch):
    joint, hears, _ = joint
    monkeypatch.setattr(threading, "excepthook", lambda _: None)
    monkeypatch.setattr(joint._follower, "receive", None)
    with joint.listening():
        os.write(hears, b"a line\n")
        joint._channel._thread.join(LIMIT)
        words = "the thread that reads the leader's lines failed"
        with pytest.raises(RobotStopped, match=words), joint.taking_part(Control(), Path("log.jsonl")):
            pass
