"""Measure what the ground sensor reads on each colour of the floor. Only the RVR is used; it does not move."""

import contextlib
import itertools
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from statistics import NormalDist, fmean, pstdev

from mercator_design.config.colours import COLOURS, RGB, ColourName, Levels
from mercator_design.errors import RobotError
from mercator_design.robot.devices.link import Link
from mercator_design.robot.devices.ports import Line, open_port
from mercator_design.robot.devices.samples import converted, invalid
from mercator_design.robot.devices.settings import Settings
from mercator_design.robot.devices.start import stop_rvr, wake_rvr
from mercator_design.robot.devices.streams import start_streams

_MIN_SAMPLES = 10  # of a measurement
KEEP_AWAKE_EVERY = 10.0  # [s] between commands; an RVR without commands falls asleep
_MAX_SPREAD = 15.0  # levels, of a robot at rest on one colour; noise of 5 in each channel is 9
_MAX_DEVIATION = 60.0  # levels between the brightness of a colour and the usual one
_DARK = 5.0  # levels without the lamp
_MIN_APART = 1.0  # standard deviations from a colour to the middle between two; fewer are an error,
_CLEARLY_APART = 3.0  # fewer than these a warning
_MIN_DEVIATION = 1.0  # levels, the smallest standard deviation; a few seconds may show less


class GroundSensor:
    """The RVR's colour sensor, with its lamp on."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._sent = time.monotonic()

    def attend(self) -> None:
        """Read the RVR's events, and keep it awake."""
        now = time.monotonic()
        if now - self._sent > KEEP_AWAKE_EVERY:
            self._sent = now
            self._link.send_command("get_battery_percentage")
        self._link.discard()

    def measure(self, seconds: float) -> list[RGB]:
        """The colours that it reads in the next seconds.

        Raises:
            RobotError: if there are too few, or the port is lost.
        """
        self.attend()
        found, n_invalid = [], 0
        for event, _ in self._link.poll(time.monotonic() + seconds):
            n_invalid += len(invalid(event))
            for _, (red, green, blue) in converted(event):
                found.append((red, green, blue))
        if len(found) < _MIN_SAMPLES:
            words = f"{len(found)} measurements in {seconds:g} s"
            if n_invalid:
                words += f", and {n_invalid} that the RVR marks as invalid"
            is_heard = not self._link.refusal("echo", data=b"")
            raise RobotError(f"ground: {words}; {self._link.stream_remedy() if is_heard else self._link.remedy('rvr')}")
        return found


@contextlib.contextmanager
def ground_sensor(settings: Settings) -> Iterator[GroundSensor]:
    """The ground sensor of a robot; in the end the RVR is at rest.

    Raises:
        RobotError: if the RVR cannot be used.
    """
    with open_port("rvr", settings.ports.rvr) as port:
        link = Link([Line("rvr", port)])
        try:
            wake_rvr(link)
            link.ask("enable_color_detection", is_enabled=True)
            start_streams(link, ["ground"], [], settings.rvr.period)
            yield GroundSensor(link)
        finally:
            link.is_ending = True
            with contextlib.suppress(RobotError):
                stop_rvr(link)


def calibrate(
    sensor: GroundSensor,
    names: Iterable[ColourName],
    kept: Mapping[ColourName, RGB],
    seconds: float,
    ask: Callable[[str], None],
    report: Callable[[str], None],
) -> dict[ColourName, Levels]:
    """Measure the levels of colours, one after the other.

    Args:
        sensor: The sensor.
        names: The colours.
        kept: Levels of other colours that were measured before.
        seconds: Duration of each measurement.
        ask: Called with what the user has to do before each measurement.
        report: Called with results and warnings.

    Raises:
        RobotError: if the sensor cannot be used, sees nothing, or cannot distinguish two colours.
    """
    measured: dict[ColourName, list[RGB]] = {}
    labels: dict[ColourName, Levels] = {}
    for name in names:
        ask(f"Put the robot on {name}")
        measured[name] = found = sensor.measure(seconds)
        levels = " ".join(f"{level:.1f}" for level in mean(found))
        report(f"{name}: {levels}, spread {spread(found):.1f}, of {len(found)} measurements")
        check_light(name, found)
        for warning in warnings(name, found):
            report(f"Warning: {warning}")
        red, green, blue = map(round, mean(found))
        labels[name] = red, green, blue
    for warning in confused(measured, {**kept, **labels}, _MIN_APART):
        raise RobotError(f"ground: {warning}")
    for warning in confused(measured, {**kept, **labels}):
        report(f"Warning: {warning}")
    return labels


def mean(found: Sequence[RGB]) -> RGB:
    """The mean of colours, by channel."""
    red, green, blue = map(fmean, zip(*found, strict=True))
    return red, green, blue


def spread(found: Sequence[RGB]) -> float:
    """The root mean square of the distances of colours from their mean."""
    middle = mean(found)
    return math.sqrt(fmean(math.dist(colour, middle) ** 2 for colour in found))


def check_light(name: ColourName, found: Sequence[RGB]) -> None:
    """Raise a RobotError if a colour that is not black reads as nothing."""
    if fmean(COLOURS[name]) > _DARK > fmean(mean(found)):
        raise RobotError(f"ground: {name} reads as nothing; is the sensor's lamp on, and the robot on the floor?")


def warnings(name: ColourName, found: Sequence[RGB]) -> Iterator[str]:
    """Warnings on the measurements of one colour."""
    if not any(map(any, found)):
        yield f"{name} is 0, 0, 0 in all measurements; is the sensor's lamp on, and the robot on the floor?"
    if spread(found) > _MAX_SPREAD:
        yield f"{name} varies; keep the robot still, on one colour, and measure again"
    brightness, usual = fmean(mean(found)), fmean(COLOURS[name])
    if abs(brightness - usual) > _MAX_DEVIATION:
        than = "darker" if brightness < usual else "brighter"
        yield f"{name} is {than} than usual: brightness {brightness:.0f}, not {usual:.0f}; is it {name}?"


def confused(
    measured: Mapping[ColourName, Sequence[RGB]], labels: Mapping[ColourName, RGB], min_apart: float = _CLEARLY_APART
) -> Iterator[str]:
    """Warnings on pairs of labels that are often confused, with normal distributions of the measurements.

    Their labels are less than `min_apart` standard deviations from the middle between them.
    """
    for one, other in itertools.combinations(labels, 2):
        far = math.dist(labels[one], labels[other])
        spreads = [_along(measured[name], labels[one], labels[other]) for name in (one, other) if name in measured]
        if not spreads or (apart := 0.5 * far / max(*spreads, _MIN_DEVIATION)) >= min_apart:
            continue
        levels = "1 level" if round(far) == 1 else f"{far:.0f} levels"
        yield (
            f"{one} and {other} are {levels} apart, {apart:.1f} standard deviations from the middle between "
            f"them: one would be read as the other {NormalDist().cdf(-apart):.1%} of the time"
        )


def _along(found: Sequence[RGB], start: RGB, end: RGB) -> float:
    """The standard deviation of colours along the line between two colours."""
    far = math.dist(start, end) or 1.0
    return pstdev(sum(c * (b - a) for a, b, c in zip(start, end, colour, strict=True)) / far for colour in found)
