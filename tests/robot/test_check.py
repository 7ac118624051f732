"""mercator-robot check: what is fine, and what is wrong with what to do."""

import math
import os
import re
import signal
import subprocess
import sys
from collections import deque
from contextlib import closing

import pytest
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.protocols.ydlidar import DeviceInfo, Health, Packet, ScanStarted
from mercator_design.robot.setup import check as checking
from mercator_design.robot.setup.judging import rate_of
from tests.processes import started
from tests.robot.devices import CLEAR


@pytest.fixture
def devices(simulated, monkeypatch):
    monkeypatch.setattr(checking, "DURATION", 1.0)
    simulated.heads = [(1.0, 2.0)]
    simulated.measured["proximity"] = [0.5, math.inf, 0.02, *CLEAR[3:]]
    return simulated


@pytest.fixture
def found(robot_command, devices, tmp_path, processes):
    """Run it; gives exit code, what is fine, what is wrong, and messages."""

    def run(**ports):
        names = {name: getattr(devices.names, name) for name in ("rvr", "lidar", "proximity")} | ports
        (tmp_path / "robot.yaml").write_text("ports:\n" + "".join(f"  {name}: {p}\n" for name, p in names.items()))
        code, out, err = robot_command("check", "--robot", tmp_path / "robot.yaml")
        lines = {True: {}, False: {}}
        for line in out.splitlines():
            lines[not line.startswith("WRONG ")][line[7:34].strip()] = line[34:]
        return code, lines[True], lines[False], err

    return run


def test_a_robot_that_is_well(found, devices, monkeypatch):
    monkeypatch.setattr(checking, "DURATION", 2.0)
    code, fine, wrong, err = found()
    assert (code, wrong, err) == (0, {}, "")
    assert fine["firmware st"] == "9.2.482"
    assert fine["battery"] == "87 %"
    assert fine["motors"] == "left 30 and right 30 degrees"
    for device in ("rvr", "lidar", "proximity"):
        assert re.fullmatch(r"100\.0 % arrives whole; 0 of \d+ bytes lost, 0 frames refused", fine[f"{device}'s line"])
    assert fine["rvr's echoes"] == "40 of 40 were answered"
    assert fine["lidar"] == "model 6, firmware 1.4, serial 2026112100000000"
    assert 4.0 <= float(fine["lidar's turns"].split()[0]) <= 7.5
    assert fine["lidar's sight"].endswith("readings in a turn")
    assert fine["sensor 0, at +45 degrees"].startswith("0.50 m;")
    assert fine["sensor 1, at +0 degrees"].startswith("nothing in sight;")
    assert fine["sensor 2, at -45 degrees"].startswith("too near;")
    assert fine["rvr's drive"] == "commands end by themselves after 0.3 s"
    assert fine["rvr's reports"] == "of battery and motors"
    for sensor in ("attitude", "ground", "ambient light"):
        assert fine[f"rvr's {sensor}"] == "20.0 samples a second"
    assert fine["ground's colour"] == "7 8 6, which is black"
    assert not devices.drives()
    assert devices.lidar_commands[-1] == "stop"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
@pytest.mark.parametrize("command", ["start_streaming_service", "device_info", "scan"])
def test_a_signal_leaves_nothing_on(found, devices, command, number):
    def is_heard():
        return command in [*devices.lidar_commands, *(name for _, name, _ in devices.commands)]

    devices.then(is_heard, lambda: os.kill(os.getpid(), number))
    code, _, _, err = found()
    assert (code, err) == (128 + number, f"Stopped by {number.name}.\n")
    assert not devices.rvr.senses._streams
    assert devices.lidar_commands[-1:] == ([] if command == "start_streaming_service" else ["stop"])


def test_a_check_that_nobody_reads_to_its_end_stops_the_lidar(devices):
    with closing(checking.check(Settings(ports=devices.names))) as found:
        assert any(each.what == "lidar" for each in found)
        assert devices.lidar_commands[-1] == "scan"
    assert devices.lidar_commands[-1] == "stop"


