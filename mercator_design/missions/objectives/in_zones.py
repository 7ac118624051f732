"""Objectives of robots in zones and on colours."""

from collections.abc import Iterator, Mapping
from typing import Annotated

import numpy as np

from mercator_design.arrays import Numbers
from mercator_design.config.colours import Colour, ColourName, rgb
from mercator_design.config.schema import FieldError, Length, Range
from mercator_design.missions.plugins import When, Zone, Zones, objective
from mercator_design.missions.trace import Trace

Value = Annotated[float, Range(-1e6, 1e6)]
ZoneValues = Annotated[Mapping[Zone, Value], Length(1)]
SeveralZones = Annotated[Zones, Length(2)]


@objective(by_zones=True)
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


@objective(by_zones=True)
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


@objective(by_zones=True)
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


@objective(by_zones=True)
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


@objective(by_zones=True)
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


@objective(checks=(_some_value_in_or_outside,), by_zones=True)
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


@objective(checks=(_some_value,))
def color_value(
    trace: Trace,
    *,
    values: Annotated[Mapping[ColourName, Value], Length(1)],  # what a robot on each colour counts
    when: When = "end",  # end: in the last cycle; always: in all cycles, summed
) -> float:
    """The value of the floor's colour under each robot, summed; a colour without value counts 0."""
    colors = trace.colors(when)
    return float(sum(value * np.sum(np.all(colors == rgb(name), axis=-1)) for name, value in values.items()))


@objective
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
