"""A recording has all that the devices measured, ends as a run does, and is no run."""

import math
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest

from mercator_design.robot.devices.samples import STANDARD_GRAVITY
from mercator_design.robot.run.mercator import QUERY_EVERY
from mercator_design.robot.run.network import Speaker
from tests.processes import LIMIT
from tests.robot.devices import CLEAR, Devices
from tests.robot.log_events import read, times_of_samples
from tests.robot.ways import MAIN, ROOT, SOON, asked, free_port, made_in_time

RATES = {
    "ground": 20.0,
    "acceleration": 20.0,
    "turning": 20.0,
    "attitude": 20.0,
    "orientation": 20.0,
    "position": 20.0,
    "velocity": 20.0,
    "ambient_light": 20.0,
    "proximity": 6.25,
}
"""What `Devices` tell in a second."""


def write_settings(folder, names, port="null"):
    (folder / "robot.yaml").write_text(
        f"ports: {{rvr: {names.rvr}, lidar: {names.lidar}, proximity: {names.proximity}}}\n"
        f"name: tester\nlidar_angle: 0.5\nswarm: {{port: {port}}}\n"
    )


@contextmanager
def recording(folder, *options, port="null"):
    """Devices, and `mercator-robot record` on them, as a process."""
    with Devices() as devices:
        write_settings(folder, devices.names, port)
        process = subprocess.Popen(
            [
                sys.executable,
                "-c",
                SOON + MAIN,
                "record",
                "--robot",
                "robot.yaml",
                "-o",
                "recording.jsonl",
                *map(str, options),
            ],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            yield devices, process
        finally:
            process.kill()
            process.communicate()


@pytest.fixture
def record(simulated, robot_command, tmp_path, monkeypatch):
    """Runs `mercator-robot record` in simulated time; gives its exit code, and what was said."""
    monkeypatch.chdir(tmp_path)

    def run(*options):
        write_settings(tmp_path, simulated.names)
        code, _, error = robot_command("record", "--robot", "robot.yaml", "-o", "recording.jsonl", *options)
        return code, error

    return run


def records(devices):
    """Whether a recording has gone on for a while."""
    began = []

    def is_so():
        if not began and "scan" in devices.lidar_commands:
            began.append(devices.now)
        return bool(began) and devices.now > began[0] + 1.0

    return is_so


def events(folder, kind=None):
    found = read(folder / "recording.jsonl", "recording")
    return [event for event in found if kind in (None, event["event"])]


def until_it_records(devices, folder):
    path = folder / "recording.jsonl"
    devices.when(lambda: path.exists() and path.stat().st_size > 2000)


def test_every_sample_of_every_sensor(record, simulated, tmp_path):
    simulated.measured |= {"ground_sensors": (200, 100, 50), "accelerometer": (0.0, 1.0, 1.0)}
    simulated.measured["proximity"] = [0.02, 0.5, 1.999, *CLEAR[3:]]
    code, messages = record("--duration", 1.5)
    assert code == 0, messages
    assert "The recording is recording.jsonl" in messages
    assert not simulated.drives()
    assert [name for _, name, _ in simulated.commands].count("drive_stop") >= 2
    start, *rest, end = events(tmp_path)
    assert (start["kind"], start["robot"], start["lidar_angle"]) == ("recording", "tester", 0.5)
    assert len(start["proximity_angles"]) == 8
    assert end["why"] == "The duration is over"
    samples = {name: [each for each in rest if each.get("sensor") == name] for name in RATES}
    for name, rate in RATES.items():
        times = [each["time"] for each in samples[name]]
        assert len(times) == pytest.approx(1.5 * rate, abs=2), name
        assert times == sorted(times)
        assert 0.0 <= times[0] <= times[-1] <= 1.5
    assert samples["ground"][-1]["values"] == [200, 100, 50]
    ahead, aside, up = samples["acceleration"][-1]["values"]
    assert (ahead, up) == pytest.approx((STANDARD_GRAVITY, STANDARD_GRAVITY), abs=1e-4)
    assert aside == pytest.approx(0.0, abs=1e-4)
    assert samples["proximity"][-1]["values"] == [0.0, 0.5, 1.999, *[None] * 5]
    turns = [each for each in rest if each["event"] == "turn"]
    assert 5 <= len(turns) <= 13
    assert {len(turn["readings"]) for turn in turns} == {719}


def test_turns_have_angles_from_the_robot_s_front(record, simulated, tmp_path):
    simulated.heads = [(1.0, 0.8)]
    record("--duration", 1)
    *_, turn = events(tmp_path, "turn")
    seen = [angle for angle, reach in turn["readings"] if reach == 0.8]
    assert sum(seen) / len(seen) == pytest.approx(1.0 + 0.5, abs=math.radians(0.5))


@pytest.mark.parametrize(
    ("number", "options", "code"),
    [
        (signal.SIGINT, (), 0),
        (signal.SIGINT, ("--duration", 60), 130),
        (signal.SIGTERM, (), 143),
        (signal.SIGHUP, (), 129),
    ],
)
def test_signals_end_it_and_leave_it_whole(record, simulated, tmp_path, number, options, code):
    simulated.then(records(simulated), lambda: os.kill(os.getpid(), number))
    returned, messages = record(*options)
    assert returned == code, messages
    assert [name for _, name, _ in simulated.commands].count("drive_stop") >= 2
    assert simulated.lidar_commands[-2:] == ["force_stop", "stop"]
    assert events(tmp_path)[-1]["why"] == f"Stopped by {number.name}."


def test_ctrl_c_is_an_error_if_the_stop_is_not_confirmed(record, simulated):
    def interrupt():
        simulated.silent.add("rvr")
        os.kill(os.getpid(), signal.SIGINT)

    simulated.then(records(simulated), interrupt)
    code, messages = record()
    assert (code, "Stopped by SIGINT.; RVR stop not confirmed: " in messages) == (130, True), messages


@pytest.mark.timing
@made_in_time
def test_a_signal_ends_a_process_and_leaves_its_recording_whole(tmp_path):
    with recording(tmp_path) as (devices, process):
        until_it_records(devices, tmp_path)
        process.send_signal(signal.SIGTERM)
        _, messages = process.communicate(timeout=LIMIT)
        assert process.returncode == 143, messages
        devices.when(lambda: devices.lidar_commands[-2:] == ["force_stop", "stop"])
    assert events(tmp_path)[-1]["why"] == "Stopped by SIGTERM."


def test_ctrl_c_before_it_records_is_an_interruption(record, simulated, tmp_path):
    simulated.silent.add("rvr")
    simulated.then(lambda: simulated.commands, lambda: os.kill(os.getpid(), signal.SIGINT))
    assert record()[0] == 130
    assert not (tmp_path / "recording.jsonl").exists()


@pytest.mark.timing
@made_in_time
def test_it_is_whole_to_its_last_line_when_the_process_is_killed(tmp_path):
    with recording(tmp_path) as (devices, process):
        until_it_records(devices, tmp_path)
        process.kill()
        process.wait()
    assert len(events(tmp_path, "sample")) > 5
    assert not events(tmp_path, "end")


def test_sensors_that_fall_silent_are_told_and_the_others_go_on(record, simulated, tmp_path):
    fell = []

    def fall(name):
        simulated.silent.add(name)
        fell.append(simulated.now)

    simulated.then(records(simulated), lambda: fall("proximity"))
    simulated.then(lambda: simulated.now > fell[0] + 2.0, lambda: fall("lidar"))
    simulated.then(lambda: simulated.now > fell[1] + 2.0, lambda: os.kill(os.getpid(), signal.SIGINT))
    _, messages = record()
    silent = {
        note["text"].partition(":")[0]: note for note in events(tmp_path, "note") if ": nothing for" in note["text"]
    }
    assert list(silent) == ["proximity", "lidar"]
    for name in silent:
        assert messages.count(f"Warning: {name}: nothing for") == 1
    assert sum(each["time"] > silent["lidar"]["time"] for each in events(tmp_path, "sample")) > 20


@pytest.mark.timing
@made_in_time
def test_a_program_that_was_suspended_tells_of_the_gap(tmp_path):
    def noted():
        return [note["text"] for note in events(tmp_path, "note")]

    with recording(tmp_path) as (devices, process):
        until_it_records(devices, tmp_path)
        process.send_signal(signal.SIGSTOP)
        time.sleep(0.8)
        process.send_signal(signal.SIGCONT)
        devices.when(lambda: any(each.startswith("held up") for each in noted()))
        process.send_signal(signal.SIGINT)
        _, messages = process.communicate(timeout=LIMIT)
        assert process.returncode == 0, messages
    told = re.findall(r"Warning: (held up for (\S+) s: samples are missing, or have wrong times)", messages)
    assert max(float(seconds) for _, seconds in told) > 0.5
    assert [text for text, _ in told] == [each for each in noted() if each.startswith("held up")]


def test_the_battery_is_asked_after(record, simulated):
    record("--duration", 5)
    assert asked(simulated) >= 5.0 / QUERY_EVERY


def test_a_device_that_is_not_well_ends_it(record, simulated, tmp_path):
    simulated.then(records(simulated), lambda: simulated.tell("did_sleep"))
    code, messages = record()
    assert (code, "rvr: it fell asleep" in messages) == (4, True), messages
    assert events(tmp_path, "note")[-1]["text"] == "rvr: did sleep"
    assert events(tmp_path)[-1]["why"] == "rvr: it fell asleep"


def test_what_was_heard_in_the_wait_that_ended_it_is_recorded(record, simulated, tmp_path, monkeypatch):
    heard = times_of_samples(monkeypatch)
    simulated.then(records(simulated), lambda: setattr(simulated.rvr, "level", 2.0))
    code, messages = record()
    assert (code, "battery" in messages) == (4, True), messages
    assert [each["time"] for each in events(tmp_path, "sample")] == heard()


@pytest.mark.timing
@made_in_time
def test_the_swarm_is_told_to_stop(tmp_path):
    port = free_port()
    with recording(tmp_path, port=port) as (devices, process), Speaker(["127.0.0.1"], port) as speaker:
        until_it_records(devices, tmp_path)
        answers = speaker.stop()
        _, messages = process.communicate(timeout=LIMIT)
        assert (process.returncode, "swarm: stop received from 127.0.0.1" in messages) == (4, True), messages
    assert answers == (["tester (127.0.0.1)"], []), "too busy?"
    assert events(tmp_path)[-1]["why"] == "swarm: stop received from 127.0.0.1"


def test_an_existing_file_is_kept(record, tmp_path):
    (tmp_path / "recording.jsonl").write_text("mine")
    code, messages = record()
    assert (code, "recording.jsonl: cannot be written: File exists" in messages) == (1, True), messages
    assert (tmp_path / "recording.jsonl").read_text() == "mine"


def test_a_recording_is_no_run(record, tmp_path, robot_command):
    record("--duration", 0.5)
    code, _, err = robot_command("replay", tmp_path / "recording.jsonl")
    assert code == 1
    assert "recording.jsonl, line 1: expected the log of a run, found that of a recording" in err