def test_one_that_is_not(found, devices):
    devices.instead["get_main_application_version"] = {"major": 8, "minor": 3, "revision": 400}
    devices.rvr.level, devices.hub.plugged_in = 12.0, 0xFE
    devices.rvr.heat({1: 65.0})
    code, _, wrong, err = found()
    assert wrong == {
        "firmware nordic": "8.3.400; update it with the app Sphero Edu",
        "firmware st": "8.3.400; update it with the app Sphero Edu",
        "battery": "12 %; it is low: charge it",
        "motors": "left 30 and right 65 degrees; right too hot: let it cool, and leave the RVR switched on",
        "sensor 0, at +45 degrees": "off; plug it in",
    }
    assert (code, err) == (1, "Error: 5 wrong\n")


def test_a_battery_that_is_low_by_the_word_of_the_rvr(found, devices):
    devices.rvr.level = 30.0  # above limits.battery_low
    devices.when(lambda: devices.rvr.get_battery_voltage_state() == {"state": 2})
    assert found()[2] == {"battery": "30 %; it is low: charge it"}


def test_a_battery_with_which_no_run_starts(found, devices):
    devices.rvr.level = 4.0
    assert found()[2] == {"battery": "4 %; it is critical: no run starts: charge it"}


def test_lines_that_are_damaged(found, devices):
    """One byte of a hundred is wrong: three of five packets of the lidar are refused."""
    devices.torn = {"lidar"}
    devices.noisy = {"rvr", "proximity"}
    _, _, wrong, _ = found()
    assert wrong.keys() == {"rvr's line", "lidar's line", "proximity's line"}
    words = r"\d\d\.\d % arrives whole; \d+ of \d+ bytes lost, \d+ frames refused; "
    words += r"in a run it counts as silent below \d0 %; is its (USB )?cable loose, .*\((rvr|lidar|proximity) on /.*\)"
    assert all(re.fullmatch(words, line) for line in wrong.values()), wrong


def test_commands_that_do_not_arrive_are_found_by_echoes(found, devices):
    devices.instead["echo"] = {"error": 7}  # bad data value: damaged on its way
    _, _, wrong, _ = found()
    assert wrong.keys() == {"rvr's echoes"}
    assert wrong["rvr's echoes"].startswith("0 of 20 were answered; a run stops below 80 %; is its cable loose")


def lidar_answers(devices, *damaged):
    """What it answers first to who asks for its device info, or its health; then the truth."""
    answers, usual = deque(damaged), devices.lidar.obey

    def obey(command, now):
        said = usual(command, now)
        kinds = {"device_info": DeviceInfo, "health": Health}
        is_next = bool(said and answers) and isinstance(answers[0], kinds.get(command, Packet))
        return answers.popleft().encode() if is_next else said

    devices.lidar.obey = obey


WRONG = [DeviceInfo(6 + k, (1, 4), 1, "2026112100000000") for k in range(1, 100)]


@pytest.mark.parametrize("damaged", [WRONG[:1], WRONG[:3]])
def test_what_the_lidar_is_is_what_it_says_twice(found, devices, damaged):
    """Its answers have no checksum."""
    lidar_answers(devices, *damaged)
    _, fine, _, _ = found()
    assert fine["lidar"] == "model 6, firmware 1.4, serial 2026112100000000"


def test_what_cannot_be_read_for_sure_is_not_told_as_a_fact(found, robot_command, devices, tmp_path):
    lidar_answers(devices, *WRONG)
    _, fine, _, _ = found()
    assert fine["lidar"] == "model and firmware are not certain: all answers differ"
    lidar_answers(devices, *WRONG)
    _, out, _ = robot_command("check", "--robot", tmp_path / "robot.yaml")
    assert any(row.startswith("look   lidar  ") for row in out.splitlines())


def test_a_lidar_that_scans_though_its_answer_was_lost(found, devices):
    """While it scans it hears nothing but a stop."""
    usual, lost = devices.lidar.obey, []

    def obey(command, now):
        said = usual(command, now)
        is_lost = bool(said) and command == "scan" and not lost
        lost.extend([said] * is_lost)
        return b"" if is_lost else said

    devices.lidar.obey = obey
    assert found()[2] == {}
    assert lost == [ScanStarted().encode()]


