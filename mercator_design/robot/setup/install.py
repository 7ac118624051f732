"""The robot's files in the system: names of its ports, services that run and stop it, and its priority.

udev gives the two USB devices fixed names, whatever their order, and keeps ModemManager and brltty away from them.
systemd stops the robot when the Pi starts, and after each run that it has started, however that ended. No robot drives
by itself: a user starts the run, and systemd never restarts it.
"""

import contextlib
import os
import pwd
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from mercator_design.errors import RobotError
from mercator_design.robot.devices.findings import RobotFinding
from mercator_design.robot.devices.ports import DeviceName, usb_port
from mercator_design.robot.devices.settings import Settings
from mercator_design.system.files import Unreadable, read_small, replacing

RULES = Path("/etc/udev/rules.d/99-mercator.rules")
LIMITS = Path("/etc/security/limits.d/99-mercator.conf")
IDLE, RUN = (Path("/etc/systemd/system", f"mercator-{name}.service") for name in ("idle", "robot"))
_OURS = "# Written by `mercator-robot install`, removed by `mercator-robot install --uninstall`.\n"
_READ_UNITS = ["systemctl daemon-reload"]
_READ_RULES = ["udevadm control --reload", "udevadm trigger --subsystem-match=usb --subsystem-match=tty"]
NAMED: tuple[DeviceName, ...] = ("lidar", "proximity")
"""Devices that get a name from udev."""
AFTERWARDS = [*_READ_UNITS, f"systemctl enable {IDLE.name}", *_READ_RULES]
"""Commands that make the system read the files."""

_PLAIN = re.compile(r"[A-Za-z0-9_./:@+-]+")
"""Characters without a special meaning in rules and units."""

_LIMITS = "@dialout - rtprio 2\n"
# The second line of a rule is for the whole USB device: ModemManager reads it there, and brltty starts a service.
_RULE = """
# {device}: {description}
SUBSYSTEM=="tty", {parent}, SYMLINK+="mercator-{device}", GROUP="dialout", MODE="0660", ENV{{ID_MM_PORT_IGNORE}}="1"
SUBSYSTEM=="usb", ENV{{DEVTYPE}}=="usb_device", {itself}, ENV{{ID_MM_DEVICE_IGNORE}}="1", ENV{{SYSTEMD_WANTS}}=""
"""
_SERVICE = """\
User={user}
SupplementaryGroups=dialout
{environment}NoNewPrivileges=yes
CapabilityBoundingSet=
ProtectSystem=strict
ProtectHome=read-only
RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6
"""
_IDLE = """
[Unit]
Description=Mercator robot at rest
{after}
[Service]
Type=oneshot
{service}ExecStart={program} stop

[Install]
WantedBy=multi-user.target
"""
_AFTER_LIDAR = """\
Wants=dev-mercator\\x2dlidar.device
After=dev-mercator\\x2dlidar.device
"""
_RUN = """
[Unit]
Description=Mercator robot that runs {folder}/fsm.txt
After=mercator-idle.service

[Service]
Type=notify
{service}ReadWritePaths={folder}
LimitRTPRIO=2
WorkingDirectory={folder}
ExecStartPre=/bin/mkdir -p logs
ExecStart={program} run fsm.txt --log logs{options}
ExecStopPost={program} stop
SuccessExitStatus=143
WatchdogSec=2
WatchdogSignal=SIGKILL
KillSignal=SIGTERM
TimeoutStartSec=60
TimeoutStopSec=20
Restart=no
"""


@dataclass(frozen=True, kw_only=True)
class Setup:
    """Options of a robot's services."""

    user: str  # that runs them
    folder: Path  # with fsm.txt; logs go to `logs` there
    robot: Path | None  # the robot.yaml; None: the usual settings
    duration: float | None = None  # [s] of the run that the service starts; None: until it is stopped
    seed: int | None = None  # of that run; None: a new one each time


def connected(settings: Settings) -> tuple[dict[str, ListPortInfo], list[RobotFinding]]:
    """The USB ports at which lidar and hub are connected now, and findings on them."""
    ports: dict[str, ListPortInfo] = {}
    findings = []
    for device in NAMED:
        link = f"/dev/mercator-{device}"
        try:
            ports[device] = usb_port(device, getattr(settings.ports, device))
        except RobotError as error:
            words = f"{str(error).removeprefix(f'{device}: ')}; then install again"
            findings.append(RobotFinding(link, is_fine=False, words=words))
        else:
            findings.append(RobotFinding(link, is_fine=True, words=f"for the device at {ports[device].device}"))
    return ports, findings


def texts(ports: Mapping[str, ListPortInfo], setup: Setup, root: Path) -> dict[Path, str]:
    """The texts of the files by path; a device without a port keeps its present rule.

    Raises:
        RobotError: if there is no such user, a path has special characters, or the rules cannot be read.
    """
    try:
        pwd.getpwnam(setup.user)
    except KeyError:
        raise RobotError(f"{setup.user}: no such user; give the robot's user with --user") from None
    rules = _rules(root) | {device: _rule(device, port) for device, port in ports.items()}
    program = " ".join(map(_plain, _program()))
    robot = "" if setup.robot is None else f"Environment=MERCATOR_ROBOT={_plain(setup.robot)}\n"
    after = _AFTER_LIDAR if "lidar" in rules else ""
    given = {"duration": setup.duration, "seed": setup.seed}
    options = "".join(f" --{name} {value}" for name, value in given.items() if value is not None)
    service = _SERVICE.format(user=_plain(setup.user), environment=robot)
    return {
        RULES: _OURS + "".join(rules[device] for device in NAMED if device in rules),
        LIMITS: _OURS + _LIMITS,
        IDLE: _OURS + _IDLE.format(after=after, service=service, program=program),
        RUN: _OURS + _RUN.format(service=service, program=program, folder=_plain(setup.folder), options=options),
    }


