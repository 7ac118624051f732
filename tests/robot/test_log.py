"""The log of a run: whole to its last line, and the same decisions when it is replayed, here and compiled."""

import errno
import math
import os
import random
import stat
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from mercator_design.config.checked_lines import to_line
from mercator_design.config.colours import COLOURS
from mercator_design.errors import RobotError, RobotStopped, Signalled
from mercator_design.fsm import Readings, ReferenceModel, parse
from mercator_design.fsm.control import control_cycle
from mercator_design.jit import compiled
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.reference import ACTIONS, N_READINGS
from mercator_design.robot.cli import VERBS
from mercator_design.robot.logs import log as log_module
from mercator_design.robot.logs.events import CycleDone, NoteTaken, RecordingStarted, RunStarted
from mercator_design.robot.logs.log import Log, controller_of, replay, to_lines
from mercator_design.sim.simulate import tables_of
from mercator_design.software import Controller
from tests.fsm.strategies import DRAWS
from tests.processes import wait_until
from tests.robot.log_events import read

FSM = (  # all that a Mercator can run
    "--nstates 4 "
    "--s0 0 --rwm0 20 --n0 2 --n0x0 0 --c0x0 3 --p0x0 1 --w0x0 5 --n0x1 1 --c0x1 0 --p0x1 0.5 "
    "--s1 2 --att1 2.5 --n1 2 --n1x0 0 --c1x0 5 --p1x0 0.3 --n1x1 2 --c1x1 1 --p1x1 0.5 "
    "--s2 1 --n2 2 --n2x0 2 --c2x0 2 --p2x0 0.5 --n2x1 0 --c2x1 4 --p2x1 1 --w2x1 5 "
    "--s3 3 --rep3 4 --n3 2 --n3x0 0 --c3x0 6 --p3x0 0.6 --l3x0 0 --n3x1 2 --c3x1 5 --p3x1 0.1"
)
CYCLES = 300
START = RecordingStarted(robot="mercator", lidar_angle=0.0)


@pytest.fixture
def log(tmp_path):
    """The log of a run with readings drawn at random."""
    draw = random.Random(5)
    controller = Controller(parse(FSM))
    with Log(tmp_path / "log.jsonl") as log:
        start = {"flavour": "watermelon", "control_period": 0.1, "reference_model": ReferenceModel()}
        log.begin(RunStarted(robot="mercator", fsm=FSM, **start))
        for cycle in range(CYCLES):
            obstacles, robots = [draw.uniform(-1, 1) for _ in range(2)], draw.choice([0.0, 1.0, 2.0])
            pull, ground = [draw.uniform(-2, 2) for _ in range(2)], draw.choice([*COLOURS.values()])
            readings = Readings(*obstacles, robots, *pull, *ground)
            draws = [draw.random() for _ in range(DRAWS)]
            state = controller.state
            wheels = controller.step(readings, draws)
            event = CycleDone(
                cycle=cycle,
                time=0.1 * cycle,
                state=state,
                next_state=controller.state,
                readings=readings,
                draws=draws,
                wheels=wheels[:2],
                led_colour=-1,
                signal=0,
                cpu=0.001,
                program_cpu=0.001,
                neighbours=(),
                sensed={},
                lines={},
            )
            log.note(event)
    return tmp_path / "log.jsonl"


def lines(log):
    return log.read_bytes().splitlines(keepends=True)


def named(flavour, kind):
    return {module.name for module in flavour_of(flavour).numbered(kind).values()}


def test_it_replays_identically(log):
    decisions = [decision for _, decision in replay(log)]
    assert len(decisions) == CYCLES
    assert {decision.differs for decision in decisions} == {""}
    states = parse(FSM).states
    assert {states[decision.state].behaviour for decision in decisions} == named("watermelon", "behaviour")
    assert {decision.condition for decision in decisions} == {"", *named("watermelon", "condition")}


def test_the_simulator_s_kernel_decides_the_same(log):
    start, *events = read(log)
    pfsm = controller_of(next(log_module.read(log))).software
    tables = tables_of(pfsm)
    memory, actions = np.zeros(tables.memory), np.zeros(ACTIONS)
    model = ReferenceModel(**start["reference_model"])
    for event in events[:-1]:
        assert int(memory[0]) == event["state"]
        draws = np.array(event["draws"])
        compiled(control_cycle)(model, tables.program, Readings(*event["readings"]), memory, draws, actions)
        assert list(actions[:2]) == event["wheels"]
        assert int(memory[0]) == event["next_state"]


