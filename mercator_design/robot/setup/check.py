"""Check a robot before it runs: the computer, then each device by itself. Findings say what to do."""

import math
import time
from collections.abc import Collection, Generator, Iterator, Mapping
from functools import partial
from typing import Any

from mercator_design.robot.devices.findings import DeviceCheck, RobotFinding, check_devices
from mercator_design.robot.devices.health import CRITICAL, LOW, SIDES, percent, warning_share
from mercator_design.robot.devices.link import Link
from mercator_design.robot.devices.ports import DeviceName
from mercator_design.robot.devices.samples import STREAMED
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.devices.start import end_streaming, firmware_name, start_hub, wake_rvr
from mercator_design.robot.protocols.multiflex import Distances
from mercator_design.robot.protocols.rvr import Response
from mercator_design.robot.protocols.rvr_messages import Processor
from mercator_design.robot.protocols.rvr_streaming import streaming
from mercator_design.robot.run.mercator import PERIOD
from mercator_design.robot.setup.computer import check_computer
from mercator_design.robot.setup.judging import judged, line_finding, rate_of
from mercator_design.robot.setup.lidar_check import check_lidar

DURATION = 2.0
"""[s] of the check of a device's data."""
_MIN_DISTANCES = 4.0  # [1/s] of the hub; the manual has 6
_ECHO, _ECHO_EVERY = bytes(range(16)), 0.05  # data that the RVR has to return, and period [s]
_MIN_FIRMWARE = {Processor.NORDIC: (8, 3, 432), Processor.ST: (8, 6, 448)}  # firmware of the control system's manual


def check(settings: Settings, without: Collection[DeviceName] = ()) -> Generator[RobotFinding, None, None]:
    """Check all that a run needs, except devices `without`. Only the lidar moves."""
    yield from check_computer(settings.ports, without)
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
    if doubt := start_hub(link):
        yield RobotFinding("hub's answers", is_fine=True, words=doubt, is_unclear=True)
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