def install(files: Mapping[Path, str], root: Path) -> Iterator[RobotFinding]:
    """Write the files below a root, and make the system read them if the root is this system's.

    Raises:
        RobotError: if a file cannot be written, or a foreign one is in its place; then none is written.
    """
    _refuse_foreign(files, root)
    with contextlib.ExitStack() as drafts:
        for place, text in files.items():
            path = _below(root, place)
            with _permitted(path):
                path.parent.mkdir(parents=True, exist_ok=True)
                file = drafts.enter_context(replacing(path))
                file.write(text.encode())
                file.flush()
                os.fchmod(file.fileno(), 0o644)
    for place in files:
        yield RobotFinding(str(_below(root, place)), is_fine=True, words="written")
    yield from _run_all(AFTERWARDS, root)


def uninstall(root: Path) -> Iterator[RobotFinding]:
    """Remove the files of `install`, and no others.

    Raises:
        RobotError: as `install`, or if the service of the run is active.
    """
    there = [place for place in (RULES, LIMITS, IDLE, RUN) if _below(root, place).exists()]
    _refuse_foreign(there, root)
    if RUN in there and root == Path("/") and _is_running():
        raise RobotError(f"{RUN.name} runs; systemctl stop {RUN.name} first")
    for place in there:
        path = _below(root, place)
        if place == IDLE:
            yield from _run_all([f"systemctl disable {IDLE.name}"], root)
        with _permitted(path):
            path.unlink()
        yield RobotFinding(str(path), is_fine=True, words="removed")
    if there:
        yield from _run_all([*_READ_UNITS, *_READ_RULES], root)
    else:
        yield RobotFinding(str(root), is_fine=True, words="nothing is installed")


def _rules(root: Path) -> dict[str, str]:
    """The present rules below a root, by device."""
    path = _below(root, RULES)
    _refuse_foreign([RULES], root)
    with _permitted(path):
        text = path.read_text(errors="replace") if path.exists() else ""
    return {device: rule for rule, device in re.findall(r"(\n# (\w+): (?:.+\n)+)", text)}


def _rule(device: str, port: ListPortInfo) -> str:
    """The rule for a port: by serial number, if no other device has the same one, else by its USB socket."""
    place = _place(port)
    alike = (port.vid, port.pid, port.serial_number)
    places = {_place(other) for other in list_ports.comports() if (other.vid, other.pid, other.serial_number) == alike}
    serial_number = port.serial_number or ""
    keys = [("ATTR", "{idVendor}", f"{port.vid:04x}"), ("ATTR", "{idProduct}", f"{port.pid:04x}")]
    if places == {place} and _PLAIN.fullmatch(serial_number):
        keys.append(("ATTR", "{serial}", serial_number))
    else:
        keys.append(("KERNEL", "", place))
    return _RULE.format(
        device=device,
        description=ascii(port.description),
        parent=", ".join(f'{key}S{of}=="{value}"' for key, of, value in keys),
        itself=", ".join(f'{key}{of}=="{value}"' for key, of, value in keys),
    )


def _place(port: ListPortInfo) -> str:
    """The place of a USB device, such as 1-1.4, without its interface."""
    return (port.location or "").partition(":")[0]


def _program() -> list[str | Path]:
    """The command line of this program, for any working folder."""
    here = Path(__file__)
    archive = next(path for path in here.parents if path.exists())
    if archive.is_file():
        return [sys.executable, archive.resolve()]
    return [sys.executable, "-P", "-m", "mercator_design.robot"]


def _plain(word: str | Path) -> str:
    if not _PLAIN.fullmatch(str(word)):
        raise RobotError(
            f"{word}: expected only letters, digits and _ . / : @ + -, as it is written into systemd's files"
        )
    return str(word)


def _below(root: Path, place: Path) -> Path:
    return root / place.relative_to("/")


def _refuse_foreign(places: Iterable[Path], root: Path) -> None:
    for place in places:
        path = _below(root, place)
        if not Path(os.path.realpath(path)).is_relative_to(root):
            raise RobotError(f"{path}: a link leads out of {root}")
        with _permitted(path):
            is_ours = not path.exists()
            with contextlib.suppress(Unreadable):
                is_ours = is_ours or read_small(path, 2**20).startswith(_OURS.encode())
            if not is_ours:
                raise RobotError(f"{path}: not written by mercator-robot; move it away")


@contextlib.contextmanager
def _permitted(path: Path) -> Iterator[None]:
    try:
        yield
    except PermissionError:
        raise RobotError(f"{path}: no permission; use sudo") from None
    except OSError as error:
        raise RobotError(f"{path}: {error.strerror}") from None


def _is_running() -> bool:
    with contextlib.suppress(OSError, subprocess.TimeoutExpired):
        asked = ["systemctl", "is-active", RUN.name]
        found = subprocess.run(asked, capture_output=True, text=True, errors="replace", check=False, timeout=60.0)  # noqa: S603
        return found.stdout.strip() in {"active", "activating", "deactivating"}
    return False


def _run_all(commands: Iterable[str], root: Path) -> Iterator[RobotFinding]:
    """Run commands of the system, if the root is this system's."""
    for command in commands if root == Path("/") else ():
        try:
            done = subprocess.run(  # noqa: S603
                command.split(), capture_output=True, text=True, errors="replace", check=False, timeout=60.0
            )
            words = done.stderr.strip().rpartition("\n")[2] if done.returncode else "done"
            yield RobotFinding(command, is_fine=done.returncode == 0, words=words)
        except (OSError, subprocess.TimeoutExpired) as error:
            yield RobotFinding(command, is_fine=False, words=f"{error}; run it by hand")
