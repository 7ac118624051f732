"""Check a robot's computer: its clock, its UART, what else uses ports, and the names of ports."""

import time
from collections.abc import Collection, Iterator
from pathlib import Path

from mercator_design.robot.devices.findings import RobotFinding
from mercator_design.robot.devices.ports import DeviceName, PortNames, sharing
from mercator_design.robot.setup.boot_config import BootSettings, Model, boot_settings, has_bluetooth, models
from mercator_design.robot.setup.install import NAMED, RULES
from mercator_design.robot.setup.text import text_of

TIMESYNC = Path("/run/systemd/timesync")  # of systemd's NTP client, which Pis have by default
KERNEL = Path("/proc/cmdline")
PROCESSES = Path("/proc")
MODEL = Path("/proc/device-tree/model")
CONFIGS = (Path("/boot/firmware/config.txt"), Path("/boot/config.txt"))  # of a Pi; the first one in newer systems
RASPI_CONFIG = Path("/usr/bin/raspi-config")  # of Raspberry Pi OS; Ubuntu has none
_BY_RASPI_CONFIG = "sudo raspi-config, Interface, Serial Port: no login shell, but the hardware; restart"
_HEADER = {"serial0", "ttyS0", "ttyAMA0", "ttyAMA10"}
"""Names of the UART on a Pi's header, and of what is taken for it."""
_DEBUG = "ttyAMA10"  # on the connector for debugging of a Pi 5
_PL011_FREED = {"disable-bt", "miniuart-bt", "pi3-disable-bt", "pi3-miniuart-bt"}
"""Overlays that put the better UART on the header, instead of Bluetooth."""
_ON_PI_5 = {"uart0", "uart0-pi5"}  # overlays


def check_computer(names: PortNames, without: Collection[DeviceName] = ()) -> Iterator[RobotFinding]:
    """Check the computer of a robot, except the names of devices `without`."""
    yield check_clock(time.time())
    kernel = text_of(KERNEL)
    config = next((path for path in CONFIGS if text_of(path)), None)
    yield check_console(names.rvr, kernel, config)
    yield from check_uart(names.rvr, kernel, config, text_of(MODEL))
    yield check_programs(names.rvr, config)
    yield from check_names(names, without)


def check_clock(now: float) -> RobotFinding:
    """Check that the clock [s since 1970] was set, and not to a time before this program was installed.

    A run does not need it, so it is never wrong, but may be unclear.
    """
    date = time.strftime("%Y-%m-%d %H:%M", time.localtime(now))
    here = Path(__file__)
    installed = next(path for path in (here, *here.parents) if path.exists())  # this file, or the archive with it
    if now < installed.stat().st_mtime:
        found = "is in the past"
    elif TIMESYNC.exists() and not (TIMESYNC / "synchronized").exists():
        found = "was not set over the network since this computer was switched on"
    else:
        return RobotFinding("clock", is_fine=True, words=date)
    remedy = (
        "a run does not need it, but the dates of logs may be wrong. If this network blocks NTP, name its own server "
        "(NTP= in /etc/systemd/timesyncd.conf), or set it: sudo date -s 'YYYY-MM-DD HH:MM:SS'"
    )
    return RobotFinding("clock", is_fine=True, words=f"{date} {found}; {remedy}", is_unclear=True)


def check_console(port: str, kernel: str, config: Path | None = None) -> RobotFinding:
    """Check that the system's console is not on the RVR's port, by the kernel's command line."""
    words = [word for word in kernel.split() if word.startswith("console=")]
    own = [each for each in words if each.removeprefix("console=").partition(",")[0] in _names(port)]
    if not own:
        return RobotFinding("console", is_fine=True, words=f"not on {port}")
    remedy = _by_hand(f"remove {' and '.join(own)} from {_beside(config)}; restart")
    return RobotFinding("console", is_fine=False, words=f"the system's console is on {port}: {remedy}")


