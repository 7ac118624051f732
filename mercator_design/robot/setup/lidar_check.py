"""Check the lidar: what it says about itself, its line, its turns, and what it sees."""

import time
from collections.abc import Iterator
from statistics import median_low

from mercator_design.robot.devices.findings import RobotFinding
from mercator_design.robot.devices.link import Link
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.devices.sight import FLICKER_REMEDY, MIN_READINGS, REMEDY, SURE_READINGS, View
from mercator_design.robot.devices.start import LidarIdentity, start_lidar, stop_lidar
from mercator_design.robot.devices.sweep import Sweep, Swept
from mercator_design.robot.protocols.ydlidar import TURN, Packet
from mercator_design.robot.setup.judging import judged, line_finding, rate_of

_USUAL_TURNS = 5.0
"""[1/s] that an X4 makes at least; 12 at most."""
_MARGIN = 1.25  # by which a lidar must turn faster than `limits.lidar` needs
_POWER = "It needs 5 V and 1 A, and a cable for both"


def check_lidar(settings: Settings, link: Link, duration: float) -> Iterator[RobotFinding]:
    """Check the lidar for a duration [s]; what a run does not need is not wrong, but unclear."""
    measured = _Measured(settings)
    try:
        yield from _identity(start_lidar(link))
        link.discard()  # turns from before the start
        measured.take(link, duration)  # the motor starts
        before, begin = link.counts()["lidar"], measured.sweep.swept
        measured.restart()
        measured.take(link, duration)
    finally:
        stop_lidar(link)
    swept = Swept(*(later - earlier for earlier, later in zip(begin, measured.sweep.swept, strict=True)))
    received, lost, _ = (later - earlier for earlier, later in zip(before, link.counts()["lidar"], strict=True))
    is_foreign = swept.all < TURN and lost > received // 2  # a few of its packets may be valid by chance
    remedy = "another model or mode: an X4 sends packets with samples of two bytes" if is_foreign else ""
    yield line_finding("lidar", settings, link, before, swept, remedy)
    if not is_foreign:
        yield _turns(rate_of(measured.times, duration), settings)
    if measured.readings:
        yield _sight(measured.readings, settings.limits.lidar_blind)
        yield from _directions(measured.view)


class _Measured:
    """Measurements of a lidar.

    sweep: Its ranges, which the robot at rest sees.
    times: End of each turn [s].
    readings: Number of readings of each turn.
    view: What it sees.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings, self._nearest = settings, settings.reference_model.lidar_nearest
        self.sweep = Sweep(settings.lidar_angle, settings.lidar.blind, self._nearest)
        self.restart()

    def restart(self) -> None:
        """Forget all turns."""
        self.times: list[float] = []
        self.readings: list[int] = []
        self.view = View(self._settings.lidar.blind, self._nearest)

    def take(self, link: Link, duration: float) -> None:
        """Take in what it sends for some time [s]."""
        for event, now in link.poll(time.monotonic() + duration):
            if isinstance(event, Packet) and self.sweep.add(event, read=now):
                self.times.append(now)
                self.readings.append(self.sweep.readings)
                if self.sweep.readings >= MIN_READINGS:
                    self.view.take(self.sweep.ranges())


def _identity(found: LidarIdentity) -> Iterator[RobotFinding]:
    facts, doubts = found.words(), found.doubts()
    is_unclear = found.info is None or "lidar" in doubts
    words = "; ".join(filter(None, (facts["lidar"], doubts.get("lidar"))))
    yield RobotFinding("lidar", is_fine=True, words=words, is_unclear=is_unclear)
    if found.warning is not None:
        words = f"{facts['lidar_health']}; take its power away for a moment"
        yield RobotFinding("lidar's health", is_fine=False, words=words)
    elif "lidar_health" in doubts:
        words = f"{facts['lidar_health']}; {doubts['lidar_health']}"
        yield RobotFinding("lidar's health", is_fine=True, words=words, is_unclear=True)


def _turns(rate: float, settings: Settings) -> RobotFinding:
    """The finding on the turns of a lidar: slow ones are wrong only if a run would take it for silent."""
    words, least = f"{rate:.1f} a second", _MARGIN / settings.limits.lidar
    if rate == 0.0:
        return judged("lidar's turns", False, words, f"does its motor turn? {_POWER}")
    if rate >= _USUAL_TURNS:
        return RobotFinding("lidar's turns", is_fine=True, words=words)
    slow = f"slow: an X4 makes {_USUAL_TURNS:g} to 12. {_POWER}, and nothing that brakes its belt"
    if rate < least:
        slow += f"; below {least:.1f} a run takes it for silent (limits.lidar)"
    return RobotFinding("lidar's turns", rate >= least, f"{words}; {slow}", is_unclear=True)


def _sight(readings: list[int], limit: float | None) -> RobotFinding:
    """The finding on the numbers of readings in turns; each turn is judged. `limit` is that of a run [s]."""
    usual = median_low([each for each in readings if each >= MIN_READINGS] or [0])
    empty = sum(each < MIN_READINGS for each in readings)
    words = f"{usual} readings in a turn"
    if not usual:
        stops = (
            "" if limit is None else f" A run that reads neighbours would stop after {limit:g} s (limits.lidar_blind)"
        )
        return RobotFinding("lidar's sight", is_fine=True, words=f"{words}; {REMEDY}{stops}", is_unclear=True)
    if not empty:
        return RobotFinding("lidar's sight", is_fine=True, words=words)
    words += f", but none in {empty} of {len(readings)} turns; {FLICKER_REMEDY}"
    return RobotFinding("lidar's sight", usual < SURE_READINGS, words, is_unclear=True)


def _directions(view: View) -> Iterator[RobotFinding]:
    """Findings on parts of the robot that the lidar sees, and on sectors in which it sees nothing."""
    if found := view.own_parts():
        yield judged("lidar's surroundings", False, found.words, found.remedy)
    if found := view.blank_sectors():
        yield RobotFinding("lidar's sectors", is_fine=True, words=f"{found.words}; {found.remedy}", is_unclear=True)
