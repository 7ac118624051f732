"""A person drives: what keys mean, for how long, and every way out, from the fault to wheels at rest.

`mercator-robot teleop` runs on a pseudo-terminal that tests write keys to: in this process and in simulated time, or,
where signals of terminals, stalls or its death matter, as a process of its own.
"""

import contextlib
import fcntl
import math
import os
import signal
import subprocess
import sys
import termios
import threading
import time
import tty
from pathlib import Path
from time import sleep  # of real time: fixtures replace time.sleep
from types import SimpleNamespace

import pytest

from mercator_design.robot.cli import teleop as command
from mercator_design.robot.devices.health import ANSWER_LIMIT, ANSWERS_WINDOW
from mercator_design.robot.devices.settings import COMMANDS_END, Limits, Settings
from mercator_design.robot.run.mercator import QUERY_EVERY
from mercator_design.robot.run.network import Speaker
from mercator_design.robot.run.safety import SIGNALS
from mercator_design.robot.teleop.keyboard import Keyboard, keyboard, keys
from mercator_design.robot.teleop.teleop import HELD, REPEATED, Stick, nearest_ahead
from tests.processes import LIMIT, wait_until
from tests.robot.devices import CLEAR, Devices
from tests.robot.log_events import read, times_of_samples
from tests.robot.ways import LATE, LATEST, MAIN, PATIENT, ROOT, SOON, asked, free_port, soonest

RING = Settings().proximity_angles
UP = b"\x1b[A"
PERIOD = 0.05
"""[s] of looks at the keys."""


class TestKeys:
    def test_what_terminals_send(self):
        arrows = ["forward", "back", "right", "left"]
        assert keys(b"\x1b[A\x1b[B\x1b[C\x1b[D") == (arrows, b"")
        assert keys(b"\x1bOA\x1bOB\x1bOC\x1bOD") == (arrows, b"")
        assert keys(b"wsdaWSDA") == (2 * arrows, b"")
        assert keys(b"q\x04Q") == (["quit"] * 3, b"")

    def test_all_others_stop(self):
        assert keys(b" \x1b[1;5A\x1b[3~\x1bOPx\n\xc3\x1b\x1b[A") == (["stop"] * 8 + ["forward"], b"")

    @pytest.mark.parametrize(
        "start",
        [
            b"\x1b[[A",
            b"\x1b[?1;2c",
            b"\x1b[0 q",
            b"\x1b]11;rgb:0/a/w\a",
            b"\x1bP>|wasd\x1b\\",
            b"\x1b[M ww",
            b"\x1b[M#\xe1\n",
            b"\x1bw",
            b"\x1bq",
        ],
    )
    def test_keys_of_consoles_clicks_alt_and_what_terminals_say_are_one_key_that_stops(self, start):
        assert keys(start + b"w") == (["stop", "forward"], b"")
        for cut in range(1, len(start)):
            assert keys(start[:cut]) == ([], start[:cut])

    def test_nothing_that_begins_goes_on_for_ever(self):
        pressed, rest = keys(b"\x1b]" + 300 * b" " + b"q")
        assert (pressed[0], pressed[-1], rest) == ("stop", "quit", b"")

    def test_escape_alone_stops(self):
        fingers, terminal = os.openpty()
        tty.setraw(terminal)
        os.set_blocking(terminal, False)
        keyboard = Keyboard(terminal)
        for pressed, found in ((b"\x1b", []), (b"", ["stop"]), (b"\x1b[A", ["stop", "forward"]), (b"", [])):
            os.write(fingers, pressed)
            assert keyboard.pressed() == found
        os.close(fingers)
        os.close(terminal)

    def test_a_key_that_comes_in_pieces(self):
        for cut in (1, 2):
            pressed, rest = keys(b"a" + UP[:cut])
            assert (pressed, rest) == (["left"], UP[:cut])
            assert keys(rest + UP[cut:]) == (["forward"], b"")


def test_what_was_pressed_before_is_not_meant(monkeypatch):
    fingers, terminal = os.openpty()
    try:
        os.write(fingers, b"ww")
        monkeypatch.setattr(sys, "stdin", SimpleNamespace(fileno=lambda: terminal))
        with keyboard() as opened:
            os.write(fingers, b"d")
            assert wait_until(opened.pressed) == ["right"]
    finally:
        os.close(fingers)
        os.close(terminal)


