"""Opening a robot's ports, on pseudo-terminals, and what is said when one cannot be used."""

import contextlib
import dataclasses
import errno
import fcntl
import grp
import os
import pwd
import subprocess
import sys
import termios
from pathlib import Path

import pytest
import serial
from serial import serialposix
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from mercator_design.errors import RobotError
from mercator_design.robot.devices import ports
from mercator_design.robot.devices.ports import BAUD, DEVICES, PortNames, find_port, open_port, open_ports


@pytest.fixture
def terminals():
    """Three pseudo-terminals: ends of the devices, and names of the ports."""
    pairs = [os.openpty() for _ in range(3)]
    paths = dict(zip(("rvr", "lidar", "proximity"), (os.ttyname(port) for _, port in pairs), strict=True))
    yield [device for device, _ in pairs], PortNames(**paths)
    for ends in pairs:
        for end in ends:
            with contextlib.suppress(OSError):
                os.close(end)


@pytest.fixture
def connected(monkeypatch):
    """A list of what is connected, to be filled."""
    ports = []
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    return ports


def usb(path, vid=0x10C4, pid=0xEA60, serial_number=None):
    port = ListPortInfo(path)
    port.vid, port.pid, port.serial_number = vid, pid, serial_number
    return port


def test_bytes_go_both_ways_and_ports_are_closed(terminals):
    devices, names = terminals
    with open_ports(names) as ports:
        for device, port in zip(devices, ports.values(), strict=True):
            port.write(b"\xa5\x60")
            assert os.read(device, 10) == b"\xa5\x60"
            os.write(device, b"\xa5\x5a\0\n\r\x03")  # nothing is taken for a key
            assert port.read(6) == b"\xa5\x5a\0\n\r\x03"
        assert [port.baudrate for port in ports.values()] == [115200, 128000, 115200]
    assert not any(port.is_open for port in ports.values())


def test_a_second_program_gets_none_and_hears_who_has_it(terminals):
    _, names = terminals
    code = f"""
import serial, sys
port = serial.Serial({names.lidar!r}, exclusive=True)
print("open", flush=True)
sys.stdin.read()
"""
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout.readline() == b"open\n"
        expected = rf"^lidar: {names.lidar}: in use by another program \(.*, process {other.pid}\); end it first$"
        with pytest.raises(RobotError, match=expected), open_ports(names):
            pass
        other.stdin.close()
        other.wait()
    with open_ports(names), pytest.raises(serial.SerialException):
        serial.Serial(names.rvr, exclusive=True)


@contextlib.contextmanager
def holding(path):
    """Another program that has a port open, and asks for no lock."""
    code = f"import os; os.open({path!r}, os.O_RDWR | os.O_NOCTTY); print(flush=True); input()"
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        other.stdout.readline()
        yield other
        other.stdin.close()


def test_a_program_that_asks_for_no_lock_is_found(terminals):
    """It would have a part of the bytes."""
    _, names = terminals
    with holding(names.proximity) as other:
        expected = (
            rf"^proximity: {names.proximity}: in use by another program \(.*, process {other.pid}\); end it first$"
        )
        with pytest.raises(RobotError, match=expected), open_ports(names):
            pass


OPENED_BY_NOBODY = """
import contextlib, os, sys
with contextlib.suppress(PermissionError):
    os.setuid(65534)
os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
"""


def test_nobody_but_root_opens_a_port_that_is_open(terminals):
    _, names = terminals
    Path(names.rvr).chmod(0o666)
    command = [sys.executable, "-c", OPENED_BY_NOBODY, names.rvr]
    with open_ports(names):
        refused = subprocess.run(command, capture_output=True, check=False)
    assert b"Device or resource busy" in refused.stderr
    subprocess.run(command, check=True)


def test_what_was_opened_before_one_that_fails_is_closed(terminals, connected):
    _, names = terminals
    missing = PortNames(rvr=names.rvr, lidar=names.lidar, proximity="/dev/no_such_port")
    with (
        pytest.raises(RobotError, match=r"^proximity: /dev/no_such_port: no such port; connected are none$"),
        open_ports(missing),
    ):
        pass
    with open_ports(names):
        pass


@pytest.mark.parametrize("path", ["/dev/null", "/", __file__])
def test_what_is_no_serial_port(terminals, path):
    _, names = terminals
    wrong = PortNames(rvr=path, lidar=names.lidar, proximity=names.proximity)
    with pytest.raises(RobotError, match=rf"^rvr: {path}: not a serial port$"), open_ports(wrong):
        pass


@pytest.mark.parametrize(
    ("number", "mode", "words"),
    [
        (errno.EACCES, 0o660, r"no permission; `sudo usermod -aG \w+ \w+`, and log in again"),
        *(
            (errno.EACCES, mode, r"no permission, and its group has none either; .*\?")
            for mode in (0o600, 0o620, 0o640)
        ),
        (errno.EBUSY, 0o660, r"in use by another program.*; end it first"),
        (errno.EIO, 0o660, r".*could not open.*"),
    ],
)
def test_what_the_system_refuses(terminals, monkeypatch, number, mode, words):
    """A login shell leaves its port 0620: no group gives the right to use it."""
    _, names = terminals
    Path(names.rvr).chmod(mode)

    def refuse(*_, **__):
        raise serial.SerialException(number, "could not open")

    monkeypatch.setattr(serial.Serial, "open", refuse)
    with pytest.raises(RobotError, match=rf"^rvr: {names.rvr}: {words}$"), open_ports(names):
        pass