def check_uart(port: str, kernel: str, config: Path | None, model: str = "") -> Iterator[RobotFinding]:
    """Check that the UART of a Pi's header is on and keeps its rate.

    There is no finding if the RVR is on another port, or config.txt is missing.

    Args:
        port: Port of the RVR.
        kernel: The kernel's command line.
        config: Path of config.txt; None if there is none.
        model: Name of this computer in its device tree; if it is not known, what may be right is not wrong.
    """
    names = _names(port)
    if config is None or names.isdisjoint(_HEADER):
        return
    possible = models(model)
    is_pi_5 = all("pi5" in each for each in possible)
    if _DEBUG in names or (is_pi_5 and names == {"serial0"}):
        words = (
            f"{port} is the connector for debugging of a Pi 5: write `ports: {{rvr: /dev/ttyAMA0}}` into robot.yaml, "
            f"and dtparam=uart0=on into {config}, below [all]; restart"
        )
        yield RobotFinding("uart", is_fine=False, words=words)
        return
    if "8250.nr_uarts=0" in kernel.split() and "ttyS0" in names:
        words = f"8250.nr_uarts=0 hides it; remove that from {_beside(config)}, or from what sets it; restart"
        yield RobotFinding("uart", is_fine=False, words=words)
        return
    found = [
        _wrong(names, boot_settings(config, each, other_filters=others), each, config)
        for each in possible
        for others in (False, True)
    ]
    words = "" if "" in found else found[-1]
    if is_pi_5 and Path(port).exists():
        words = ""
    yield RobotFinding("uart", is_fine=not words, words=words or "on")


def _wrong(names: Collection[str], settings: BootSettings, model: Model, config: Path) -> str:
    """Fault of the UART of a model with these settings; empty if there is none."""
    if "pi5" in model:
        is_set = any(map(settings.has_parameter, ("uart0", "uart0_console"))) or settings.overlays & _ON_PI_5
        is_on = is_set or settings.values.get("enable_uart") == "1"  # without a port, the RVR's check says so
        return "" if is_on else f"it is off: {_by_hand(f'put dtparam=uart0=on into {config}, below [all]; restart')}"
    is_freed = bool(settings.overlays & _PL011_FREED) or not has_bluetooth(model)
    switch = settings.values.get("enable_uart")
    if switch != "1" and not (switch is None and is_freed):
        words = f"enable_uart=1 is not in {config}: it is off, or its rate changes with the processor's clock"
        return f"{words}: {_by_hand('put it there, below [all]; restart')}"
    other = "ttyS0" if is_freed else "ttyAMA0"
    if other in names and "serial0" not in names:
        return f"/dev/{other} is not on the header: name /dev/serial0 in robot.yaml"
    return ""


def check_programs(port: str, config: Path | None = None) -> RobotFinding:
    """Check that no program runs that opens serial ports for modems, Braille displays or terminals."""
    found, rules = set(), text_of(RULES)
    for process in PROCESSES.glob("[0-9]*"):
        match text_of(process / "comm").strip():
            case "ModemManager" if not all(f"mercator-{device}" in rules for device in NAMED):
                found.add(
                    "ModemManager writes to serial ports: sudo mercator-robot install, or sudo apt remove modemmanager"
                )
            case "brltty":
                found.add("brltty opens adapters such as the lidar's: sudo apt remove brltty")
            case "agetty" if own := _names(port).intersection(text_of(process / "cmdline").split()):
                service = f"sudo systemctl disable --now serial-getty@{min(own)}.service"
                by_hand = f"{service}, and remove console={min(own)},... from {_beside(config)}, if it is there"
                found.add(f"a login shell is on {port}: {_by_hand(by_hand)}")
    return RobotFinding("other programs", not found, "; ".join(sorted(found)) or "none that opens ports")


def check_names(names: PortNames, without: Collection[DeviceName] = ()) -> Iterator[RobotFinding]:
    """Check that ports keep their names after the next start, except those of devices `without`."""
    for device in [each for each in NAMED if each not in without]:
        name = getattr(names, device)
        if rivals := sharing(name):
            advice = "name the one in robot.yaml by its usb: name, or run mercator-robot install"
            words = f"{name} may be any of {rivals}: {advice}"
            yield RobotFinding(f"{device}'s name", is_fine=False, words=words)


def _names(port: str) -> set[str]:
    return {Path(port).name, Path(port).resolve().name}


def _by_hand(remedy: str) -> str:
    """Remedy: by raspi-config where it is installed, else by hand."""
    return _BY_RASPI_CONFIG if RASPI_CONFIG.exists() else remedy


def _beside(config: Path | None) -> str:
    """The path of the file with the kernel's command line."""
    return str((config or CONFIGS[0]).with_name("cmdline.txt"))
