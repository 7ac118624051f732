"""The three serial ports of a robot: their names and how to open them. No other module opens a port."""

import contextlib
import errno
import fcntl
import getpass
import grp
import math
import os
import re
import stat
import termios
import time
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypeAlias, get_args

import serial
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from mercator_design.config.schema import FieldError, Pattern, checked
from mercator_design.errors import RobotError, RobotStopped

PortName = Annotated[
    str, Pattern(r"/[^\0\n]+|usb:[0-9a-f]{4}:[0-9a-f]{4}(:.+)?", "a path or usb:VENDOR:PRODUCT[:SERIAL]")
]
DeviceName: TypeAlias = Literal["rvr", "lidar", "proximity"]
DEVICES: tuple[DeviceName, ...] = get_args(DeviceName)
OPTIONAL_DEVICES: tuple[DeviceName, ...] = ("lidar", "proximity")
"""Devices without which a robot can run a PFSM that does not need them."""
BAUD: Mapping[DeviceName, int] = {"rvr": 115_200, "lidar": 128_000, "proximity": 115_200}
_OF_GROUP = stat.S_IRGRP | stat.S_IWGRP
_NUMBER = re.compile(r"\d+$")
TIMEOUT = 0.1
"""[s] after which reading and writing give up."""
_LOST = (
    "was it unplugged, or did its power fail, as on a supply that motors share? `sudo dmesg` has the kernel's reason"
)
_RETRY = 0.05  # [s] between attempts to open a port


@dataclass(frozen=True, kw_only=True)
class PortNames:
    """The ports of the devices: paths, or USB identifiers as lsusb prints them, with a serial number if necessary."""

    rvr: PortName = "/dev/serial0"  # the Sphero RVR, on the header of the Raspberry Pi
    lidar: PortName = "usb:10c4:ea60"  # the YDLIDAR X4's adapter, a CP2102
    proximity: PortName = "/dev/ttyACM0"  # the Teraranger Hub Multiflex

    def __post_init__(self) -> None:
        checked(self._mistakes())

    def _mistakes(self) -> Iterator[FieldError]:
        devices: dict[str, DeviceName] = {}
        for device in DEVICES:
            name = getattr(self, device)
            if (other := devices.setdefault(name, device)) != device:
                yield FieldError(device, f"{name} is the port of {other} already")


@contextlib.contextmanager
def open_ports(names: PortNames, without: Collection[DeviceName] = ()) -> Iterator[dict[DeviceName, serial.Serial]]:
    """Open the ports of the devices, except those `without`, for this program alone; close them on the way out.

    Raises:
        RobotError: naming the device and the port, what is wrong with it, and what to do.
    """
    with contextlib.ExitStack() as stack:
        devices: dict[str, DeviceName] = {}
        ports: dict[DeviceName, serial.Serial] = {}
        for device in DEVICES:
            if device in without:
                continue
            name = getattr(names, device)
            found = find_port(device, name)
            path = os.path.realpath(found)
            if (other := devices.setdefault(path, device)) != device:
                raise RobotError(f"{name} is {path}, the port of {other} already", device=device)
            ports[device] = stack.enter_context(open_port(device, found))
        yield ports


def find_port(device: DeviceName, name: str) -> str:
    """The path of a port.

    Raises:
        RobotError: if no such USB device is connected, or several are.
    """
    if not name.startswith("usb:"):
        return name
    connected = list_ports.comports()
    found = [port for port in connected if f"{_usb_name(port)}:".startswith(f"{name}:")]
    if len(found) == 1:
        return str(found[0].device)
    if found:
        raise RobotError(
            f"expected one {name}, found {_listed(found)}; name it by serial number or path", device=device
        )
    raise RobotError(f"{name} is not connected; connected are {_listed(connected)}", device=device)


def usb_port(device: DeviceName, name: str) -> ListPortInfo:
    """The USB device at a port.

    Raises:
        RobotError: if there is none, or the port's name may belong to another device after the next start.
    """
    path = find_port(device, name)
    ports = {Path(port.device): port for port in list_ports.comports() if port.vid is not None}
    found = ports.get(Path(path).resolve())
    if found is None:
        wrong = "is not a USB device" if Path(path).exists() else "is not connected"
        raise RobotError(f"{path} {wrong}; connected are {_listed(ports.values())}", device=device)
    if rivals := sharing(name):
        raise RobotError(f"{name} may be any of {rivals}; name the one in robot.yaml by its usb: name", device=device)
    return found


def sharing(name: str) -> str:
    """The USB devices that may get a port's name, depending on their order; empty if only one may."""
    of_usb = [port for port in list_ports.comports() if port.vid is not None]
    rivals = [port for port in of_usb if _NUMBER.sub("", port.device) == _NUMBER.sub("", name)]
    return _listed(rivals) if len(rivals) > 1 else ""


class ExclusivePort(serial.Serial):
    """A port that no other program can open meanwhile, except root's. pyserial's lock is only advisory."""

    def open(self) -> None:
        super().open()
        fcntl.ioctl(self.fileno(), termios.TIOCEXCL)

    def close(self) -> None:
        if self.is_open:
            with contextlib.suppress(OSError):  # a port that is lost
                fcntl.ioctl(self.fileno(), termios.TIOCNXCL)
        super().close()