def test_readings_of_senses_that_a_program_lacked_are_neutral(log):
    start, *events, end = read(log)
    events = [event | {"readings": event["readings"][:10]} for event in events]
    log.write_text("".join(to_lines([start, *events, end])))
    decisions = [decision for _, decision in replay(log)]
    assert {decision.differs for decision in decisions} == {""}
    assert {decision.readings[10:] for decision in decisions} == {Readings()[10:]}


def test_a_cycle_that_was_decided_otherwise_is_named(log, robot_command):
    start, *events = read(log)
    events[7]["wheels"] = [0.5, 0.5]
    log.write_text("".join(to_lines([start, *events])))
    code, out, err = robot_command("replay", log)
    assert code == 1
    assert "cycle 7: decides" in err
    assert f"1 of {CYCLES} cycles differ" in err
    assert len(out.splitlines()) == CYCLES


@pytest.mark.parametrize(("off", "differ"), [(1e-12, 0), (1e-6, CYCLES)])
def test_the_last_digits_of_wheels_are_the_processor_s(log, off, differ):
    start, *events, end = read(log)
    events = [event | {"wheels": [speed + off for speed in event["wheels"]]} for event in events]
    log.write_text("".join(to_lines([start, *events, end])))
    assert sum(bool(decision.differs) for _, decision in replay(log)) == differ


def test_replay_shows_every_decision(log, robot_command):
    code, out, err = robot_command("replay", log)
    assert (code, err) == (0, f"{CYCLES} cycles, all decided the same\n")
    assert "state 0 exploration" in out
    assert "-> 1 (neighbours count)" in out
    assert "-> 0 (fixed probability)" in out


def test_a_log_without_an_end_is_reported(log, robot_command):
    log.write_bytes(b"".join(lines(log)[:-1]))
    code, out, err = robot_command("replay", log)
    assert (code, len(out.splitlines())) == (0, CYCLES)
    assert err.splitlines() == [
        f"{log}: the log has no end: it is still being written, or the program was killed",
        f"{CYCLES} cycles, all decided the same",
    ]


def test_half_a_line_at_the_end_is_passed_over(log):
    whole = log.read_bytes()
    last = lines(log)[-1]
    for cut in (1, len(last) // 2, len(last) - 1):
        log.write_bytes(whole[:-cut])
        assert [event["event"] for event in read(log)].count("cycle") == CYCLES
    log.write_bytes(whole)
    assert [*read(log)][-1]["why"] == "The duration is over"


@pytest.mark.parametrize("number", [1, 2, 100])
def test_damage_before_the_end_is_named(log, number):
    damaged = lines(log)
    damaged[number - 1] = damaged[number - 1].replace(b"0", b"1", 1)
    log.write_bytes(b"".join(damaged))
    with pytest.raises(RobotError, match=f"log.jsonl, line {number}: expected the checksum"):
        [*read(log)]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "expected a robot's log, found nothing"),
        ("nonsense\n", "line 1: expected an event"),
        (
            to_line({"event": "start", "format": 1, "kind": "run"}),
            'line 1: expected the start of a robot\'s log, of format 2, found "start" of format 1',
        ),
        (to_line({"event": "end"}), 'of format 2, found "end" of format none'),
        (to_line({"event": "start", "format": 2, "kind": "run"}), "start.robot: missing key; expected text"),
    ],
)
def test_what_is_no_log(tmp_path, robot_command, text, words):
    file = tmp_path / "other.jsonl"
    file.write_text(text)
    code, _, err = robot_command("replay", file)
    assert (code, words in err) == (1, True), err


