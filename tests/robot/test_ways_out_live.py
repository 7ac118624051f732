"""Ways out of a run as a process of its own, in real time: each mechanism that stops a robot, once at least.

What test_ways_out.py does in simulated time is not done again here. Clocks are the same in all processes.
"""

import itertools
import math
import os
import signal
import socket
import threading
import time
from contextlib import contextmanager, suppress

import pytest

from mercator_design.robot.devices.settings import COMMANDS_END
from mercator_design.robot.run.network import ASK, HEARTBEAT, SIGN, SIGNED, STOP, Speaker, signature
from mercator_design.robot.run.safety import STALL
from tests.processes import LIMIT
from tests.robot import ways
from tests.robot.log_events import read
from tests.robot.test_ways_out import CYCLE, DEVICE_FAULTS
from tests.robot.ways import (
    ALL,
    ATTEMPTS,
    GO,
    IMPATIENT,
    LAST,
    LATE,
    LATEST,
    PATIENT,
    SLOW,
    SOON,
    WAITS,
    check,
    in_time,
    made_in_time,
    running,
    soonest,
)

pytestmark = pytest.mark.timing

KEY = "a key that nobody guesses"


class Forger(socket.socket):
    """Somebody in the network of a robot, without its key."""

    def __init__(self, port):
        super().__init__(socket.AF_INET, socket.SOCK_DGRAM)
        self.connect(("127.0.0.1", port))
        self.settimeout(0.5)

    def has_signed(self, key, robot):
        """What was recorded of somebody who has the key: signed, and not yet told; and told already."""
        signed = []
        while len(signed) < 2:
            with suppress(TimeoutError, ConnectionError):
                self.send(ASK)
                sealed = self.recv(200).removeprefix(SIGN)
                signed.append(SIGNED + sealed + b" " + signature(key, sealed))
            assert robot.process.poll() is None, robot.process.stderr.read()
        self.send(signed[0])
        return signed

    def say(self, messages):
        """Say these, and wait a little."""
        for message in messages:
            with suppress(ConnectionError):
                self.send(message)
        time.sleep(0.02)


@contextmanager
def repeated(act):
    """Act again and again, in a thread."""
    over = threading.Event()

    def acts():
        while not over.is_set():
            act()

    thread = threading.Thread(target=acts)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@pytest.mark.parametrize("what", ["hub silent", "lidar lost", "motor fault"])
def test_devices_that_fail(what, tmp_path):
    act, allowed, words = DEVICE_FAULTS[what]

    def attempt(number):
        with running(tmp_path / str(number), ALL) as robot:
            robot.drives()
            began = time.monotonic()
            act(robot)
            check(robot, 4, words)
            return robot.devices.told_to_rest(began) - allowed

    assert soonest(attempt) <= LATEST


@pytest.mark.parametrize("number", ["SIGTERM", "SIGTSTP"])
def test_signals(number, tmp_path):
    which = signal.Signals[number]

    def attempt(k):
        with running(tmp_path / str(k)) as robot:
            robot.drives()
            began = time.monotonic()
            robot.process.send_signal(which)
            check(robot, 128 + which, f"Stopped by {number}.")
            return robot.devices.told_to_rest(began)

    assert soonest(attempt) <= LATEST


CONTROLLER_FAULTS = {
    "exception": ("1 / 0", 1, "ZeroDivisionError"),
    "stalled": ("time.sleep(0.5)", 4, "the control loop stalled"),
    "no memory": ("raise MemoryError", 1, "Error: not enough memory"),
    "watchdog": (
        "from mercator_design.robot.run import safety; safety.Watchdog._check = None",
        4,
        "the watchdog failed",
    ),
    "busy": ("while not os.path.exists('stop'): pass", 4, "stalled"),
}


@pytest.mark.parametrize("what", CONTROLLER_FAULTS)
def test_controllers_that_fail(what, tmp_path):
    fault, code, words = CONTROLLER_FAULTS[what]

    def attempt(number):
        with running(tmp_path / str(number), fault=fault) as robot:
            robot.drives()
            began = robot.fault()
            if what == "busy":
                time.sleep(0.5)
                (robot.folder / "stop").touch()
            returned, error = robot.ended()
            assert (returned, words in error) == (code, True), (returned, error)
            return robot.devices.told_to_rest(began)

    assert soonest(attempt) <= LATEST


