"""Objectives of robots in zones and on colours."""

from collections.abc import Iterator, Mapping
from typing import Annotated

import numpy as np

from mercator_design.arrays import Numbers
from mercator_design.config.colours import Colour, ColourName, rgb
from mercator_design.config.schema import FieldError, Length, Range
from mercator_design.missions.plugins import When, Zone, Zones, objective
from mercator_design.missions.score_limits import ExperimentSize
from mercator_design.missions.trace import Trace

Value = Annotated[float, Range(-1e6, 1e6)]
ZoneValues = Annotated[Mapping[Zone, Value], Length(1)]
SeveralZones = Annotated[Zones, Length(2)]


def _of_robots(size: ExperimentSize, *, when: When, share: bool, **_: object) -> tuple[float, float]:
    return 0.0, float(size.counted(when) * (1 if share else size.robots))


@objective(by_zones=True, limits=_of_robots)
def robots_in_zone(
    trace: Trace,
    *,
    zones: Zones,  # zones in any of which a robot counts
    when: When = "end",  # end: in the last cycle; always: in all cycles, summed
    share: bool = False,  # whether to divide by the number of robots
) -> float:
    """Robots in any of the zones: at the end, or summed over all cycles; as a share of all robots if asked."""
    robots = float(np.sum(trace.inside(zones, when)))
    return robots / trace.robots if share else robots


@objective(by_zones=True, limits=_of_robots)
def robots_in_fullest_zone(
    trace: Trace,
    *,
    zones: SeveralZones,  # zones of which one has most robots
    when: When = "end",  # end: in the last cycle; always: in all cycles, summed
    share: bool = False,  # whether to divide by the number of robots
) -> float:
    """Robots in that zone which has most of them (in each cycle), counted as in robots_in_zone."""
    robots = float(np.sum(_counts(trace, zones, when).max(axis=0)))
    return robots / trace.robots if share else robots


def _of_emptiest(
    size: ExperimentSize, *, zones: SeveralZones, when: When, share: bool, **_: object
) -> tuple[float, float]:
    robots = size.robots // len(zones) if size.are_apart(zones) else size.robots
    return 0.0, size.counted(when) * robots * (len(zones) / size.robots if share else 1.0)


@objective(by_zones=True, limits=_of_emptiest)
def robots_in_emptiest_zone(
    trace: Trace,
    *,
    zones: SeveralZones,  # zones of which one has fewest robots
    when: When = "end",  # end: in the last cycle; always: in all cycles, summed
    share: bool = False,  # whether to divide by the robots that a zone has if all have as many
) -> float:
    """Robots in that zone which has fewest (in each cycle); the share is 1 if they are divided equally."""
    robots = float(np.sum(_counts(trace, zones, when).min(axis=0)))
    return robots * len(zones) / trace.robots if share else robots


@objective(by_zones=True, limits=_of_robots)
def zone_difference(
    trace: Trace,
    *,
    zones: SeveralZones,  # zones whose numbers of robots are compared
    when: When = "end",  # end: in the last cycle; always: in all cycles, summed
    share: bool = False,  # whether to divide by the number of robots
) -> float:
    """The fullest zone's robots minus the emptiest one's (in each cycle): of two zones, the absolute difference."""
    difference = float(np.sum(np.ptp(_counts(trace, zones, when), axis=0)))
    return difference / trace.robots if share else difference


