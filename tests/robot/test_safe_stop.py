"""mercator-robot stop, without a host: this robot is at rest, whatever drove it."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mercator_design.robot.devices import link, ports, start
from mercator_design.robot.devices.ports import open_port
from mercator_design.robot.protocols.rvr import Host
from mercator_design.robot.protocols.ydlidar import encode_command
from mercator_design.robot.run import safe_stop
from tests.processes import LIMIT
from tests.robot.devices import Devices
from tests.robot.ways import LAST, LATE, MAIN, PATIENT, SLOW, SOON, free_port, made_in_time, running


@pytest.fixture
def devices():
    with Devices() as devices:
        yield devices


@pytest.fixture
def stop(robot_command, devices, tmp_path, monkeypatch):
    """Run it; gives exit code, rows by what they are about, and messages. Devices have time on a busy machine."""
    monkeypatch.setattr(link, "ANSWER_WAIT", LIMIT)
    monkeypatch.setattr(ports, "TIMEOUT", 0.5)

    def run(**others):
        names = {name: getattr(devices.names, name) for name in ("rvr", "lidar", "proximity")} | others
        listed = ", ".join(f"{name}: {path}" for name, path in names.items())
        (tmp_path / "robot.yaml").write_text(f"ports: {{{listed}}}\nswarm: {{port: {free_port()}}}\n")
        code, out, err = robot_command("stop", "--robot", tmp_path / "robot.yaml")
        return code, {line[7:34].strip(): (line.startswith("ok "), line[34:]) for line in out.splitlines()}, err

    return run


def alone(devices, folder):
    """The settings of a robot that hears no swarm."""
    names = devices.names
    (folder / "robot.yaml").write_text(f"ports: {{rvr: {names.rvr}, lidar: {names.lidar}}}\nswarm: {{port: null}}\n")


def leave_running(devices):
    """What a program that was killed leaves behind: a robot that drives for a minute, and a lidar that turns."""
    host = Host()
    with open_port("rvr", devices.names.rvr) as port, open_port("lidar", devices.names.lidar) as lidar:
        port.write(host.send("set_custom_control_system_timeout", command_timeout=60_000))
        port.write(host.send("start_streaming_service", period=50))
        port.write(host.send("drive_tank_si_units", left_velocity=0.3, right_velocity=0.3))
        lidar.write(encode_command("scan"))
        devices.when(lambda: devices.drives() and devices.lidar_commands)
    devices.when(devices.is_let_go)


@pytest.mark.timing
def test_after_a_program_that_was_killed(stop, devices):
    leave_running(devices)
    assert stop() == (
        0,
        {"rvr": (True, "at rest; battery 87 %"), "lidar": (True, "stop sent")},
        "",
    )
    devices.rests_since()
    assert devices.stopped_by() != "timeout"
    devices.when(lambda: devices.commands[-1][1] == LAST)
    names = [name for _, name, _ in devices.commands]
    names = names[names.index("drive_stop") - 1 :]
    assert names[:4] == ["drive_tank_si_units", "drive_stop"] * 2
    assert names[-7:] == [
        *["clear_streaming_service"] * 2,
        "enable_color_detection",
        "release_led_requests",
        "drive_stop",
        "restore_default_control_system_timeout",
        LAST,
    ]
    assert next(v for _, name, v in devices.commands if name == "enable_color_detection") == {"is_enabled": False}
    devices.when(lambda: devices.lidar_commands[-2:] == ["force_stop", "stop"])


def test_a_robot_that_drives_is_at_rest_within_a_second(robot_command, simulated, tmp_path):
    alone(simulated, tmp_path)
    leave_running(simulated)
    began = time.monotonic()
    code, _, err = robot_command("stop", "--robot", tmp_path / "robot.yaml")
    assert (code, err) == (0, "")
    assert simulated.told_to_rest(began) < 1.0


def test_output_that_cannot_be_written_keeps_nothing_from_being_stopped(devices, tmp_path):
    alone(devices, tmp_path)
    leave_running(devices)
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-c", SOON + MAIN, "stop", "--robot", tmp_path / "robot.yaml"],
            cwd=Path(__file__).parents[2],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert (done.returncode, done.stderr) == (1, "Error: [Errno 28] No space left on device\n")
    devices.rests_since()
    devices.when(lambda: devices.lidar_commands[-2:] == ["force_stop", "stop"])


@pytest.mark.timing
@made_in_time
def test_a_run_in_progress(robot_command, tmp_path, monkeypatch):
    monkeypatch.setattr(link, "ANSWER_WAIT", LIMIT)
    monkeypatch.setattr(safe_stop, "END_WAIT", LIMIT)
    with running(tmp_path, lead=SOON + SLOW) as robot:
        robot.drives()
        code, out, err = robot_command("stop", "--robot", tmp_path / "robot.yaml")
        assert (code, err) == (0, ""), (out, err, "too busy?")
        run, rvr, lidar = out.splitlines()
        assert run.split(maxsplit=2) == ["ok", "run", "mercator (127.0.0.1) has stopped"]
        assert rvr.startswith("ok     rvr ")
        assert lidar.startswith("ok     lidar ")
        returned, error = robot.ended()
        assert (returned, "swarm: stop received from 127.0.0.1" in error) == (4, True), error
        robot.devices.rests_since()


@pytest.mark.timing
def test_a_run_that_is_suspended_has_the_port(robot_command, tmp_path):
    with running(tmp_path, settings=LATE, lead=SOON + PATIENT) as robot:
        robot.drives()
        robot.process.send_signal(signal.SIGSTOP)
        code, out, err = robot_command("stop", "--robot", tmp_path / "robot.yaml")
        assert (code, err) == (1, "Error: 2 wrong\n")
        for row in out.splitlines():
            assert row.startswith("WRONG  ")
            assert f"process {robot.process.pid}, suspended: `kill -KILL {robot.process.pid}`); end it first" in row


def test_a_lidar_that_is_missing(stop):
    code, rows, err = stop(lidar="/dev/no_such_port")
    assert (code, err) == (1, "Error: 1 wrong\n")
    assert rows["rvr"] == (True, "at rest; battery 87 %")
    assert rows["lidar"][1].startswith("/dev/no_such_port: no such port")


def test_a_port_that_another_program_has(stop, devices):
    code = f"import serial, sys; port = serial.Serial({devices.names.rvr!r}, exclusive=True); print(flush=True); "
    code += "sys.stdin.read()"
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        other.stdout.readline()
        code, rows, err = stop()
        assert (code, err) == (1, "Error: 1 wrong\n")
        assert rows["rvr"][1].endswith(f"process {other.pid}); end it first")
        assert rows["lidar"] == (True, "stop sent")
        devices.when(lambda: devices.lidar_commands == ["force_stop", "stop"])
        other.stdin.close()


def test_a_robot_that_does_not_answer_is_reported_nevertheless(stop, devices, monkeypatch):
    monkeypatch.setattr(link, "TRIES", 2)
    monkeypatch.setattr(link, "ANSWER_WAIT", 0.3)
    monkeypatch.setattr(start, "WAKE_WAIT", 0.2)
    leave_running(devices)
    devices.silent, devices.rvr.leds[:] = {"rvr"}, b"\xff" * len(devices.rvr.leds)
    code, rows, _ = stop()
    assert (code, rows["rvr"][1].startswith("no answer; ")) == (1, True)
    devices.rests_since()
    assert not any(devices.rvr.leds)
    assert [values for _, name, values in devices.commands if name == "enable_color_detection"] == [
        {"is_enabled": False}
    ]