@made_in_time
def test_a_stalled_loop_does_not_drive_again_and_can_be_ended(tmp_path):
    with running(tmp_path, fault="time.sleep(60)") as robot:
        robot.drives()
        robot.fault()
        time.sleep(COMMANDS_END + STALL)
        assert robot.process.poll() is None
        robot.process.terminate()
        check(robot, 143, "Stopped by SIGTERM.")
        assert [bool(left or right) for _, left, right in robot.devices.wheels] == [False, True, False]


def test_a_process_that_is_killed_is_stopped_by_the_robot_and_its_log_is_whole_but_for_its_end(tmp_path):
    def attempt(number):
        with running(tmp_path / str(number)) as robot:
            robot.drives()
            robot.until(lambda: robot.cycles() > 1)
            began = time.monotonic()
            robot.process.kill()
            robot.devices.come_to_rest()
            kinds = [event["event"] for event in read(robot.folder / "log.jsonl")]
            assert kinds[0] == "start"
            assert kinds.count("cycle") >= 2
            assert kinds[-1] != "end"
            return robot.devices.rests_since() - began - COMMANDS_END

    assert soonest(attempt, 0.05) <= 0.05


def test_a_process_that_is_suspended_is_stopped_by_the_robot_and_does_not_drive_again(tmp_path):
    """Actions that rest turn again only in a new run."""

    def attempt(number):
        with running(tmp_path / str(number)) as robot:
            robot.drives()
            began = time.monotonic()
            robot.process.send_signal(signal.SIGSTOP)
            time.sleep(COMMANDS_END + STALL)
            robot.devices.come_to_rest()
            rested = robot.devices.rests_since()
            robot.process.send_signal(signal.SIGCONT)
            check(robot, 4, "the control loop stalled: no command for ")
            assert robot.devices.rests_since() == rested
            return rested - began - COMMANDS_END

    assert soonest(attempt, 0.05) <= 0.05


@pytest.mark.parametrize("seconds", [0.0, 0.5])
def test_who_was_held_up_before_the_drive_looks_anew(seconds, tmp_path):
    """By somebody who was told something, and took his time, though there was a heartbeat to wait for."""
    lead = f"{SOON}introduce = mercator.Mercator.introduce\n"
    lead += "mercator.Mercator.introduce = lambda robot, tell: (introduce(robot, tell), time.sleep(SECONDS))\n"
    lead = f"import time\n{lead}".replace("SECONDS", str(seconds))

    folders = map(str, itertools.count())

    def looks_anew(_):
        folder = tmp_path / next(folders)
        with running(folder, GO, ", heartbeat: 10", lead=lead) as robot, Speaker(["127.0.0.1"], robot.port) as speaker:
            robot.until(lambda: speaker.send(HEARTBEAT) or (robot.devices.driven() > 2 and robot.cycles() > 1))
            notes = [event["text"] for event in read(folder / "log.jsonl") if event["event"] == "note"]
            return any(note.startswith("held up for ") for note in notes)

    if seconds:
        assert in_time(looks_anew)
    else:  # a busy machine may hold it up too
        assert not all(in_time(looks_anew) for _ in range(ATTEMPTS))


STARTING = ("wake", "get_active_control_system_id", "start_streaming_service")


@pytest.mark.parametrize("command", STARTING)
@made_in_time
def test_a_signal_during_the_start(command, tmp_path):
    with running(tmp_path, lead=WAITS) as robot:
        robot.devices.when(lambda: command in [name for _, name, _ in robot.devices.commands])
        robot.process.terminate()
        returned, error = robot.ended()
        assert not (tmp_path / "log.jsonl").exists(), "it had started before the signal: is this computer too busy?"
        assert (returned, error) == (143, "Stopped by SIGTERM.\n")
        assert not robot.devices.drives()
        robot.devices.when(lambda: robot.devices.commands[-1][1] == LAST)
        robot.devices.when(lambda: robot.devices.lidar_commands[-2:] == ["force_stop", "stop"])