class TestStick:
    def test_a_key_that_is_pressed_once(self):
        stick = Stick()
        assert stick.way(0.0) is None
        stick.press("forward", 10.0)
        assert stick.way(10.0 + HELD - 0.01) == "forward"
        assert stick.way(10.0 + HELD + 0.01) is None

    @pytest.mark.parametrize(("delay", "period"), [(0.25, 0.033), (0.5, 0.033), (0.66, 0.1)])
    def test_one_that_is_held_drives_without_a_break(self, delay, period):
        """Of the Linux console, of desktops, of X11."""
        stick = Stick()
        stick.press("left", 0.0)
        times = [delay + k * period for k in range(20)]
        for now in times:
            assert stick.way(now) == "left"
            stick.press("left", now)
        assert stick.way(times[-1] + REPEATED - 0.01) == "left"
        assert stick.way(times[-1] + REPEATED + 0.01) is None

    def test_another_key_takes_over(self):
        stick = Stick()
        stick.press("forward", 0.0)
        stick.press("right", 0.1)
        assert stick.way(0.1 + HELD - 0.01) == "right"
        stick.press("stop", 0.3)
        assert stick.way(0.3) is None


def test_what_is_ahead():
    distances = [0.5, 0.8, 0.6, 0.1, 0.3, 0.2, 0.4, 0.1]
    assert nearest_ahead(1.0, distances, RING) == 0.5
    assert nearest_ahead(-1.0, distances, RING) == 0.2
    assert nearest_ahead(1.0, [math.inf] * 8, RING) == math.inf


FAULTS = """
import os, time
from mercator_design.robot.teleop.teleop import Stick
way = Stick.way
def faulty(self, now):
    if os.path.exists("fault"):
        print(time.monotonic(), flush=True)
        {fault}
    return way(self, now)
Stick.way = faulty
"""
OWN_TERMINAL = "import fcntl, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0)\n"
PATIENTLY = {"lead": OWN_TERMINAL + PATIENT, "settings": LATE}


