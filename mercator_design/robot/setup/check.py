"""Check a robot before it runs: the computer, then each device by itself. Findings say what to do."""

import contextlib
import math
import time
from collections.abc import Collection, Generator, Iterator, Mapping
from functools import partial
from typing import Any

from mercator_design.errors import RobotError
from mercator_design.robot.devices.findings import DeviceCheck, RobotFinding, check_devices
from mercator_design.robot.devices.health import CRITICAL, LOW, SIDES, percent, warning_share
from mercator_design.robot.devices.link import Event, Heard, Link, error_remedy
from mercator_design.robot.devices.link import words as error_words
from mercator_design.robot.devices.ports import DeviceName
from mercator_design.robot.devices.samples import SERVICE_OF
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.devices.start import (
    DRIVE,
    UNKNOWN,
    commands_end,
    firmware_name,
    secure_rvr,
    start_hub,
    stop_rvr,
    wake_rvr,
    watch_rvr,
)
from mercator_design.robot.devices.streams import start_streams
from mercator_design.robot.protocols.multiflex import Distances
from mercator_design.robot.protocols.rvr import Response
from mercator_design.robot.protocols.rvr_messages import DAMAGED, Processor
from mercator_design.robot.setup.computer import check_computer
from mercator_design.robot.setup.judging import judged, line_finding, rate_of
from mercator_design.robot.setup.lidar_check import check_lidar
from mercator_design.robot.setup.stream_check import StreamCheck

DURATION = 2.0
"""[s] of the check of a device's data."""
_MIN_DISTANCES = 4.0  # [1/s] of the hub; the manual has 6
_SETTLING = 0.5  # [s] for the RVR's sensors and lamp, before their samples count
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
        name, version = firmware_name(processor), found.firmware.get(processor)
        is_fine, remedy = version is None or version >= min_version, "update it with the app Sphero Edu"
        yield judged(name.replace("_", " "), is_fine, words[name], remedy, is_unclear=version is None)
    limits, battery = settings.limits, math.inf if found.battery is None else found.battery
    is_critical = battery < limits.battery_critical or found.battery_state == CRITICAL
    is_low = is_critical or battery < limits.battery_low or found.battery_state == LOW
    remedy = f"it is {'critical: no run starts' if is_critical else 'low'}: charge it"
    level = words["battery"]
    is_unclear = found.battery is None
    yield judged(
        "battery", not is_low, level, remedy, is_unclear=is_unclear, device="rvr", quantity="battery", value=level
    )
    try:
        secure_rvr(link, settings.rvr.timeout)
        yield from _of_commands(settings, link)
        yield _of_reports({**found.refused, **watch_rvr(link)})
        yield _of_motors(link.attempt("get_motor_thermal_protection_status")[0])
        lamp = link.refusal("enable_color_detection", is_enabled=True)
        refused = start_streams(link, [], SERVICE_OF, settings.rvr.period)
        for _ in link.poll(time.monotonic() + _SETTLING):
            pass
        echoes, asked, before = 0, round(DURATION / _ECHO_EVERY), link.counts()["rvr"]
        streams = StreamCheck(settings, refused, time.monotonic())
        for _ in range(asked):
            link.send_command("echo", data=_ECHO)
            for heard in link.poll(time.monotonic() + _ECHO_EVERY):
                streams.take(heard)
                echoes += _answers_echo(heard.event)
        end = time.monotonic()
    finally:
        link.is_ending = True
        with contextlib.suppress(RobotError):  # what is wrong with it has been found
            stop_rvr(link)
    yield from streams.findings(end)
    if lamp:
        why = f"the RVR does not switch it on: {lamp}; a run that reads the ground is refused"
        yield RobotFinding("ground's lamp", is_fine=False, words=why)
    yield line_finding("rvr", settings, link, before)
    is_fine = echoes >= asked * warning_share(limits.rvr_whole)  # as a run warns; it counts answers to commands
    remedy = f"a run stops below {percent(limits.rvr_whole)}; {link.damage_remedy('rvr')}"
    yield judged("rvr's echoes", is_fine, f"{echoes} of {asked} were answered", remedy)


def _answers_echo(event: Event) -> bool:
    """Whether an event answers an echo without damage; firmware may refuse it, and a run needs none."""
    if not isinstance(event, Response) or event.name != "echo":
        return False
    return event.error not in DAMAGED if event.error else event.values.get("data") == _ECHO


def _of_commands(settings: Settings, link: Link) -> Iterator[RobotFinding]:
    """Findings on commands to drive, of speed zero: whether they are obeyed, and end by themselves."""
    refused: list[int] = []

    def attend(until: float) -> list[Heard]:
        heard = [*link.poll(until)]
        answers = [event for event, _ in heard if isinstance(event, Response) and event.name == DRIVE]
        refused.extend(answer.error for answer in answers if answer.error)
        return heard

    is_seen = commands_end(
        link, settings, lambda: link.send_command(DRIVE, left_velocity=0.0, right_velocity=0.0), attend
    )
    timeout = f"{settings.rvr.timeout:g} s"
    if refused:
        words = f"it does not drive: {error_words(refused[0])}; {error_remedy(refused[0])}"
        yield RobotFinding("rvr's drive", is_fine=False, words=words)
    else:
        words = f"commands {'end' if is_seen else 'are not seen to end'} by themselves after {timeout}"
        yield RobotFinding("rvr's drive", is_fine=True, words=words, is_unclear=not is_seen)


def _of_reports(refused: Mapping[str, str]) -> RobotFinding:
    """The finding on what the RVR reports to a run of its battery and motors."""
    found = ", ".join(f"{name.replace('_', ' ')} ({why})" for name, why in refused.items())
    words = f"a run does without what the RVR refuses: {found}" if found else "of battery and motors"
    return RobotFinding("rvr's reports", is_fine=True, words=words, is_unclear=bool(refused))


def _of_motors(heat: Mapping[str, Any]) -> RobotFinding:
    if not heat:
        return RobotFinding("motors", is_fine=True, words=UNKNOWN, is_unclear=True)
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