@made_in_time
def test_a_signal_during_the_end_interrupts_nothing(tmp_path):
    with running(tmp_path, lead=SOON + SLOW) as robot:
        robot.drives()
        robot.process.terminate()
        robot.devices.come_to_rest()
        robot.process.send_signal(signal.SIGINT)
        check(robot, 143, "Stopped by SIGTERM.")
        robot.devices.when(lambda: robot.devices.commands[-1][1] == LAST)


def test_a_line_that_takes_nothing_any_more(tmp_path):
    """As if the robot were lost: what waits in the line does not let it drive on later."""

    def attempt(number):
        with running(tmp_path / str(number)) as robot:
            robot.drives()
            began = time.monotonic()
            with robot.devices.suspended:
                fill(robot.devices.names.rvr)
                returned, error = robot.ended()
                assert (returned, "is lost: Write timeout" in error) == (4, True), error
                time.sleep(COMMANDS_END)
            time.sleep(0.1)
            robot.devices.come_to_rest()
            return robot.devices.rests_since() - began - COMMANDS_END

    assert soonest(attempt, 0.05) <= 0.05


def fill(port):
    """Let nothing more go into a line that nobody reads."""
    line = os.open(port, os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
    for _ in range(5):  # the system moves some on, and then takes more
        with suppress(BlockingIOError):
            while os.write(line, bytes(100)):
                pass
        time.sleep(0.005)
    os.close(line)


@made_in_time
def test_what_all_threads_took_of_processors_is_in_the_log(tmp_path):
    busy = "import threading; threading.Thread(target=sum, args=[range(10**6)]).start()"
    (tmp_path / "fault").touch()  # from the first cycle on
    with running(tmp_path, GO, "", busy, "--duration", "0.9") as robot:
        began = time.process_time()
        sum(range(10**6))
        took = time.process_time() - began
        check(robot, 0, "")
    cpu = sorted(event["program_cpu"] for event in read(tmp_path / "log.jsonl") if event["event"] == "cycle")
    assert cpu[len(cpu) // 2] > 0.5 * took


def test_a_full_disk(tmp_path):
    """A run whose log is lost is worth nothing."""
    limit = "import resource, sys; sys.dont_write_bytecode = True; "
    limit += "n = os.path.getsize('log.jsonl'); resource.setrlimit(resource.RLIMIT_FSIZE, (n, n))"

    def attempt(number):
        with running(tmp_path / str(number), fault=limit) as robot:
            robot.drives()
            began = robot.fault()
            returned, error = robot.ended()
            assert (returned, "log.jsonl: cannot be written: File too large" in error) == (1, True), error
            return robot.devices.told_to_rest(began) - CYCLE

    assert soonest(attempt) <= LATEST


def test_a_disk_that_hangs(tmp_path):
    """Such a run goes on for a while, in which others would recover."""
    soon = "from mercator_design.robot.logs import log; log.DISK_LIMIT = 0.3; log.SYNC_EVERY = 0"
    hangs = f"{soon}; os.fsync = lambda _: time.sleep(60)"

    def attempt(number):
        with running(tmp_path / str(number), fault=hangs) as robot:
            robot.drives()
            began = robot.fault()
            returned, error = robot.ended()
            assert (returned, "log.jsonl: cannot be written: the disk hangs" in error) == (1, True), error
            return robot.devices.told_to_rest(began) - 0.3 - 2 * CYCLE

    assert soonest(attempt) <= LATEST


def goes_on(robot):
    """Whether it drives for longer than its swarm may be silent; if not, who should be heard may have been too busy."""
    robot.devices.when(lambda: robot.devices.driven() > 1 or robot.process.poll() is not None)
    time.sleep(0.5)
    return robot.process.poll() is None


def is_told_to_stop(devices, before):
    """Whether there was a stop after so many commands."""
    return "drive_stop" in [name for _, name, _ in devices.commands[before:]]


def test_who_does_not_read_messages_holds_up_nothing(tmp_path):
    """As a terminal after Ctrl-S: it drives on when it warns, and its last message does not keep it from ending."""

    def attempt(number):
        with running(tmp_path / str(number), GO, LATE, lead=SOON + PATIENT) as robot:
            robot.drives()
            fill(f"/proc/self/fd/{robot.process.stderr.fileno()}")
            robot.devices.rvr.level = 12.0
            warned = robot.devices.driven()
            robot.until(lambda: is_noted(robot, "the battery is low") and robot.devices.driven() > warned + 10)
            robot.process.terminate()
            assert robot.process.wait(LIMIT) == 143

    in_time(attempt)


def is_noted(robot, words):
    """Whether the log has a note with these words."""
    return words in (robot.folder / "log.jsonl").read_text()


LONG_START = """
import time
from mercator_design.robot.run.mercator import Mercator
watch = Mercator._watch_commands_end
def watch_once_stopped(robot):
    while not robot.brake.why:
        robot.attend(time.monotonic() + 0.01)
    watch(robot)
Mercator._watch_commands_end = watch_once_stopped
"""
"""Lets a robot be starting up until something stops it."""


UNTIL_REFUSED = """
import time
await_heartbeat = control.Control.await_heartbeat
def await_longer(self):
    while not self._watchdog.heartbeats.refused:
        self.wait(time.monotonic() + 0.01)
    await_heartbeat(self)
control.Control.await_heartbeat = await_longer
"""
"""Lets a robot wait for a first heartbeat until one was refused, and then as long as it does otherwise."""


class TestSwarm:
    def test_stop(self, tmp_path):
        def attempt(number):
            with running(tmp_path / str(number)) as robot, Speaker(["127.0.0.1"], robot.port) as speaker:
                robot.drives()
                began = time.monotonic()
                answers = speaker.stop()
                check(robot, 4, "swarm: stop received from 127.0.0.1")
                return robot.devices.told_to_rest(began) if answers == (["mercator (127.0.0.1)"], []) else math.inf

        assert soonest(attempt) <= LATEST

    def test_a_flood_of_stops_does_not_hold_up_the_end(self, tmp_path):
        def attempt(number):
            with running(tmp_path / str(number)) as robot, Speaker(["127.0.0.1"], robot.port) as speaker:
                robot.drives()
                began = time.monotonic()
                while robot.process.poll() is None:
                    for _ in range(100):
                        speaker.send(STOP)
                took = time.monotonic() - began
                check(robot, 4, "swarm: stop received from 127.0.0.1")
                robot.devices.when(lambda: robot.devices.commands[-1][1] == LAST)
                names = [name for _, name, _ in robot.devices.commands]
                assert names.count("drive_stop") < 10 + 2 * took / 0.2
                return took

        assert soonest(attempt, 10.0) <= 10.0

    @made_in_time
    def test_a_stop_is_obeyed_each_time(self, tmp_path):
        """As what it sent before may have been damaged, and the program hangs."""
        with running(tmp_path, fault="time.sleep(60)") as robot, Speaker(["127.0.0.1"], robot.port) as speaker:
            robot.drives()
            robot.fault()
            for _ in range(2):
                before = len(robot.devices.commands)
                robot.until(lambda before=before: speaker.send(STOP) or is_told_to_stop(robot.devices, before))

    def test_stop_during_the_start(self, tmp_path):
        with running(tmp_path, lead=WAITS + LONG_START) as robot, Speaker(["127.0.0.1"], robot.port) as speaker:
            robot.devices.when(lambda: robot.devices.commands)
            robot.hears_stop(speaker)
            returned, error = robot.ended()
            assert (returned, error) == (4, "Error: swarm: stop received from 127.0.0.1\n")
            assert not robot.devices.drives()

    def test_silence(self, tmp_path):
        def attempt(number):
            with (
                running(tmp_path / str(number), GO, ", heartbeat: 0.4") as robot,
                Speaker(["127.0.0.1"], robot.port) as speaker,
            ):
                with repeated(lambda: (speaker.send(HEARTBEAT), time.sleep(0.05))):
                    if not goes_on(robot):
                        return math.inf
                began = time.monotonic()
                check(robot, 4, "swarm: no heartbeat for 0.4 s")
                return robot.devices.told_to_rest(began) - 0.4

        assert soonest(attempt) <= LATEST

    def test_silence_of_who_has_the_key(self, tmp_path):
        """All that others say meanwhile keeps it running no longer: what is not signed, and what was, again."""

        def attempt(number):
            with (
                running(tmp_path / str(number), GO, f", heartbeat: 0.4, key: {KEY}") as robot,
                Speaker(["127.0.0.1"], robot.port) as speaker,
                Forger(robot.port) as forger,
            ):
                with repeated(lambda: speaker.beat(KEY, 0.05)):
                    if not goes_on(robot):
                        return math.inf
                    signed = forger.has_signed(KEY, robot)
                began = time.monotonic()
                with repeated(lambda: forger.say([HEARTBEAT, *signed])):
                    error = check(robot, 4, "swarm: no heartbeat for 0.4 s")
                assert "not signed: anybody" not in error
                text = (robot.folder / "log.jsonl").read_text()
                assert KEY not in text + error
                is_refused = "heartbeats refused, the last from 127.0.0.1: " in text  # not if nothing was said in time
                return robot.devices.told_to_rest(began) - 0.4 if is_refused else math.inf

        assert soonest(attempt) <= LATEST

    def test_who_has_another_key_lets_no_robot_begin(self, tmp_path):
        lead = SOON + IMPATIENT + UNTIL_REFUSED
        with (
            running(tmp_path, GO, f", heartbeat: 0.4, key: {KEY}", lead=lead) as robot,
            Speaker(["127.0.0.1"], robot.port) as speaker,
        ):
            while robot.process.poll() is None:
                speaker.beat("another key of the same length", 0.05)
            error = check(robot, 1, " were refused: its signature is wrong); is `mercator-robot heartbeat` running")
            assert KEY not in error
            assert not robot.devices.drives()

    @made_in_time
    def test_without_a_key_it_says_so(self, tmp_path):
        with (
            running(tmp_path, GO, ", heartbeat: 10", "", "--duration", "1") as robot,
            Speaker(["127.0.0.1"], robot.port) as speaker,
        ):
            robot.devices.when(lambda: speaker.send(HEARTBEAT) or robot.process.poll() is not None)
            error = check(
                robot, 0, "Warning: heartbeats are not signed: anybody in the network can keep this robot runn"
            )
            assert error.count("not signed") == 1
            notes = [event["text"] for event in read(tmp_path / "log.jsonl") if event["event"] == "note"]
            assert "heartbeats are not signed: anybody in the network can keep this robot running" in notes

    def test_without_a_heartbeat_it_does_not_begin(self, tmp_path):
        with running(tmp_path, GO, ", heartbeat: 0.4", lead=SOON + IMPATIENT) as robot:
            error = check(robot, 1, "swarm: no heartbeat; is `mercator-robot heartbeat` running")
            assert "Traceback" not in error
            assert not robot.devices.drives()

    def test_stop_while_it_waits_for_a_heartbeat(self, tmp_path):
        with running(tmp_path, GO, ", heartbeat: 0.4") as robot, Speaker(["127.0.0.1"], robot.port) as speaker:
            robot.devices.when((robot.folder / "log.jsonl").exists)
            robot.devices.when(lambda: (robot.folder / "log.jsonl").stat().st_size)
            robot.hears_stop(speaker)
            check(robot, 4, "swarm: stop received from 127.0.0.1")

    def test_two_programs_cannot_hear_at_one_port(self, tmp_path, monkeypatch):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.bind(("", 0))
            monkeypatch.setattr(ways, "free_port", lambda: other.getsockname()[1])
            with running(tmp_path) as robot:
                returned, error = robot.ended()
        assert (returned, "does another mercator-robot run here?" in error) == (1, True), error
