"""mercator-robot check: what is fine, and what is wrong with what to do."""

from pathlib import Path

import pytest

from mercator_design.robot.check import check_clock, check_console
from tests.robot.devices import Devices


@pytest.fixture
def devices():
    with Devices() as devices:
        devices.robots = [(1.0, 2.0)]
        devices.millimetres = [500, 65535, 20, *[65535] * 5]
        yield devices


@pytest.fixture
def found(robot_command, devices, tmp_path):
    """Run it; gives exit code, what is fine, what is wrong, and messages."""

    def run(**ports):
        names = {name: getattr(devices.names, name) for name in ("rvr", "lidar", "proximity")} | ports
        (tmp_path / "robot.yaml").write_text("ports:\n" + "".join(f"  {name}: {p}\n" for name, p in names.items()))
        code, out, err = robot_command("check", "--robot", tmp_path / "robot.yaml")
        lines = {True: {}, False: {}}
        for line in out.splitlines():
            lines[line.startswith("ok ")][line[7:34].strip()] = line[34:]
        return code, lines[True], lines[False], err

    return run


def test_a_robot_that_is_well(found, devices):
    code, fine, wrong, err = found()
    assert (code, wrong, err) == (0, {}, "")
    assert fine["firmware st"] == "9.1.462"
    assert fine["battery"] == "87 %"
    assert fine["lidar"] == "model 6, firmware 1.5, serial 8312230285877766"
    assert 4.0 <= float(fine["lidar's turns"].split()[0]) <= 7.5
    assert fine["lidar's sight"].endswith("readings in a turn")
    assert fine["sensor 0, at +45 degrees"].startswith("0.50 m;")
    assert fine["sensor 1, at +0 degrees"].startswith("nothing in sight;")
    assert fine["sensor 2, at -45 degrees"].startswith("too near;")
    assert not devices.wheels
    assert devices.lidar_commands[-1] == "stop"


def test_one_that_is_not(found, devices):
    devices.firmware, devices.percentage, devices.mask, devices.robots = (8, 3, 400), 12, 0xFE, []
    code, _, wrong, err = found()
    assert wrong == {
        "firmware nordic": "8.3.400; update it with the app Sphero Edu",
        "firmware st": "8.3.400; update it with the app Sphero Edu",
        "battery": "12 %; charge it",
        "lidar's sight": "0 readings in a turn; is there anything at its height, and its window clean?",
        "sensor 0, at +45 degrees": "off; plug it in",
    }
    assert (code, err) == (1, "Error: 5 wrong\n")


def test_each_device_by_itself(found, devices):
    devices.silent = {"rvr", "proximity"}
    code, _, wrong, err = found(lidar="/dev/no_such_port")
    assert (code, err) == (1, "Error: 3 wrong\n")
    assert wrong["rvr"].startswith("no answer; is it switched on")
    assert wrong["lidar"].startswith("/dev/no_such_port: no such port")
    assert wrong["proximity"].startswith("no answer; is this the hub's port")


def test_a_motor_that_does_not_turn(found, devices):
    devices.stuck = True
    _, _, wrong, _ = found()
    assert wrong == {"lidar's turns": "0.0 a second; does its motor turn? It needs 5 V and 1 A, and a cable for both"}


def test_a_clock_that_was_never_set():
    finding = check_clock(0.0)
    assert not finding.is_fine
    assert " is past; a Pi has no clock of its own" in finding.words
    assert check_clock(Path(__file__).stat().st_mtime + 1e7).is_fine


@pytest.mark.parametrize(
    ("kernel", "is_fine"),
    [
        ("console=serial0,115200 console=tty1 root=PARTUUID=1", False),
        ("8250.nr_uarts=0 console=ttyAMA0 quiet", True),
        ("console=tty1", True),
        ("", True),
    ],
)
def test_a_console_on_the_uart(kernel, is_fine):
    finding = check_console("/dev/serial0", kernel)
    assert finding.is_fine == is_fine
    assert is_fine or "raspi-config" in finding.words


def test_a_console_by_another_name_of_the_uart(tmp_path):
    (tmp_path / "ttyAMA0").touch()
    (tmp_path / "serial0").symlink_to(tmp_path / "ttyAMA0")
    assert not check_console(str(tmp_path / "serial0"), "console=ttyAMA0,115200").is_fine
