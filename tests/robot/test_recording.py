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
from mercator_design.robot.run.network import Speaker
from tests.robot.devices import CLEAR, Devices
from tests.robot.log_events import read
from tests.robot.ways import MAIN, OFTEN, ROOT, SOON, asked, free_port

pytestmark = pytest.mark.timing

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


@contextmanager
def recording(folder, *options, lead="", port="null"):
    """Devices, and `mercator-robot record` on them."""
    with Devices() as devices:
        names = devices.names
        (folder / "robot.yaml").write_text(
            f"ports: {{rvr: {names.rvr}, lidar: {names.lidar}, proximity: {names.proximity}}}\n"
            f"name: tester\nlidar_angle: 0.5\nswarm: {{port: {port}}}\n"
        )
        process = subprocess.Popen(
            [
                sys.executable,
                "-c",
                SOON + lead + MAIN,
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


def events(folder, kind=None):
    found = read(folder / "recording.jsonl", "recording")
    return [event for event in found if kind in (None, event["event"])]


def until_it_records(devices, folder):
    path = folder / "recording.jsonl"
    devices.when(lambda: path.exists() and path.stat().st_size > 2000)


def test_every_sample_of_every_sensor(tmp_path):
    with recording(tmp_path, "--duration", 1.5) as (devices, process):
        devices.measured |= {"ground_sensors": (200, 100, 50), "accelerometer": (0.0, 1.0, 1.0)}
        devices.measured["proximity"] = [0.02, 0.5, 1.999, *CLEAR[3:]]
        _, messages = process.communicate(timeout=30)
        assert process.returncode == 0, messages
        assert "The recording is recording.jsonl" in messages
        assert not devices.drives()
        assert [name for _, name, _ in devices.commands].count("drive_stop") >= 2
    start, *rest, end = events(tmp_path)
    assert (start["kind"], start["robot"], start["lidar_angle"]) == ("recording", "tester", 0.5)
    assert len(start["proximity_angles"]) == 8
    assert end["why"] == "The duration is over"
    samples = {name: [each for each in rest if each.get("sensor") == name] for name in RATES}
    for name, rate in RATES.items():
        times = [each["time"] for each in samples[name]]
        assert 0.5 * 1.5 * rate <= len(times) <= 1.2 * 1.5 * rate, name
        assert times == sorted(times)
        assert 0.0 <= times[0] <= times[-1] <= 1.7
    assert samples["ground"][-1]["values"] == [200, 100, 50]
    ahead, aside, up = samples["acceleration"][-1]["values"]
    assert (ahead, up) == pytest.approx((STANDARD_GRAVITY, STANDARD_GRAVITY), abs=1e-4)
    assert aside == pytest.approx(0.0, abs=1e-4)
    assert samples["proximity"][-1]["values"] == [0.0, 0.5, 1.999, *[None] * 5]
    turns = [each for each in rest if each["event"] == "turn"]
    assert 5 <= len(turns) <= 13
    assert {len(turn["readings"]) for turn in turns} == {719}


def test_turns_have_angles_from_the_robot_s_front(tmp_path):
    with recording(tmp_path, "--duration", 1) as (devices, process):
        devices.heads = [(1.0, 0.8)]
        process.communicate(timeout=30)
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
def test_signals_end_it_and_leave_it_whole(tmp_path, number, options, code):
    with recording(tmp_path, *options) as (devices, process):
        until_it_records(devices, tmp_path)
        process.send_signal(number)
        _, messages = process.communicate(timeout=10)
        assert process.returncode == code, messages
        assert [name for _, name, _ in devices.commands].count("drive_stop") >= 2
        devices.when(lambda: devices.lidar_commands[-2:] == ["force_stop", "stop"])
    assert events(tmp_path)[-1]["why"] == f"Stopped by {number.name}."


def test_ctrl_c_before_it_records_is_an_interruption(tmp_path):
    with recording(tmp_path) as (devices, process):
        devices.silent.add("rvr")
        devices.when(lambda: devices.commands)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=20)
        assert process.returncode == 130
    assert not (tmp_path / "recording.jsonl").exists()


def test_it_is_whole_to_its_last_line_when_the_process_is_killed(tmp_path):
    with recording(tmp_path) as (devices, process):
        until_it_records(devices, tmp_path)
        process.kill()
        process.wait()
    assert len(events(tmp_path, "sample")) > 5
    assert not events(tmp_path, "end")


def test_sensors_that_fall_silent_are_told_and_the_others_go_on(tmp_path):
    def told(name):
        return [note["text"] for note in events(tmp_path, "note") if note["text"].startswith(f"{name}: nothing for")]

    with recording(tmp_path) as (devices, process):
        until_it_records(devices, tmp_path)
        for name in ("proximity", "lidar"):
            devices.silent.add(name)
            devices.when(lambda name=name: told(name))
        before = len(events(tmp_path, "sample"))
        devices.when(lambda: len(events(tmp_path, "sample")) > before + 20)
        process.send_signal(signal.SIGINT)
        _, messages = process.communicate(timeout=10)
    for name in ("proximity", "lidar"):
        assert messages.count(f"Warning: {name}: nothing for") == 1
        assert len(told(name)) == 1


def test_a_program_that_was_suspended_tells_of_the_gap(tmp_path):
    def noted():
        return [note["text"] for note in events(tmp_path, "note")]

    with recording(tmp_path) as (devices, process):
        until_it_records(devices, tmp_path)
        process.send_signal(signal.SIGSTOP)
        time.sleep(1.5)
        process.send_signal(signal.SIGCONT)
        devices.when(lambda: any(each.startswith("held up") for each in noted()))
        process.send_signal(signal.SIGINT)
        _, messages = process.communicate(timeout=10)
        assert process.returncode == 0, messages
    told = re.findall(r"Warning: (held up for (\S+) s: samples are missing, or have wrong times)", messages)
    assert max(float(seconds) for _, seconds in told) > 1.0
    assert [text for text, _ in told] == [each for each in noted() if each.startswith("held up")]


def test_the_battery_is_asked_after(tmp_path):
    with recording(tmp_path, lead=OFTEN) as (devices, _):
        devices.when(lambda: asked(devices) > 2)


def test_a_device_that_is_not_well_ends_it(tmp_path):
    with recording(tmp_path) as (devices, process):
        until_it_records(devices, tmp_path)
        devices.tell("did_sleep")
        _, messages = process.communicate(timeout=10)
        assert (process.returncode, "rvr: it fell asleep" in messages) == (4, True), messages
    *_, told, end = events(tmp_path)
    assert (told["event"], told["text"]) == ("note", "rvr: did sleep")
    assert end["why"] == "rvr: it fell asleep"


def test_the_swarm_is_told_to_stop(tmp_path):
    port = free_port()
    with recording(tmp_path, port=port) as (devices, process), Speaker(["127.0.0.1"], port) as speaker:
        until_it_records(devices, tmp_path)
        assert speaker.stop() == (["tester (127.0.0.1)"], [])
        _, messages = process.communicate(timeout=10)
        assert (process.returncode, "swarm: stop received from 127.0.0.1" in messages) == (4, True), messages
    assert events(tmp_path)[-1]["why"] == "swarm: stop received from 127.0.0.1"


def test_an_existing_file_is_kept(tmp_path):
    (tmp_path / "recording.jsonl").write_text("mine")
    with recording(tmp_path) as (_, process):
        _, messages = process.communicate(timeout=20)
        assert (process.returncode, "recording.jsonl: cannot be written: File exists" in messages) == (1, True), (
            messages
        )
    assert (tmp_path / "recording.jsonl").read_text() == "mine"


def test_a_recording_is_no_run(tmp_path, robot_command):
    with recording(tmp_path, "--duration", 0.5) as (_, process):
        process.communicate(timeout=20)
    code, _, err = robot_command("replay", tmp_path / "recording.jsonl")
    assert code == 1
    assert "recording.jsonl, line 1: expected the log of a run, found that of a recording" in err
