"""Check what the RVR streams: the samples of each sensor, and what the ground sensor sees."""

import itertools
from collections.abc import Iterator, Mapping
from statistics import fmean

from mercator_design.robot.devices.findings import RobotFinding
from mercator_design.robot.devices.link import Heard
from mercator_design.robot.devices.samples import SERVICE_OF, converted, invalid
from mercator_design.robot.devices.settings import Settings, nearest

_NEEDED = {"attitude": "every run", "ground": "a run that reads the ground"}
"""Sensors without which runs are refused, or stop; the others inform."""
_USUAL = 0.75  # share of the samples that are asked for, below which someone should look
_AT_ENDS = 1.5  # of the longest interval between samples, within which the first and the last one come
_REMEDY = "switch the RVR off and on, update it with the app Sphero Edu, or set a longer rvr.period and limits.rvr"


class StreamCheck:
    """Counts the samples of each sensor of the RVR, from a time [s] to another."""

    def __init__(self, settings: Settings, refused: Mapping[str, str], begin: float) -> None:
        """Begin to count; `refused` says why sensors are not streamed, by name."""
        self._settings, self._refused, self._begin = settings, refused, begin
        self._times: dict[str, list[float]] = {name: [] for name in SERVICE_OF}
        self._invalid = dict.fromkeys(SERVICE_OF, 0)
        self._colours: list[tuple[float, ...]] = []

    def take(self, heard: Heard) -> None:
        """Take in an event."""
        for name in invalid(heard.event):
            self._invalid[name] += 1
        for name, values in converted(heard.event):
            self._times[name].append(heard.time)
            if name == "ground":
                self._colours.append(values)

    def findings(self, end: float) -> Iterator[RobotFinding]:
        """The findings, of each sensor and of the colour of the ground; the count ends at a time [s]."""
        for name in SERVICE_OF:
            words, is_enough, is_usual = self._judge(name, end)
            is_fine = is_enough or name not in _NEEDED
            if not is_fine:
                words += f"; {_NEEDED[name]} is refused or stops: {_REMEDY}"
            yield RobotFinding(f"rvr's {name.replace('_', ' ')}", is_fine, words, is_unclear=not is_usual)
        if self._colours:
            yield self._of_ground()

    def _judge(self, name: str, end: float) -> tuple[str, bool, bool]:
        """Description of a sensor's samples, whether they suffice for a run, and whether they are usual."""
        service, times, period = SERVICE_OF[name], self._times[name], self._settings.rvr.period
        if name in self._refused:
            return f"the RVR does not stream {service}: {self._refused[name]}", False, False
        n_invalid, limit = self._invalid[name], self._settings.limits.rvr
        first, *others = (later - earlier for earlier, later in itertools.pairwise([self._begin, *times, end]))
        gap = max([first, *others])
        found = len(times) / (end - self._begin)
        if len(times) > 1 and max(first, others[-1]) <= _AT_ENDS * max(others[:-1]):  # it came all the time
            found = (len(times) - 1) / (times[-1] - times[0])
        words = f"{found:.1f} samples a second"
        if n_invalid:
            words += f", and {n_invalid} of {n_invalid + len(times)} marked as invalid by the RVR"
        if gap > limit and len(times) > 1:
            words += f", up to {gap:.2f} s apart; the limit is {limit:g} s (limits.rvr)"
        is_usual = gap <= limit and not n_invalid and found >= _USUAL / period
        if gap <= limit and found < _USUAL / period:
            words += f", not {1.0 / period:.1f} (rvr.period)"
        return words, gap <= limit, is_usual

    def _of_ground(self) -> RobotFinding:
        """The finding on the colour of the ground; 0 0 0 may be a black floor, or no light."""
        red, green, blue = (fmean(channel) for channel in zip(*self._colours, strict=True))
        label = nearest(self._settings.labels_of({}), (red, green, blue))
        words = f"{red:.0f} {green:.0f} {blue:.0f}, which is {label}"
        is_dark = not any(map(any, self._colours))
        if is_dark:
            words = (
                "0 0 0 in all samples: is the lamp below on, and the robot on the floor? A run counts it as not seen"
            )
            if self._settings.limits.dark is None:
                words = "0 0 0 in all samples, which is black by limits.dark: null; is the lamp below on?"
        return RobotFinding("ground's colour", is_fine=True, words=words, is_unclear=is_dark)