class Drive:
    """A `mercator-robot teleop` on devices and a terminal that a test has in hand."""

    def __init__(self, folder, devices, fault, options, lead, settings):
        self.folder, self.devices, self.port = folder, devices, free_port()
        names = devices.names
        (folder / "robot.yaml").write_text(
            f"ports: {{rvr: {names.rvr}, lidar: {names.lidar}, proximity: {names.proximity}}}\n"
            f"swarm: {{port: {self.port}{settings}}}\n"
        )
        lead += FAULTS.format(fault=fault) if fault else ""
        self.fingers, self.terminal = os.openpty()
        self.usual = termios.tcgetattr(self.terminal)
        self.process = subprocess.Popen(
            [sys.executable, "-c", f"{SOON}{lead}{MAIN}", "teleop", "--robot", "robot.yaml", *options],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdin=self.terminal,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        said = [self.process.stderr.readline(), self.process.stderr.readline()]
        assert said[1].startswith("Arrows or WASD drive"), said
        devices.when(lambda: not termios.tcgetattr(self.terminal)[3] & termios.ECHO)

    def press(self, data):
        os.write(self.fingers, data)

    @contextlib.contextmanager
    def holding(self, data=b"w"):
        """A key is held, and has been for a while."""
        over, before = threading.Event(), self.devices.driven()

        def repeat():
            while not over.wait(0.04):
                with contextlib.suppress(OSError):  # nobody at the other end
                    self.press(data)

        finger = threading.Thread(target=repeat)
        finger.start()
        try:
            self.devices.when(lambda: self.devices.driven() > before + 2 or self.process.poll() is not None)
            assert self.process.poll() is None, self.process.stderr.read()
            yield
        finally:
            over.set()
            finger.join()

    def told(self):
        """The speeds of the wheels [m/s], one after the other."""
        return [(round(left, 4), round(right, 4)) for _, left, right in self.devices.wheels]

    def ended(self, code, words=""):
        """It ends so, with the terminal as it was, and the robot told to stop."""
        _, error = self.process.communicate(timeout=LIMIT)
        assert (self.process.returncode, words in error) == (code, True), (self.process.returncode, error)
        assert termios.tcgetattr(self.terminal) == self.usual
        assert [name for _, name, _ in self.devices.commands].count("drive_stop") >= 2

    def close(self):
        self.process.kill()
        self.process.communicate()
        for end in (self.fingers, self.terminal):
            with contextlib.suppress(OSError):
                os.close(end)


@contextlib.contextmanager
def driving(folder, *options, fault="", lead=OWN_TERMINAL, settings=""):
    folder.mkdir(exist_ok=True)
    with Devices() as devices:
        drive = Drive(folder, devices, fault, options, lead, settings)
        try:
            yield drive
        finally:
            drive.close()


class SimulatedDrive:
    """A `mercator-robot teleop` in this process, on simulated devices and a terminal that a test has in hand.

    began: When what `act` did was done [s].
    """

    def __init__(self, devices, run_command, fingers, terminal):
        self.devices, self.fingers, self.terminal, self.began = devices, fingers, terminal, None
        self._run, self._held, self._pressed = run_command, b"", -math.inf
        devices.each_tick.append(self._repeat)

    def press(self, data):
        """A key that is no signal's; until the program can read it."""
        before = self._waiting()
        os.write(self.fingers, data)
        end = time.perf_counter() + LIMIT
        while self._waiting() < before + len(data):
            assert time.perf_counter() < end
            sleep(1e-4)

    def hold(self, data=b"w"):
        """A key is held from now on."""
        self._held = data

    def act(self, fault):
        """Let something happen once the robot has driven for some cycles, while a key is held."""

        def acts():
            self.began = time.monotonic()
            fault(self)

        self.devices.then(self.is_ready, self.hold)
        self.devices.then(lambda: self.devices.driven() > 2, acts)

    def is_ready(self):
        """Whether keys come at once and unseen."""
        return not termios.tcgetattr(self.terminal)[3] & termios.ECHO

    def later(self, seconds, act):
        """Act so long after what comes before."""
        since = []
        self.devices.then(self.is_ready, lambda: since.append(self.devices.now))
        self.devices.then(lambda: self.devices.now >= since[0] + seconds, act)

    def run(self, code, words, *options):
        """Drive until the end, which is as expected, with the terminal as it was, and the robot told to stop."""
        names, usual = self.devices.names, termios.tcgetattr(self.terminal)
        Path("robot.yaml").write_text(
            f"ports: {{rvr: {names.rvr}, lidar: {names.lidar}, proximity: {names.proximity}}}\nswarm: {{port: null}}\n"
        )
        returned, _, error = self._run("teleop", "--robot", "robot.yaml", *options)
        assert (returned, words in error) == (code, True), (returned, error)
        assert termios.tcgetattr(self.terminal) == usual
        assert [name for _, name, _ in self.devices.commands].count("drive_stop") >= 2
        return error

    def shown(self):
        """What the program has written; the system passes it on a moment later, so up to a mark behind it."""
        os.write(self.terminal, b"\0")
        found = b""
        while not found.endswith(b"\0"):
            found += os.read(self.fingers, 4000)
        return found[:-1].decode()

    def _waiting(self):
        """Bytes that wait for the program."""
        return int.from_bytes(fcntl.ioctl(self.terminal, termios.FIONREAD, bytes(4)), sys.byteorder)

    def _repeat(self):
        if self._held and self.is_ready() and self.devices.now - self._pressed >= 0.04:
            self._pressed = self.devices.now
            self.press(self._held)


@pytest.fixture
def drive(simulated, robot_command, tmp_path, monkeypatch):
    fingers, terminal = os.openpty()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin", SimpleNamespace(fileno=lambda: terminal, isatty=lambda: True))
    try:
        yield SimulatedDrive(simulated, robot_command, fingers, terminal)
    finally:
        os.close(fingers)
        os.close(terminal)


class TestDriving:
    @pytest.mark.timing
    def test_ways_speeds_and_silence(self, tmp_path):
        with driving(tmp_path, "-o", "drive.jsonl", **PATIENTLY) as drive:
            ways = {UP: (0.15, 0.15), b"s": (-0.15, -0.15), b"a": (-0.075, 0.075), b"\x1b[C": (0.075, -0.075)}
            for key, way in ways.items():
                with drive.holding(key):
                    drive.devices.when(lambda way=way: way in drive.told())
            drive.press(b" ")
            drive.devices.when(lambda: drive.told()[-1] == (0.0, 0.0))
            told = set(drive.told())
            assert told == {(0.0, 0.0), *ways.values()}
            drive.press(b"q")
            drive.ended(0)
        *_, end = events = list(read(tmp_path / "drive.jsonl", "recording"))
        wheels = [(event["left"], event["right"]) for event in events if event["event"] == "wheels"]
        assert (set(wheels), wheels[-1]) == (told, (0.0, 0.0))
        assert {"sample", "turn"} <= {event["event"] for event in events}
        assert (end["event"], end["why"]) == ("end", "A key ended the drive")

    def test_a_single_key_and_one_that_was_held(self, drive):
        presses = []

        def press():
            presses.append(time.monotonic())
            drive.press(b"w")

        drive.later(0.1, press)
        drive.later(HELD + 0.3, drive.hold)
        drive.later(1.0, lambda: (presses.append(time.monotonic()), drive.hold(b"")))
        drive.later(REPEATED + 0.3, lambda: drive.press(b"q"))
        drive.run(0, "", "--speed", "0.3")
        (start, end), (_, last) = zip(*[iter([when for when, *_ in drive.devices.wheels[1:]])] * 2, strict=True)
        assert 0.0 <= start - presses[0] <= 2 * PERIOD
        assert HELD <= end - presses[0] <= HELD + 2 * PERIOD
        assert REPEATED - 0.04 <= last - presses[1] <= REPEATED + 2 * PERIOD

    def test_it_does_not_drive_towards_what_is_near(self, drive):
        drive.devices.measured["proximity"] = [math.inf, 0.25, *CLEAR[2:]]
        drives = []
        drive.later(0.3, lambda: drive.press(UP))
        drive.later(0.3, lambda: drives.append(drive.devices.drives()) or drive.press(b"s"))
        drive.later(0.3, lambda: drive.press(b"q"))
        drive.run(0, "", "--guard", "0.3")
        assert drives == [False]
        assert "BLOCKED" in drive.shown()
        assert {left == right < 0.0 for _, left, right in drive.devices.wheels if left or right} == {True}

    def test_what_is_shown(self, drive):
        drive.devices.measured["proximity"] = [0.3, 2.0, 0.02, *CLEAR[3:]]
        shown = []
        drive.later(0.1, lambda: drive.press(b"\x13"))  # Ctrl-S, which stops the output of terminals otherwise
        drive.later(0.8, lambda: shown.append(drive.shown().split("\r\x1b[K")[-1]) or drive.press(b"q"))
        drive.run(0, "")
        assert shown[0].startswith("stopped   87 %  black   200  30   -   -   -   -   -   0 cm  ")
        assert len(shown[0]) < 80

    def test_what_people_should_know_stays_above(self, drive):
        shown = []
        drive.later(0.1, lambda: setattr(drive.devices.rvr, "level", 15.0))
        drive.later(QUERY_EVERY + 0.2, lambda: shown.append(drive.shown()) or drive.press(b"q"))
        drive.run(0, "")
        assert "\r\x1b[Krvr: the battery is low; charge it soon\r\n" in shown[0]

    def test_what_was_heard_in_the_wait_that_ended_it_is_recorded(self, drive, tmp_path, monkeypatch):
        heard, counts = times_of_samples(monkeypatch), [0]

        def has_heard_one():
            counts.append(len(heard()))
            return counts[-1] > counts[-2]

        drive.later(1.0, lambda: counts.append(len(heard())))
        drive.devices.then(has_heard_one, lambda: setattr(drive.devices.ports["lidar"], "is_lost", True))
        drive.run(4, "lidar", "-o", "drive.jsonl")
        events = read(tmp_path / "drive.jsonl", "recording")
        assert [event["time"] for event in events if event["event"] == "sample"] == heard()

    def test_the_battery_is_asked_after(self, drive):
        drive.later(5.0, lambda: drive.press(b"q"))
        drive.run(0, "")
        assert asked(drive.devices) >= 5.0 / QUERY_EVERY

    @pytest.mark.timing
    @pytest.mark.parametrize("ttyname", ["lambda _: '/no/terminal'", "lambda _: os.stat('/no/terminal')"])
    def test_a_terminal_that_can_be_opened_by_its_general_name_only(self, tmp_path, ttyname):
        """As after `su`, and in containers, where it has no other."""
        lead = f"{OWN_TERMINAL}{PATIENT}import os; os.ttyname = {ttyname}\n"
        with driving(tmp_path, lead=lead, settings=LATE) as drive:
            drive.press(UP)
            drive.devices.when(drive.devices.drives)
            drive.press(b"q")
            drive.ended(0)

    @pytest.mark.timing
    def test_a_terminal_that_takes_nothing_more_holds_up_no_wheels(self, tmp_path):
        with driving(tmp_path, **PATIENTLY) as drive:
            with contextlib.suppress(BlockingIOError):
                os.set_blocking(drive.terminal, False)
                while True:
                    os.write(drive.terminal, b"x" * 100)
            with drive.holding():
                time.sleep(0.5)
                before = drive.devices.driven()
                drive.devices.when(lambda: drive.devices.driven() > before or drive.process.poll() is not None)
                assert drive.process.poll() is None, drive.process.stderr.read()
                assert {speeds for speeds in drive.told() if any(speeds)} == {(0.15, 0.15)}


def hangs_up(drive):
    os.close(drive.fingers)
    drive.fingers = os.open(os.devnull, os.O_RDWR)  # where further keys go


def is_sent(number):
    return lambda _: os.kill(os.getpid(), number)


WAYS = {
    # what happens: how, seconds that it may go on, exit code, what is said
    "q": (lambda drive: drive.press(b"q"), 0.0, 0, ""),
    "ctrl-d": (lambda drive: drive.press(b"\x04"), 0.0, 0, ""),
    **{number.name: (is_sent(number), 0.0, 128 + number, f"Stopped by {number.name}.") for number in SIGNALS},
    "hub silent": (lambda drive: drive.devices.silent.add("proximity"), 0.5, 4, "proximity: nothing for"),
    "rvr silent": (lambda drive: drive.devices.silent.add("rvr"), 0.25, 4, "nothing for"),
    "rvr hears badly": (
        lambda drive: drive.devices.misheard.add("rvr"),
        ANSWERS_WINDOW + ANSWER_LIMIT,
        4,
        "% of the commands to it are answered; the limit is 80 %",
    ),
    "tread stuck": (
        lambda drive: drive.devices.tell("motor_stall", motor_index=0, is_triggered=True),
        Limits().stall,
        4,
        "rvr: the left tread is stuck for 3.",
    ),
    "hub lost": (lambda drive: drive.devices.unplugged.add("proximity"), 0.0, 4, "/proximity is lost: "),
    "battery": (
        lambda drive: setattr(drive.devices.rvr, "level", 5.0),
        0.0,
        4,
        "rvr: the battery is critical",
    ),
}


@pytest.mark.parametrize("what", WAYS)
def test_while_a_key_is_held(what, drive):
    act, allowed, code, words = WAYS[what]
    drive.act(act)
    drive.run(code, words, "--guard", "0.1")
    assert drive.devices.told_to_rest(drive.began) - allowed <= LATEST


LIVE_WAYS = {
    # what happens: how, exit code, what is said
    "ctrl-c": (lambda drive: drive.press(b"\x03"), 130, "Stopped by SIGINT."),
    "ctrl-z": (lambda drive: drive.press(b"\x1a"), 128 + signal.SIGTSTP, "Stopped by SIGTSTP."),
    "hub silent": (lambda drive: drive.devices.silent.add("proximity"), 4, "proximity: nothing for"),
}


@pytest.mark.timing
class TestWaysOut:
    @pytest.mark.parametrize("what", LIVE_WAYS)
    def test_while_a_key_is_held(self, what, tmp_path):
        act, code, words = LIVE_WAYS[what]
        allowed = 0.5 if what == "hub silent" else 0.0

        def attempt(number):
            with driving(tmp_path / str(number), "--guard", "0.1") as drive, drive.holding():
                began = time.monotonic()
                act(drive)
                drive.ended(code, words)
                return drive.devices.told_to_rest(began) - allowed

        assert soonest(attempt) <= LATEST

    @pytest.mark.parametrize(
        ("lead", "code", "words"), [(OWN_TERMINAL, 129, "Stopped by SIGHUP."), ("", 4, "the terminal is lost")]
    )
    def test_the_terminal_is_lost(self, lead, code, words, tmp_path):
        """Of the session, which gets a signal; or another."""

        def attempt(number):
            with driving(tmp_path / str(number), "-o", "drive.jsonl", lead=lead) as drive, drive.holding():
                began = time.monotonic()
                hangs_up(drive)
                _, error = drive.process.communicate(timeout=LIMIT)
                assert (drive.process.returncode, words in error) == (code, True), (drive.process.returncode, error)
                assert "The recording is drive.jsonl" in error
                *_, last = (
                    event for event in read(tmp_path / str(number) / "drive.jsonl", "recording") if "left" in event
                )
                assert (last["left"], last["right"]) == (0.0, 0.0)
                return drive.devices.told_to_rest(began)

        assert soonest(attempt) <= LATEST

    @pytest.mark.parametrize(
        ("fault", "code", "words"),
        [("1 / 0", 1, "ZeroDivisionError"), ("time.sleep(0.5)", 4, "the control loop stalled")],
    )
    def test_the_program_fails(self, fault, code, words, tmp_path):
        def attempt(number):
            with driving(tmp_path / str(number), fault=fault) as drive, drive.holding():
                (drive.folder / "fault").touch()
                told = drive.process.stdout.readline()
                assert told, drive.process.stderr.read()
                began = float(told)
                drive.ended(code, words)
                return drive.devices.told_to_rest(began)

        assert soonest(attempt) <= LATEST

    @pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
    def test_killed_or_suspended_it_is_stopped_by_the_robot(self, number, tmp_path):
        def attempt(k):
            with driving(tmp_path / str(k)) as drive, drive.holding():
                began = time.monotonic()
                drive.process.send_signal(number)
                drive.devices.come_to_rest()
                return drive.devices.rests_since() - began - COMMANDS_END

        assert soonest(attempt, 0.05) <= 0.05

    def test_the_swarm_is_told_to_stop(self, tmp_path):
        def attempt(number):
            with (
                driving(tmp_path / str(number)) as drive,
                drive.holding(),
                Speaker(["127.0.0.1"], drive.port) as speaker,
            ):
                began = time.monotonic()
                answers = speaker.stop()
                drive.ended(4, "swarm: stop received from 127.0.0.1")
                return drive.devices.told_to_rest(began) if answers == (["mercator (127.0.0.1)"], []) else math.inf

        assert soonest(attempt) <= LATEST

    def test_a_full_disk(self, tmp_path):
        limit = "import resource, sys; sys.dont_write_bytecode = True; "
        limit += "resource.setrlimit(resource.RLIMIT_FSIZE, (30000, 30000))"
        with driving(tmp_path, "-o", "drive.jsonl", fault=limit, **PATIENTLY) as drive, drive.holding():
            (tmp_path / "fault").touch()
            drive.ended(1, "drive.jsonl: cannot be written: File too large")
            drive.devices.rests_since()


class TestUsage:
    def test_without_a_terminal(self, robot_command):
        code, _, said = robot_command("teleop")
        assert (code, "teleop needs a terminal" in said) == (2, True)

    def test_too_fast(self, robot_command, tmp_path):
        (tmp_path / "robot.yaml").write_text("limits: {speed: 0.1}\n")
        code, _, said = robot_command("teleop", "--robot", tmp_path / "robot.yaml", "--speed", 0.15)
        assert (code, "0.15 is above limits.speed, 0.1" in said) == (2, True)

    @pytest.mark.parametrize(("limit", "expected"), [(0.1, 0.1), (0.3, 0.15)])
    def test_the_default_is_not_beyond_the_limit(self, robot_command, tmp_path, monkeypatch, limit, expected):
        speeds = []
        monkeypatch.setattr(command, "drive", lambda _settings, speed, *_: speeds.append(speed))
        monkeypatch.setattr("sys.stdin", SimpleNamespace(isatty=lambda: True))
        (tmp_path / "robot.yaml").write_text(f"limits: {{speed: {limit}}}\n")
        assert robot_command("teleop", "--robot", tmp_path / "robot.yaml") == (0, "", "")
        assert speeds == [expected]