def open_port(device: DeviceName, name: str, until: float = -math.inf) -> serial.Serial:
    """Open one of the three ports for this program alone; errors are those of `open_ports`.

    `until` is the time of the last attempt [s, of time.monotonic()]; there is always one.
    """
    while True:
        try:
            return _open(device, name)
        except RobotError:
            if time.monotonic() > until:
                raise
        time.sleep(_RETRY)


def _open(device: DeviceName, name: str) -> serial.Serial:
    path = find_port(device, name)
    try:
        port = ExclusivePort(path, BAUD[device], timeout=TIMEOUT, write_timeout=TIMEOUT, exclusive=True)
    except OSError as error:
        try:
            wrong = _wrong(path, error)
        except OSError as gone:  # meanwhile
            wrong = _wrong(path, gone)
        raise RobotError(f"{path}: {wrong}", device=device) from None
    except ValueError as error:  # pyserial's, if the port refuses a baud rate
        words = f"{error}; take its plug out and in: is it the {device}'s adapter?"
        raise RobotError(f"{path}: {words}", device=device) from None
    except termios.error as error:
        raise RobotError(f"{path} is lost: {error.args[-1]}; {_LOST}", device=device) from None
    if users := _users(path):
        port.close()
        raise RobotError(f"{path}: {_in_use(users)}", device=device)
    return port


def _wrong(path: str, error: OSError) -> str:
    """What is wrong with a port that cannot be opened, and what to do."""
    match error.errno:
        case errno.ENOENT | errno.ENXIO | errno.ENODEV:
            return f"no such port; connected are {_listed(list_ports.comports())}"
        case errno.EACCES | errno.EPERM if Path(path).stat().st_mode & _OF_GROUP != _OF_GROUP:  # as login shells do
            return (
                "no permission, and its group has none either; is a login shell on it (`mercator-robot "
                "check` finds it), or is it of another user?"
            )
        case errno.EACCES | errno.EPERM:
            return f"no permission; {_permission(_group(path), user_name() or str(os.getuid()))}"
        case errno.EBUSY | errno.EAGAIN:
            return _in_use(_users(path))
        case errno.EISDIR | None:  # None: it could be opened, but takes no baud rate
            return "not a serial port"
    return str(error)


def _in_use(users: list[str]) -> str:
    by = f" ({'; '.join(users)})" if users else ""
    return f"in use by another program{by}; end it first"


def _permission(group: str, user: str) -> str:
    """The commands that give a user the rights of a group."""
    with contextlib.suppress(KeyError):
        if user in grp.getgrnam(group).gr_mem:
            return f"{user} is in the group {group}, but was not when this shell began: log in again"
    return f"`sudo usermod -aG {group} {user}`, and log in again"


def _group(path: str) -> str:
    """The name of a port's group; its number if it has no name, as in containers."""
    try:
        return Path(path).group()
    except KeyError:
        return str(Path(path).stat().st_gid)


def user_name() -> str | None:
    """The name of this user; None if there is none, as in containers."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # the latter from Python 3.13 on
        return None


def _users(path: str) -> list[str]:
    """Other programs of this user that have a port open."""
    port, users = os.path.realpath(path), []
    for process in filter(str.isdecimal, os.listdir("/proc")):  # noqa: PTH208 - of paths it takes several times as long
        files = f"/proc/{process}/fd"
        with contextlib.suppress(OSError):  # of another user, or just ended
            is_other = process != str(os.getpid())
            if is_other and any(os.readlink(f"{files}/{name}") == port for name in os.listdir(files)):  # noqa: PTH115, PTH208
                users.append(_described(Path("/proc", process)))
    return users


def _described(process: Path) -> str:
    """The name and number of a process, by its folder in /proc; a suspended one must be killed."""
    name, _, rest = (process / "stat").read_text().partition("(")[2].rpartition(")")
    suspended = f", suspended: `kill -KILL {process.name}`" if rest.split()[0] in {"T", "t"} else ""
    return f"{name}, process {process.name}{suspended}"


def _listed(ports: Iterable[ListPortInfo]) -> str:
    return ", ".join(sorted(f"{port.device} ({_usb_name(port) or 'not on the USB'})" for port in ports)) or "none"


def _usb_name(port: ListPortInfo) -> str:
    """The usb: name of a port; empty if it is not on the USB."""
    if port.vid is None:
        return ""
    return f"usb:{port.vid:04x}:{port.pid:04x}" + (f":{port.serial_number}" if port.serial_number else "")


class Line:
    """An open port that carries bytes both ways; errors name the device once the port is lost.

    device: The device at the port.
    port: Name of the port.
    """

    def __init__(self, device: DeviceName, port: serial.Serial) -> None:
        self.device, self.port = device, str(port.name)
        self._port = port

    def fileno(self) -> int:
        """The file descriptor, for select."""
        return int(self._port.fileno())

    def read(self) -> bytes:
        """Read what has come; wait at most `TIMEOUT` for the first byte.

        Raises:
            RobotStopped: if the port is lost.
        """
        with self._naming():
            return bytes(self._port.read(self._port.in_waiting or 1))

    def write(self, data: bytes) -> None:
        """Send bytes; errors are those of `read`."""
        with self._naming():
            self._port.write(data)

    def set_dtr(self, *, high: bool) -> None:
        """Set the line DTR, which turns a lidar's motor on and off."""
        with contextlib.suppress(OSError):  # a pseudo-terminal has no DTR
            self._port.dtr = high

    @contextlib.contextmanager
    def _naming(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise RobotStopped(f"{self.port} is lost: {error}; {_LOST}", device=self.device) from None