def _of_evenness(
    size: ExperimentSize, *, zones: SeveralZones, when: When, share: bool, **_: object
) -> tuple[float, float]:
    counting = max(1, size.robots // len(zones)) * len(zones)
    most, best = min(size.robots, counting) if size.are_apart(zones) else counting, min(size.robots, counting)
    return 0.0, size.counted(when) * most / (best if share else 1.0)


@objective(by_zones=True, limits=_of_evenness)
def robots_evenly_in_zones(
    trace: Trace,
    *,
    zones: SeveralZones,  # zones that should have equal numbers of robots
    when: When = "end",  # end: in the last cycle; always: in all cycles, summed
    share: bool = False,  # whether to divide by the best score of a cycle
) -> float:
    """How evenly robots are on the zones: the sum over zones of max(0, q - |robots in it - q|) (in each cycle).

    The quota q is the number of robots divided by that of zones, rounded down, but at least 1: a robot too many in a
    zone costs as much as one that is missing, and a zone never counts below 0. With fewer robots than zones, the score
    is the number of zones that have one robot.
    """
    quota = max(1, trace.robots // len(zones))
    counts = _counts(trace, zones, when)
    score = float(np.sum(np.maximum(0, quota - np.abs(counts - quota))))
    return score / min(trace.robots, quota * len(zones)) if share else score


def _some_value_in_or_outside(values: Mapping[str, float], outside: float) -> Iterator[FieldError]:
    if not (any(values.values()) or outside):
        yield FieldError("values", "expected one that is not 0; else every score is 0")


def _of_zone_values(
    size: ExperimentSize, *, values: Mapping[Zone, float], outside: float, when: When, **_: object
) -> tuple[float, float]:
    robots, each = size.robots * size.counted(when), [*values.values(), outside]
    low, high = min(each), max(each)
    if not size.are_apart(tuple(values)):  # then a robot may have the values of several
        low, high = (of(end, sum(of(0.0, one) for one in values.values())) for of, end in ((min, low), (max, high)))
    return robots * low, robots * high


@objective(checks=(_some_value_in_or_outside,), by_zones=True, limits=_of_zone_values)
def zone_value(
    trace: Trace,
    *,
    values: ZoneValues,  # what a robot in each of these zones counts
    outside: Value = 0.0,  # what a robot in none of them counts
    when: When = "end",  # end: in the last cycle; always: in all cycles, summed
) -> float:
    """The value of the zone that each robot is in, summed; where zones overlap, their values are added."""
    inside = np.array([trace.inside((zone,), when) for zone in values])
    of_zones = sum(value * int(np.sum(one)) for value, one in zip(values.values(), inside, strict=True))
    return float(of_zones + outside * int(np.sum(~inside.any(axis=0))))


def _counts(trace: Trace, zones: Zones, when: When) -> Numbers:
    """Robots in each zone (zones, cycles)."""
    return np.array([trace.inside((zone,), when).sum(axis=1) for zone in zones])


def _some_value(values: Mapping[ColourName, float]) -> Iterator[FieldError]:
    if not any(values.values()):
        yield FieldError("values", "expected one that is not 0; else every score is 0")


def _of_values(
    size: ExperimentSize, *, values: Mapping[ColourName, float], when: When, **_: object
) -> tuple[float, float]:
    robots = size.robots * size.counted(when)
    return robots * min(0.0, *values.values()), robots * max(0.0, *values.values())


@objective(checks=(_some_value,), limits=_of_values)
def color_value(
    trace: Trace,
    *,
    values: Annotated[Mapping[ColourName, Value], Length(1)],  # what a robot on each colour counts
    when: When = "end",  # end: in the last cycle; always: in all cycles, summed
) -> float:
    """The value of the floor's colour under each robot, summed; a colour without value counts 0."""
    colors = trace.colors(when)
    return float(sum(value * np.sum(np.all(colors == rgb(name), axis=-1)) for name, value in values.items()))


def _of_zones(size: ExperimentSize, *, zones: Zones, when: When, **_: object) -> tuple[float, float]:
    return 0.0, float(size.counted(when) * sum(len(size.zone_rows[zone]) for zone in zones))


@objective(limits=_of_zones)
def zones_in_color(
    trace: Trace,
    *,
    zones: Zones,  # zones that are counted
    color: Colour,  # colour that they must have
    when: When = "end",  # end: in the last cycle; always: in all cycles, summed
) -> float:
    """How many of the zones (tiles: each of them) have a colour: at the end, or summed over all cycles."""
    colors = trace.zone_colors(zones)
    return float(np.sum(np.all(colors[0 if when == "always" else -1 :] == rgb(color), axis=-1)))