def test_a_damaged_answer_is_not_an_error_of_the_lidar(found, devices):
    lidar_answers(devices, Health(2, 0x400))
    assert found()[2] == {}
    lidar_answers(devices, *(Health(k % 3, k) for k in range(1, 100)))
    assert found()[2]["lidar"].startswith("its answers about its health differ; is its cable loose")


def test_a_lidar_around_which_nothing_is_may_be_fine(robot_command, found, devices, tmp_path):
    """As on a twin of one robot: nobody can tell it from one whose laser fails."""
    devices.heads = []
    code, _, wrong, _ = found()
    assert (code, wrong) == (0, {})
    code, out, _ = robot_command("check", "--robot", tmp_path / "robot.yaml")
    (row,) = [line for line in out.splitlines() if "lidar's sight" in line]
    assert row.startswith("look   lidar's sight")
    assert (
        "0 readings in a turn; is there nothing at its height within 12 m, is it covered, or has its laser failed"
        in row
    )


@pytest.mark.parametrize("left_out", [["lidar"], ["proximity", "lidar"]])
def test_devices_that_are_left_out(found, robot_command, devices, tmp_path, left_out):
    """They are not touched, and neither they nor the names of their ports can be wrong."""
    devices.unplugged |= set(left_out)
    found()
    options = [word for device in left_out for word in ("--without", device)]
    code, out, _ = robot_command("check", "--robot", tmp_path / "robot.yaml", *options)
    rows = [line for line in out.splitlines() if line[7:].startswith(("lidar", "proximity", "hub"))]
    assert code == 0, out
    assert [row for row in rows if "left out" in row] == [
        f"ok     {each:<26} left out, by --without" for each in left_out
    ]
    assert any(row[7:].startswith("hub") for row in rows) == ("proximity" not in left_out)
    assert devices.lidar_commands == []


def test_each_device_by_itself(found, devices):
    devices.silent = {"rvr", "proximity"}
    code, _, wrong, err = found(lidar="/dev/no_such_port")
    assert (code, err) == (1, "Error: 3 wrong\n")
    causes = ("switched on", "Sphero Edu", "TX and RX", "login shell", "yellow", "joined")
    places = [wrong["rvr"].index(cause) for cause in causes]
    assert wrong["rvr"].startswith("no answer; is it")
    assert places == sorted(places)
    assert wrong["lidar"].startswith("/dev/no_such_port: no such port")
    assert wrong["proximity"].startswith("no answer; is this the hub's port")


@pytest.mark.parametrize(
    ("device", "trouble", "words"),
    [
        (
            "rvr",
            lambda d: d.wrong_baud.add("rvr"),
            "bytes from it make no sense: another device, or another baud rate)",
        ),
        (
            "lidar",
            lambda d: d.silent.add("lidar"),
            "no answer; has it power (5 V, 1 A, and more while its motor starts)?",
        ),
        (
            "lidar",
            lambda d: setattr(d.lidar, "health", 2),
            "it reports an error, 0x0; take its power away for a moment",
        ),
        (
            "proximity",
            lambda d: d.silent.add("proximity"),
            "are all sensors plugged in? Unplug the hub and plug it in again",
        ),
    ],
)
def test_one_that_cannot_be_used(found, devices, device, trouble, words):
    trouble(devices)
    code, _, wrong, _ = found()
    assert (code, words in wrong[device]) == (1, True), wrong


def test_a_lidar_s_warning(found, devices):
    devices.lidar.health = 1
    code, _, wrong, _ = found()
    assert (code, wrong) == (1, {"lidar's health": "a warning, 0x0; take its power away for a moment"})