@pytest.mark.parametrize(
    ("number", "change", "words"),
    [
        (1, {"fsm": 7}, "start.fsm: expected text, found 7"),
        (1, {"time": "1969-12-31T23:00:00+00:00"}, "start.time: expected a date and time in UTC from 1970 to 2099"),
        (1, {"time": "1970-01-01T00:00:00+01:00"}, "start.time: expected a date and time in UTC from 1970 to 2099"),
        (
            1,
            {"reference_model": {"hue_period": 0.0}},
            "start.reference_model.hue_period: expected a number >= 1e-06",
        ),
        (1, {"kind": "walk"}, "expected the log of a run, found one of another program"),
        (2, {"event": "circle"}, 'event: expected one of cycle, turn, note, end, found "circle"'),
        (2, {"event": "start"}, 'event: expected one of cycle, turn, note, end, found "start"'),
        (3, {"time": [0.1]}, "cycle.time: expected a number >= 0 and <= 1e+06, found a list of 1"),
        (4, {"time": 0.05}, "cycle.time: expected at least 0.1, found 0.05"),
        (3, {"time": -0.1}, "cycle.time: expected a number >= 0 and <= 1e+06, found -0.1"),
        (3, {"cycle": "1"}, 'cycle.cycle: expected a whole number >= 0 and <= 1e+09, found "1"'),
        (
            3,
            {"readings": [0.5] * 9},
            f"cycle.readings: expected a list of at least 10 and at most {N_READINGS}, found",
        ),
        (3, {"draw": 0.5}, "cycle.draw: unknown key; did you mean 'draws'?"),
        (3, {"draws": [1.0] * DRAWS}, "cycle.draws[0]: expected a number from 0 to below 1, found 1.0"),
        (
            3,
            {"sensed": {"position": [0.1, None, 0.0]}},
            "cycle.sensed: expected a mapping of keys with lists of numbers (acceler",
        ),
        (
            3,
            {"lines": {"rvr": [1.0] * 4}},
            "cycle.lines: expected a mapping of keys with lists of numbers (rvr: 8, ",
        ),
        (CYCLES + 2, {"why": None}, "end.why: expected text, found null"),
    ],
)
def test_a_value_that_no_log_has_is_named(log, robot_command, number, change, words):
    events = [*read(log)]
    events[number - 1] |= change
    log.write_text("".join(to_lines(events)))
    code, _, err = robot_command("replay", log)
    assert (code, err.startswith(f"Error: {log}, line {number}: {words}")) == (1, True), err


def test_numbers_of_bytes_grow_for_days(log):
    start, *events = read(log)
    received = 10**11
    events[0]["lines"] = {"lidar": [1.0, received, 0, 0, 700]}
    log.write_text("".join(to_lines([start, *events])))
    assert [*read(log)][1]["lines"]["lidar"][1] == received


def test_a_line_that_is_missing_is_named(log):
    log.write_bytes(b"".join(lines(log)[:50] + lines(log)[51:]))
    with pytest.raises(RobotError, match=r"log.jsonl, line 51: expected line 51, found line 52: lines are missing or"):
        [*read(log)]


def test_what_has_no_end_is_not_read_to_it(log):
    """A pipe that nobody writes to, and a line as long as the disk."""
    os.mkfifo(log.with_name("pipe"))
    with pytest.raises(RobotError, match="pipe: expected a robot's log, found a folder, device or pipe"):
        [*read(log.with_name("pipe"))]
    with log.open("ab") as file:
        file.truncate(1 << 40)
    with pytest.raises(RobotError, match=f"line {CYCLES + 3}: expected an event"):
        [*read(log)]


def test_a_log_is_never_written_over(log):
    with pytest.raises(RobotError, match=r"log.jsonl: cannot be written: File exists"), Log(log):
        pytest.fail("begun")


def test_a_log_that_never_began_leaves_no_file(tmp_path):
    with Log(tmp_path / "log.jsonl"):
        assert (tmp_path / "log.jsonl").exists()
    assert not (tmp_path / "log.jsonl").exists()


def test_a_signal_while_it_begins_leaves_no_file(tmp_path, monkeypatch):
    def interrupt(_):
        raise Signalled("Stopped by SIGTERM.", 143)

    monkeypatch.setattr(log_module, "sync_folder", interrupt)
    before = len([*Path("/proc/self/fd").iterdir()])
    with pytest.raises(Signalled), Log(tmp_path / "log.jsonl"):
        pytest.fail("begun")
    assert ([*tmp_path.iterdir()], len([*Path("/proc/self/fd").iterdir()])) == ([], before)


def test_what_is_forced_to_the_disk(tmp_path, monkeypatch):
    """That there is a new file, at once; what is in it, now and then and at its end."""
    forced = []

    def fsync(file):
        status = os.fstat(file)
        forced.append("folder" if stat.S_ISDIR(status.st_mode) else status.st_size)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(log_module, "SYNC_EVERY", -1.0)
    path = tmp_path / "log.jsonl"
    with Log(path) as log:
        assert forced == ["folder"]
        log.begin(START)
        wait_until(lambda: len(forced) > 1)
        begun = path.stat().st_size
        monkeypatch.setattr(log_module, "SYNC_EVERY", 60.0)
    assert forced == ["folder", begun, path.stat().st_size]