def test_a_group_in_which_a_user_is_but_the_shell_is_not(monkeypatch):
    monkeypatch.setattr(grp, "getgrnam", lambda _: grp.struct_group(("dialout", "x", 20, ["pi"])))
    assert ports._permission("dialout", "pi").endswith("was not when this shell began: log in again")
    assert ports._permission("dialout", "me") == "`sudo usermod -aG dialout me`, and log in again"


def test_users_and_groups_without_names_have_numbers(terminals, monkeypatch):
    """As in containers."""
    _, names = terminals
    Path(names.rvr).chmod(0o660)

    def refuse(*_, **__):
        raise serial.SerialException(errno.EACCES, "could not open")

    def unknown(_):
        raise KeyError

    for name in ("LOGNAME", "USER", "LNAME", "USERNAME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(pwd, "getpwuid", unknown)
    monkeypatch.setattr(grp, "getgrgid", unknown)
    monkeypatch.setattr(serial.Serial, "open", refuse)
    words = f"`sudo usermod -aG {Path(names.rvr).stat().st_gid} {os.getuid()}`"
    with pytest.raises(RobotError, match=rf"^rvr: {names.rvr}: no permission; {words}"), open_ports(names):
        pass


def test_two_paths_to_one_port(terminals, tmp_path):
    _, names = terminals
    link = tmp_path / "proximity"
    link.symlink_to(names.rvr)
    both = dataclasses.replace(names, proximity=str(link))
    expected = f"^proximity: {link} is {names.rvr}, the port of rvr already$"
    with pytest.raises(RobotError, match=expected), open_ports(both):
        pass


class TestPortsByWhatTheyAre:
    def test_the_one_that_is_connected(self, connected):
        connected += [
            usb("/dev/ttyACM0", 0x0483, 0x5740),
            usb("/dev/ttyUSB3", serial_number="0001"),
            ListPortInfo("/dev/ttyS0"),
        ]
        assert find_port("lidar", "usb:10c4:ea60") == "/dev/ttyUSB3"
        assert find_port("lidar", "usb:10c4:ea60:0001") == "/dev/ttyUSB3"
        assert find_port("rvr", "/dev/serial0") == "/dev/serial0"

    def test_none_or_another(self, connected):
        connected += [usb("/dev/ttyUSB0", serial_number="00012"), ListPortInfo("/dev/ttyS0")]
        with pytest.raises(
            RobotError,
            match=r"^lidar: usb:10c4:ea60:0001 is not connected; connected are /dev/ttyS0 \(not on the USB\), "
            r"/dev/ttyUSB0 \(usb:10c4:ea60:00012\)$",
        ):
            find_port("lidar", "usb:10c4:ea60:0001")

    def test_two(self, connected):
        connected += [usb("/dev/ttyUSB0", serial_number="7"), usb("/dev/ttyUSB1", serial_number="8")]
        with pytest.raises(
            RobotError,
            match=r"^lidar: expected one usb:10c4:ea60, found /dev/ttyUSB0 \(usb:10c4:ea60:7\), /dev/ttyUSB1 "
            r"\(usb:10c4:ea60:8\); name it by serial number or path$",
        ):
            find_port("lidar", "usb:10c4:ea60")
        assert find_port("lidar", "usb:10c4:ea60:8") == "/dev/ttyUSB1"


def test_a_port_that_is_lost_while_it_is_opened(terminals, monkeypatch):
    def lost(*_):
        raise termios.error(errno.EIO, "Input/output error")

    _, names = terminals
    monkeypatch.setattr(termios, "tcflush", lost)
    with pytest.raises(RobotError, match=r"^rvr: /dev/pts/\d+ is lost: Input/output error; was it"), open_ports(names):
        pass


def test_a_port_that_takes_no_baud_rate(terminals, monkeypatch):
    """As of an adapter that is pulled out meanwhile."""

    control, _, names = fcntl.ioctl, *terminals

    def fail(file, request, *rest):
        if request == serialposix.TCGETS2:
            raise OSError(errno.EIO, "Input/output error")
        return control(file, request, *rest)

    monkeypatch.setattr(fcntl, "ioctl", fail)
    words = r"^lidar: /dev/pts/\d+: Failed to set custom baud rate .*; take its plug out and in"
    with pytest.raises(RobotError, match=words):
        open_port("lidar", names.lidar)


def test_a_port_that_goes_while_it_is_refused(connected, monkeypatch):
    def refuse(*_, **__):
        raise serial.SerialException(errno.EACCES, "could not open")

    monkeypatch.setattr(serial.Serial, "open", refuse)
    with pytest.raises(RobotError, match=r"^lidar: /dev/no_such_port: no such port; connected are none$"):
        open_port("lidar", "/dev/no_such_port")


def test_each_device_has_a_port():
    assert DEVICES == tuple(BAUD) == tuple(field.name for field in dataclasses.fields(PortNames))
