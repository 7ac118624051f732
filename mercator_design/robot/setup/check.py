"""Check a robot before it runs: the computer, then each device by itself. Findings say what to do."""

import math
import time
from collections.abc import Collection, Generator, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from mercator_design.robot.devices.findings import DeviceCheck, RobotFinding, check_devices
from mercator_design.robot.devices.health import CRITICAL, LOW, SIDES, percent, warning_share
from mercator_design.robot.devices.link import Link
from mercator_design.robot.devices.ports import DeviceName, PortNames, sharing
from mercator_design.robot.devices.samples import STREAMED
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.devices.start import end_streaming, firmware_name, start_hub, wake_rvr
from mercator_design.robot.protocols.multiflex import Distances
from mercator_design.robot.protocols.rvr import Response
from mercator_design.robot.protocols.rvr_messages import Processor
from mercator_design.robot.protocols.rvr_streaming import streaming
from mercator_design.robot.run.mercator import PERIOD
from mercator_design.robot.setup.install import NAMED, RULES
from mercator_design.robot.setup.judging import judged, line_finding, rate_of
from mercator_design.robot.setup.lidar_check import check_lidar

TIMESYNC = Path("/run/systemd/timesync")  # of systemd's NTP client, which Pis have by default
_KERNEL = Path("/proc/cmdline")
PROCESSES = Path("/proc")
_CONFIGS = (Path("/boot/firmware/config.txt"), Path("/boot/config.txt"))  # of a Pi; the first one in newer systems
_HEADER = {"serial0", "ttyS0", "ttyAMA0"}
"""Names of the UART on a Pi's header."""
_RASPI_CONFIG = "sudo raspi-config, Interface, Serial Port: no login shell, but the hardware; restart"
DURATION = 2.0
"""[s] of the check of a device's data."""
_MIN_DISTANCES = 4.0  # [1/s] of the hub; the manual has 6
_ECHO, _ECHO_EVERY = bytes(range(16)), 0.05  # data that the RVR has to return, and period [s]
_MIN_FIRMWARE = {Processor.NORDIC: (8, 3, 432), Processor.ST: (8, 6, 448)}  # firmware of the control system's manual


def check(settings: Settings, without: Collection[DeviceName] = ()) -> Generator[RobotFinding, None, None]:
    """Check all that a run needs, except devices `without`. Only the lidar moves."""
    yield check_clock(time.time())
    kernel = _text(_KERNEL)
    yield check_console(settings.ports.rvr, kernel)
    yield from check_uart(settings.ports.rvr, kernel, next(filter(None, map(_text, _CONFIGS)), ""))
    yield check_programs(settings.ports.rvr)
    yield from check_names(settings.ports, without)
    checks: dict[DeviceName, DeviceCheck] = {
        "rvr": _check_rvr,
        "lidar": partial(check_lidar, duration=DURATION),
        "proximity": _check_hub,
    }
    yield from check_devices(settings, {device: each for device, each in checks.items() if device not in without})
    for device in without:
        yield RobotFinding(
            device, is_fine=True, words="left out, by --without", device=device, quantity="presence", value="left out"
        )


def _text(path: Path) -> str:
    """The text of a file; empty if it cannot be read."""
    try:
        return path.read_text(errors="replace").replace("\0", " ")
    except OSError:
        return ""


def check_clock(now: float) -> RobotFinding:
    """Check that the clock [s since 1970] was set, and not to a time before this program was installed."""
    date = time.strftime("%Y-%m-%d %H:%M", time.localtime(now))
    here = Path(__file__)
    installed = next(path for path in (here, *here.parents) if path.exists())  # this file, or the archive with it
    if now < installed.stat().st_mtime:
        found = "is in the past"
    elif TIMESYNC.exists() and not (TIMESYNC / "synchronized").exists():
        found = "was not set over the network since this computer was switched on"
    else:
        return RobotFinding("clock", is_fine=True, words=date)
    return RobotFinding(
        "clock", is_fine=False, words=f"{date} {found}; a Pi has no clock of its own: connect it to a network"
    )


def check_console(port: str, kernel: str) -> RobotFinding:
    """Check that the system's console is not on the RVR's port, by the kernel's command line."""
    consoles = [word.removeprefix("console=").partition(",")[0] for word in kernel.split() if "console=" in word]
    if _names(port).isdisjoint(consoles):
        return RobotFinding("console", is_fine=True, words=f"not on {port}")
    return RobotFinding("console", is_fine=False, words=f"the system's console is on {port}: {_RASPI_CONFIG}")


def check_uart(port: str, kernel: str, config: str) -> Iterator[RobotFinding]:
    """Check that the UART of a Pi's header is on and keeps its rate, by the kernel's command line and config.txt.

    There is no finding if the RVR is on another port, or the file is missing.
    """
    if not config or _names(port).isdisjoint(_HEADER):
        return
    lines = _for_all(config)
    settings = [line for line in lines if line.startswith("enable_uart=")]
    without_bluetooth = any(
        line.startswith("dtoverlay=") and line.endswith(("disable-bt", "miniuart-bt")) for line in lines
    )
    if "8250.nr_uarts=0" in kernel.split() and "ttyS0" in _names(port):
        yield RobotFinding(
            "uart", is_fine=False, words="8250.nr_uarts=0 hides it; remove that from the kernel's command line"
        )
    elif settings[-1:] == ["enable_uart=1"] or (not settings and without_bluetooth):
        yield RobotFinding("uart", is_fine=True, words="on")
    else:
        words = "enable_uart=1 is not in config.txt: it is off, or its rate changes with the processor's clock"
        yield RobotFinding("uart", is_fine=False, words=f"{words}: {_RASPI_CONFIG}")


