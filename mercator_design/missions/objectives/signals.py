"""Objectives of robots that react to a signal: a zone is found, or has a colour."""

from collections.abc import Mapping
from typing import Annotated

import numpy as np

from mercator_design.arrays import Flags
from mercator_design.config.colours import Colour, ColourName, rgb
from mercator_design.config.schema import Length
from mercator_design.missions.arena import Size
from mercator_design.missions.plugins import Zone, Zones, objective
from mercator_design.missions.score_limits import ExperimentSize
from mercator_design.missions.trace import Trace


def _of_search(size: ExperimentSize, **_: object) -> tuple[float, float]:
    return 0.0, float(size.robots * (2 * size.cycles - 1))  # found in the first cycle


@objective(limits=_of_search)
def stop_when_found(
    trace: Trace,
    *,
    zones: Zones,  # zones of which one must be found
    still: Size = 0.005,  # [m] that a robot which stands still goes in a cycle, at most
) -> float:
    """Stop of Gianduja: move until one robot comes to a zone, and then stand still, all of you.

    The score is two for each robot and cycle, minus one for each robot and cycle until a robot is in a zone, minus one
    for each cycle until then in which a robot outside the zones stands still, and minus one for each cycle after it in
    which a robot moves. A robot moves if it goes farther than `still` [m] in a cycle. (The original compares along x
    and y: still is less than 5 mm along both, moving is more along both.)
    """
    found = trace.inside(zones, "always")
    moving = _moving(trace, still)
    ever = found.any(axis=1)
    searching = int(np.argmax(ever)) + 1 if ever.any() else trace.cycles
    idle = np.sum(~moving[:searching] & ~found[:searching])
    restless = np.sum(moving[searching:])
    return float(2 * trace.robots * trace.cycles - searching * trace.robots - idle - restless)


def _of_robots(size: ExperimentSize, **_: object) -> tuple[float, float]:
    return 0.0, float(size.robots * size.cycles)


@objective(limits=_of_robots)
def stop_when_told(
    trace: Trace,
    *,
    signal: Zone,  # the zone whose colour tells the robots
    color: Colour,  # colour that tells them to stand still
    still: Size = 0.005,  # [m] that a robot which stands still goes in a cycle, at most
) -> float:
    """Robots that stand still while the zone `signal` has a colour, and move while it has not, summed over cycles."""
    is_signalled = _is_signalled(trace, signal, color)
    return float(np.sum(_moving(trace, still) != is_signalled[:, None]))


@objective(limits=_of_robots)
def robots_where_told(
    trace: Trace,
    *,
    signal: Zone,  # the zone whose colour tells the robots
    places: Annotated[Mapping[ColourName, Zone], Length(1)],  # the zone that belongs to each colour
) -> float:
    """Robots in that zone which belongs to the colour that the zone `signal` has, summed over cycles."""
    there = [trace.inside((zone,), "always")[_is_signalled(trace, signal, name)] for name, zone in places.items()]
    return float(sum(int(np.sum(each)) for each in there))


def _is_signalled(trace: Trace, signal: str, color: Colour) -> Flags:
    """Whether a zone has a colour, after each cycle (cycles,)."""
    return np.asarray(np.all(trace.zone_colors((signal,))[:, 0] == rgb(color), axis=1), dtype=np.bool_)


def _moving(trace: Trace, still: float) -> Flags:
    """Whether each robot moved farther than `still` in each cycle (cycles, robots)."""
    steps = np.diff(trace.poses[..., :2], axis=0)
    return np.asarray(np.hypot(steps[..., 0], steps[..., 1]) > still, dtype=np.bool_)