@pytest.mark.parametrize(
    ("trouble", "words"),
    [
        (
            lambda d: setattr(d.hub, "is_old", True),
            "it refuses command 0x52 as bad: is its firmware too old? Update it",
        ),
        (lambda d: d.deaf.add("proximity"), "it does not acknowledge command 0x52: is its firmware too old?"),
    ],
)
def test_a_hub_that_obeys_no_command_and_sends_distances(found, devices, trouble, words):
    """A run needs no more."""
    trouble(devices)
    code, fine, _, _ = found()
    assert (code, fine["hub's answers"]) == (0, words)
    assert "hub" in fine


@pytest.mark.parametrize(
    ("trouble", "words"),
    [
        (
            lambda d: setattr(d.hub, "is_old", True),
            "it refuses command 0x11 as bad: is its firmware too old? Update it",
        ),
        (lambda d: None, "no answer; "),
    ],
)
def test_a_hub_that_obeys_no_command_and_sends_none(found, devices, trouble, words):
    trouble(devices)
    devices.hub.advance = lambda now: b""
    devices.hub.receive = lambda data, now: b"".join(map(devices.hub.obey, devices.hub._line.receive(data)))
    if words == "no answer; ":
        devices.silent.add("proximity")
    assert found()[2]["proximity"].startswith(words)


def test_names_that_others_may_have(found, monkeypatch):
    hub, radio = ListPortInfo("/dev/ttyACM0"), ListPortInfo("/dev/ttyACM1")
    hub.vid, hub.pid, hub.serial_number = 0x0483, 0x5740, "3058"
    radio.vid, radio.pid = 0x1366, 0x0105
    monkeypatch.setattr(list_ports, "comports", lambda: [hub, radio])
    _, _, wrong, _ = found(lidar="/dev/ttyUSB0", proximity="/dev/ttyACM0")
    assert {name: words for name, words in wrong.items() if name.endswith("name")} == {
        "proximity's name": "/dev/ttyACM0 may be any of /dev/ttyACM0 (usb:0483:5740:3058), /dev/ttyACM1 "
        "(usb:1366:0105): name the one in robot.yaml by its usb: name, or run mercator-robot install"
    }


def test_a_line_that_hears_itself(found, devices):
    """With a jumper in the place of the RVR: it is not the UART."""
    devices.joined = {"rvr"}
    _, _, wrong, _ = found()
    assert wrong["rvr"].startswith("no answer; what is sent comes back: the UART works, and its TX and RX are joined;")


@pytest.mark.parametrize(
    ("firmware", "is_fine"), [((8, 3, 432), True), ((10, 0, 1), True), ((8, 10, 0), True), ((8, 3, 431), False)]
)
def test_firmware_is_compared_by_numbers(found, devices, firmware, is_fine):
    devices.instead["get_main_application_version"] = dict(zip(("major", "minor", "revision"), firmware, strict=True))
    _, fine, _, _ = found()
    assert ("firmware nordic" in fine) == is_fine


def test_a_motor_that_does_not_turn(found, devices):
    devices.is_stuck = True
    _, _, wrong, _ = found()
    assert wrong == {"lidar's turns": "0.0 a second; does its motor turn? It needs 5 V and 1 A, and a cable for both"}


def test_rates_are_of_what_lies_between():
    """Not of what is counted in two seconds, which of 6.25 a second is 6 or 6.5; what has ceased is slow."""
    assert rate_of([0.1 + 0.16 * k for k in range(12)], 2.0) == pytest.approx(6.25)
    assert rate_of([0.1, 0.2, 0.3], 2.0) < 2.0
    assert (rate_of([0.1], 2.0), rate_of([], 2.0)) == (0.0, 0.0)


def test_one_that_reads_a_port_too(found):
    ends = os.openpty()
    lidar = os.ttyname(ends[1])
    code = f"import os, sys; os.open({lidar!r}, os.O_RDONLY | os.O_NOCTTY); print(flush=True); sys.stdin.read()"
    with started(sys.executable, "-c", code, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        other.stdout.readline()
        _, _, wrong, _ = found(lidar=lidar)
    for end in ends:
        os.close(end)
    assert "in use by another program (" in wrong["lidar"]
    assert wrong["lidar"].endswith(f", process {other.pid}); end it first")
