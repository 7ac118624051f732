"""What the ground sensor reads on each colour of the floor; only the RVR is used, and it does not move."""

import contextlib
import itertools
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from statistics import NormalDist, fmean, pstdev

from mercator_design.config.colours import COLOURS, RGB, ColourName, Levels
from mercator_design.errors import RobotError
from mercator_design.robot.devices.link import Link
from mercator_design.robot.devices.ports import Line, PortNames, open_port
from mercator_design.robot.devices.samples import converted
from mercator_design.robot.devices.start import stop_rvr, wake_rvr
from mercator_design.robot.protocols.rvr_streaming import StreamData, streaming

_PERIOD = 50  # [ms] of streaming
_MIN_SAMPLES = 10  # samples of a measurement
_AWAKE = 10.0  # [s] between commands, as an RVR that is told nothing falls asleep
_SPREAD = 15.0  # levels, of a robot that stands still on one colour; noise of 5 in each channel is 9
_STRANGE = 60.0  # levels by which a colour is brighter or darker than usual
_DARK = 5.0  # levels without a lamp
_APART = 3.0  # standard deviations from one colour to the middle between two, ...
_MIN_APART = 1.0  # ... below which they cannot be told from each other
_MIN_DEVIATION = 1.0  # levels; more than a few seconds show


class GroundSensor:
    """The RVR's colour sensor, with its lamp on."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._sent = time.monotonic()

    def attend(self) -> None:
        """Read what it sends, and keep it from falling asleep."""
        now = time.monotonic()
        if now - self._sent > _AWAKE:
            self._sent = now
            self._link.send_command("get_battery_percentage")
        self._link.discard()

    def measure(self, seconds: float) -> list[RGB]:
        """What it reads from now on.

        Raises:
            RobotError: if that is nothing, or next to nothing, or the port is lost.
        """
        self.attend()
        found = []
        for event, now in self._link.poll(time.monotonic() + seconds):
            if isinstance(event, StreamData) and event.is_valid:
                for _, sample in converted(event, now):
                    red, green, blue = sample.values
                    found.append((red, green, blue))
        if len(found) < _MIN_SAMPLES:
            raise RobotError(f"ground: {len(found)} measurements in {seconds:g} s; {self._link.remedy('rvr')}")
        return found


@contextlib.contextmanager
def ground_sensor(ports: PortNames) -> Iterator[GroundSensor]:
    """The ground sensor of a robot, which is at rest in the end.

    Raises:
        RobotError: if the RVR cannot be used.
    """
    with open_port("rvr", ports.rvr) as port:
        link = Link([Line("rvr", port)])
        try:
            wake_rvr(link)
            link.ask("enable_color_detection", is_enabled=True)
            for name, processor, values in streaming(["color_detection"], _PERIOD):
                link.ask(name, processor, **values)
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
    """The levels that the sensor reads on colours, one after the other.

    Args:
        sensor: That measures.
        names: Of the colours.
        kept: What others were measured as before.
        seconds: Of each measurement.
        ask: Called with what the user has to do before each.
        report: Called with what was measured, and with what is doubtful.

    Raises:
        RobotError: if the sensor cannot be used, sees nothing, or cannot tell two colours from each other.
    """
    measured: dict[ColourName, list[RGB]] = {}
    for name in names:
        ask(f"Put the robot on {name}")
        measured[name] = found = sensor.measure(seconds)
        levels = " ".join(f"{level:.1f}" for level in mean(found))
        report(f"{name}: {levels}, spread {spread(found):.1f}, of {len(found)} measurements")
        check_light(name, found)
        for warning in warnings(name, found):
            report(f"Warning: {warning}")
    labels: dict[ColourName, Levels] = {name: _rounded(mean(found)) for name, found in measured.items()}
    for warning in confused(measured, {**kept, **labels}, _MIN_APART):
        raise RobotError(f"ground: {warning}")
    for warning in confused(measured, {**kept, **labels}):
        report(f"Warning: {warning}")
    return labels


def mean(found: Sequence[RGB]) -> RGB:
    """Of colours, by channel."""
    red, green, blue = map(fmean, zip(*found, strict=True))
    return red, green, blue


def spread(found: Sequence[RGB]) -> float:
    """The root of the mean square of distances from the mean."""
    middle = mean(found)
    return math.sqrt(fmean(math.dist(colour, middle) ** 2 for colour in found))


def check_light(name: ColourName, found: Sequence[RGB]) -> None:
    """See whether the sensor sees the floor.

    Raises:
        RobotError: if a colour that is not black reads as nothing.
    """
    if fmean(COLOURS[name]) > _DARK > fmean(mean(found)):
        raise RobotError(f"ground: {name} reads as nothing; is the sensor's lamp on, and the robot on the floor?")


def warnings(name: ColourName, found: Sequence[RGB]) -> Iterator[str]:
    """What is odd about the measurements of one colour."""
    if spread(found) > _SPREAD:
        yield f"{name} is not the same all the time; stand still, on one colour, and measure it again"
    brightness, usual = fmean(mean(found)), fmean(COLOURS[name])
    if abs(brightness - usual) > _STRANGE:
        than = "darker" if brightness < usual else "brighter"
        yield f"{name} is {than} than usual: brightness {brightness:.0f}, not {usual:.0f}; is it {name}?"


def confused(
    measured: Mapping[ColourName, Sequence[RGB]], labels: Mapping[ColourName, RGB], least: float = _APART
) -> Iterator[str]:
    """Which two colours are read as each other too often: what was measured, as normal distributions, of labels.

    Those are less than `least` standard deviations from the middle between them.
    """
    for one, other in itertools.combinations(labels, 2):
        far = math.dist(labels[one], labels[other])
        spreads = [_along(measured[name], labels[one], labels[other]) for name in (one, other) if name in measured]
        if not spreads or (apart := 0.5 * far / max(*spreads, _MIN_DEVIATION)) >= least:
            continue
        levels = "1 level" if round(far) == 1 else f"{far:.0f} levels"
        yield (
            f"{one} and {other} are {levels} apart, {apart:.1f} standard deviations from the middle between "
            f"them: one would be read as the other {NormalDist().cdf(-apart):.1%} of the time"
        )


def _along(found: Sequence[RGB], start: RGB, end: RGB) -> float:
    """The standard deviation of colours along the line between two."""
    far = math.dist(start, end) or 1.0
    return pstdev(sum(c * (b - a) for a, b, c in zip(start, end, colour, strict=True)) / far for colour in found)


def _rounded(colour: RGB) -> Levels:
    red, green, blue = map(round, colour)
    return red, green, blue