def _for_all(config: str) -> list[str]:
    """The lines of a config.txt, without spaces and comments, that apply to every Pi 4."""
    lines, is_for_all = [], True
    for line in ("".join(each.partition("#")[0].split()) for each in config.splitlines()):
        if line.startswith("["):
            is_for_all = line in {"[all]", "[pi4]"}
        elif is_for_all:
            lines.append(line)
    return lines


def check_programs(port: str) -> RobotFinding:
    """Check that no program runs that opens serial ports for modems, Braille displays or terminals."""
    found, rules = set(), _text(RULES)
    for process in PROCESSES.glob("[0-9]*"):
        match _text(process / "comm").strip():
            case "ModemManager" if not all(f"mercator-{device}" in rules for device in NAMED):
                found.add(
                    "ModemManager writes to serial ports: sudo mercator-robot install, or sudo apt remove modemmanager"
                )
            case "brltty":
                found.add("brltty opens adapters such as the lidar's: sudo apt remove brltty")
            case "agetty" if not _names(port).isdisjoint(_text(process / "cmdline").split()):
                found.add(f"a login shell is on {port}: {_RASPI_CONFIG}")
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


def _check_rvr(settings: Settings, link: Link) -> Iterator[RobotFinding]:
    found = wake_rvr(link)
    words = found.words()
    for processor, min_version in _MIN_FIRMWARE.items():
        name, is_fine = firmware_name(processor), found.firmware[processor] >= min_version
        yield judged(name.replace("_", " "), is_fine, words[name], "update it with the app Sphero Edu")
    limits = settings.limits
    is_critical = found.battery < limits.battery_critical or found.battery_state == CRITICAL
    is_low = is_critical or found.battery < limits.battery_low or found.battery_state == LOW
    remedy = f"it is {'critical: no run starts' if is_critical else 'low'}: charge it"
    level = words["battery"]
    yield judged("battery", not is_low, level, remedy, device="rvr", quantity="battery", value=level)
    yield _of_motors(link.ask("get_motor_thermal_protection_status"))
    echoes, asked, before = 0, round(DURATION / _ECHO_EVERY), link.counts()["rvr"]
    try:
        for name, processor, values in streaming(STREAMED, round(1000 * PERIOD)):
            link.ask(name, processor, **values)
        for _ in range(asked):
            link.send_command("echo", data=_ECHO)
            events = [event for event, _ in link.poll(time.monotonic() + _ECHO_EVERY)]
            echoes += sum(isinstance(each, Response) and each.values.get("data") == _ECHO for each in events)
    finally:
        end_streaming(link)
    yield line_finding("rvr", settings, link, before)
    is_fine = echoes >= asked * warning_share(limits.rvr_whole)  # as a run warns; it counts answers to commands
    remedy = f"a run stops below {percent(limits.rvr_whole)}; {link.damage_remedy('rvr')}"
    yield judged("rvr's echoes", is_fine, f"{echoes} of {asked} came back", remedy)


def _of_motors(heat: Mapping[str, Any]) -> RobotFinding:
    temperatures = " and ".join(f"{side} {heat[f'{side}_motor_temperature']:.0f}" for side in SIDES)
    hot = [side for side in SIDES if heat[f"{side}_motor_status"]]
    remedy = f"{' and '.join(hot)} too hot: let it cool, and leave the RVR switched on"
    return judged("motors", not hot, f"{temperatures} degrees", remedy)


def _check_hub(settings: Settings, link: Link) -> Iterator[RobotFinding]:
    start_hub(link)
    link.discard()
    before = link.counts()["proximity"]
    heard = link.poll(time.monotonic() + DURATION)
    found = [(event, now) for event, now in heard if isinstance(event, Distances)]
    yield line_finding("proximity", settings, link, before)
    rate = rate_of([now for _, now in found], DURATION)
    yield judged("hub", rate >= _MIN_DISTANCES, f"{rate:.1f} measurements a second", link.remedy("proximity"))
    if not found:
        return
    last, _ = found[-1]
    distances = settings.corrected(last.metres())
    for i, (angle, distance) in enumerate(zip(settings.proximity_angles, distances, strict=True)):
        is_fine = bool(last.mask >> i & 1)
        seen = "too near" if distance < 0.0 else f"{distance:.2f} m" if math.isfinite(distance) else "nothing in sight"
        words = f"{seen}; hold a hand before it to see whether it is this one" if is_fine else "off; plug it in"
        yield RobotFinding(f"sensor {i}, at {math.degrees(angle):+.0f} degrees", is_fine, words)