def test_what_nothing_follows_is_forced_to_the_disk(tmp_path, monkeypatch):
    """While the log goes on."""
    forced = [0]
    monkeypatch.setattr(os, "fsync", lambda file: forced.append(os.fstat(file).st_size))
    monkeypatch.setattr(log_module, "SYNC_EVERY", 0.3)
    path = tmp_path / "log.jsonl"
    with Log(path) as log:
        log.begin(START)
        log.remark("battery low")
        wait_until(lambda: path.read_text().count("\n") == 2)
        wait_until(lambda: forced[-1] == path.stat().st_size)


def test_it_can_be_read_while_it_is_written(tmp_path):
    path = tmp_path / "log.jsonl"
    with Log(path) as log:
        log.begin(START)
        while not path.stat().st_size:
            pass
        assert [event["event"] for event in read(path, "recording")] == ["start"]


def test_why_it_ended(tmp_path):
    def fail():
        with Log(tmp_path / "log.jsonl") as log:
            log.begin(START)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert [*read(tmp_path / "log.jsonl", "recording")][-1]["why"] == "ZeroDivisionError"


def test_an_error_says_that_the_log_failed_at_its_end(tmp_path, monkeypatch):
    """Once: not if it is this failure."""

    def write(file, data):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def stop(words=""):
        with Log(tmp_path / "log.jsonl") as log:
            log.begin(START)
            wait_until(lambda: (tmp_path / "log.jsonl").stat().st_size)
            monkeypatch.setattr(os, "write", write)
            raise RobotStopped(words or "a sensor is silent")

    failure = f"{tmp_path / 'log.jsonl'}: cannot be written: {os.strerror(errno.ENOSPC)}"
    for words, notes in (("", [failure]), (failure, [])):
        with pytest.raises(RobotStopped) as caught:
            stop(words)
        assert getattr(caught.value, "__notes__", []) == notes
        monkeypatch.undo()
        (tmp_path / "log.jsonl").unlink()


def test_every_verb_has_help(robot_command):
    for verb in VERBS:
        code, out, _ = robot_command(verb, "-h")
        assert (code, out.startswith(f"Usage: mercator-robot {verb}")) == (0, True)


@pytest.mark.parametrize(
    ("what", "words"),
    [
        (object(), "TypeError('Object of type object is not JSON serializable')"),
        (math.nan, "ValueError('Out of range float values are not JSON compliant"),
    ],
)
def test_whatever_keeps_a_log_from_being_written_is_its_failure(tmp_path, what, words):
    with Log(tmp_path / "log.jsonl") as log:
        log.note(NoteTaken(time=0.0, text=what))
    assert f"log.jsonl: cannot be written: {words}" in log.failure


@pytest.mark.parametrize("waits", [0.0, 0.8])
def test_a_disk_that_hangs(waits, tmp_path, monkeypatch):
    """It is not written to for ever, nor does the end wait for ever."""
    goes_on, now = threading.Event(), [1000.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])

    def write(file, data):
        goes_on.wait()
        return len(data)

    monkeypatch.setattr(log_module, "DISK_LIMIT", 0.5)
    monkeypatch.setattr(os, "write", write)
    try:
        with Log(tmp_path / "log.jsonl") as log:
            for _ in range(3):  # one is being written, the others wait
                log.note(NoteTaken(time=0.0, text="battery"))
            now[0] += waits
            log.note(NoteTaken(time=0.0, text="battery"))
            assert bool(log.failure) == (waits > 0.5)
        assert log.failure.endswith("log.jsonl: cannot be written: the disk hangs")
    finally:
        goes_on.set()
        log._thread.join()


def test_a_plugin_that_is_missing_is_named(tmp_path):
    with Log(tmp_path / "log.jsonl") as log:
        header = {"module plugins": "walls.py 0123456789abcdef"}
        start = {"flavour": "walls", "header": header, "control_period": 0.1, "reference_model": ReferenceModel()}
        log.begin(RunStarted(robot="mercator", fsm=FSM, **start))
    words = r"log\.jsonl: the start of the log: has modules of the plugin walls\.py; give --plugin"
    with pytest.raises(RobotError, match=words):
        [*replay(tmp_path / "log.jsonl")]
