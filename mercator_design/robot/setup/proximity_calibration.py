"""Find the angles and the offsets of the hub's sensors. Only the hub is used."""

import contextlib
import math
import time
from collections.abc import Callable, Iterator, Sequence
from statistics import fmean, median_low
from typing import NamedTuple, TypeVar

from mercator_design.errors import RobotError
from mercator_design.robot.devices.link import Link
from mercator_design.robot.devices.ports import Line, PortNames, open_port
from mercator_design.robot.devices.start import start_hub
from mercator_design.robot.protocols.multiflex import Distances

_MIN_SAMPLES = 4  # of each sensor
_TRIES = 3
_MIN_FALL = 0.15  # [m] by which a sensor's distance falls if it sees the object
_CLEAR = 0.75  # [m] without anything around the robot
_MAX_OFFSET = 0.1  # [m] of a sensor; with more the object is elsewhere

_SIDES = ("in front", "front left", "left", "rear left", "behind", "rear right", "right", "front right")

T = TypeVar("T")


class ProximityFit(NamedTuple):
    """Angles of the sensors [rad], in the hub's order; their offsets [m], what each reads too much, if measured."""

    angles: tuple[float, ...]
    offsets: tuple[float, ...] | None


class _Unclear(Exception):  # noqa: N818 - it leads to another attempt
    """A measurement is not clear and has to be repeated."""


def measured(hub: Link, seconds: float) -> list[list[float]]:
    """The distances [m] of each sensor in the next seconds, as `Distances.metres`.

    Raises:
        RobotError: if there are too few, a sensor is off, or the port is lost.
    """
    hub.discard()
    found = [event for event, _ in hub.poll(time.monotonic() + seconds) if isinstance(event, Distances)]
    if len(found) < _MIN_SAMPLES:
        raise RobotError(f"proximity: {len(found)} measurements in {seconds:g} s; {hub.remedy('proximity')}")
    by_sensor = [list(metres) for metres in zip(*(each.metres() for each in found), strict=True)]
    if off := [k for k, metres in enumerate(by_sensor) if any(map(math.isnan, metres))]:
        raise RobotError(f"proximity: the hub reports as not plugged in: {_sensors(off)}")
    return by_sensor


@contextlib.contextmanager
def hub(ports: PortNames) -> Iterator[Link]:
    """The link to the hub of a robot, with all sensors on.

    Raises:
        RobotError: if it cannot be used.
    """
    with open_port("proximity", ports.proximity) as port:
        link = Link([Line("proximity", port)])
        start_hub(link)
        yield link


def calibrate(
    hub: Link,
    angles: Sequence[float],
    distance: float | None,
    seconds: float,
    ask: Callable[[str], None],
    report: Callable[[str], None],
) -> ProximityFit:
    """Find each sensor by an object that the user holds before it.

    Args:
        hub: The link to the hub.
        angles: Angles of the sensors [rad], in any order.
        distance: Distance of the object from the sensor [m]; None: about 0.3 m, and offsets are not measured.
        seconds: Duration of each measurement.
        ask: Called with what the user has to do.
        report: Called with results, and with reasons for another attempt.

    Raises:
        RobotError: if a measurement is not clear after `_TRIES` attempts.
    """

    def asked(what: str, judge: Callable[[list[list[float]]], T]) -> T:
        tries = 0
        while True:
            ask(what)
            tries += 1
            try:
                return judge(measured(hub, seconds))
            except _Unclear as unclear:
                if tries == _TRIES:
                    raise RobotError(f"proximity: after {_TRIES} attempts: {unclear}") from None
                report(f"Once more: {unclear}")

    clear = asked(f"Leave nothing within {_CLEAR:g} m around the robot", _clear)
    far = "about 0.3 m" if distance is None else f"{distance:g} m"
    places: dict[int, float] = {}
    errors: dict[int, float] = {}

    def judge(metres: list[list[float]]) -> tuple[int, float]:
        sensor = _seeing(metres, clear, places)
        return sensor, 0.0 if distance is None else _error(sensor, metres[sensor], distance)

    for angle in sorted(angles, key=lambda angle: angle % math.tau):
        where = direction(angle)
        sensor, error = asked(f"Hold something flat {where}, {far} from the sensor", judge)
        places[sensor], errors[sensor] = angle, error
        report(f"sensor {sensor} looks {where}" + ("" if distance is None else f", and reads {error:+.3f} m too much"))
    order = range(len(angles))
    return ProximityFit(
        tuple(places[k] for k in order), None if distance is None else tuple(round(errors[k], 3) for k in order)
    )


def direction(angle: float) -> str:
    """The direction of an angle [rad] in words."""
    degrees = 180 - round(180.0 - math.degrees(angle)) % 360
    return f"{_SIDES[round(degrees / 45.0) % 8]} ({degrees:+d} degrees)"


def _clear(metres: list[list[float]]) -> list[float]:
    """The distances without an object."""
    found = [median_low(each) for each in metres]
    if near := [k for k, each in enumerate(found) if each < _CLEAR]:
        raise _Unclear(f"something is nearer than {_CLEAR:g} m before {_sensors(near)}")
    return found


def _seeing(metres: list[list[float]], clear: list[float], places: dict[int, float]) -> int:
    """The one sensor that sees the object."""
    seeing = [k for k, each in enumerate(metres) if median_low(each) < clear[k] - _MIN_FALL]
    if not seeing:
        missing = [k for k in range(len(metres)) if k not in places]
        raise _Unclear(f"no sensor sees it; not found yet, perhaps dead: {_sensors(missing)}")
    if len(seeing) > 1:
        raise _Unclear(f"{_sensors(seeing)} see it; hold something smaller, and stand aside")
    if seeing[0] in places:
        raise _Unclear(f"sensor {seeing[0]} sees it, but was found {direction(places[seeing[0]])}")
    return seeing[0]


def _error(sensor: int, metres: list[float], distance: float) -> float:
    """The offset of a sensor [m]."""
    seen = [each for each in metres if math.isfinite(each)]
    if 2 * len(seen) < len(metres):
        raise _Unclear(f"sensor {sensor} does not see it all the time, or it is too near")
    error = fmean(seen) - distance
    if abs(error) > _MAX_OFFSET:
        raise _Unclear(f"sensor {sensor} sees it at {fmean(seen):.2f} m, not {distance:g} m")
    return error


def _sensors(numbers: Sequence[int]) -> str:
    return f"sensor{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}"
