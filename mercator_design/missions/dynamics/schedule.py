"""Signals: zones take colours at times of the mission file, or at drawn times."""

import itertools
import math
from collections.abc import Iterator
from typing import Annotated

from mercator_design.arrays import Floats
from mercator_design.config.colours import Colour, rgb
from mercator_design.config.schema import FieldError, Length, Positive, Range, checked
from mercator_design.jit import jittable
from mercator_design.missions.floor import FloorTable
from mercator_design.missions.plugins import Site, Zones, dynamic

Time = Annotated[float, Range(0.0, 86_400.0)]

_MAX_CHANGES = 10_000
"""Changes of a dynamic, which its kernel visits in every cycle."""

_EARLY = 1e-6
"""[s] Tolerance for the rounding errors of times."""


@jittable
def repaint(floor: FloorTable, table: Floats, _poses: Floats, time: float) -> None:
    """Rows of the table: when next [s], after how long again [s], row of the zone, red, green, blue.

    They are in the order of their times, from the next one on and round: of changes in one cycle the last one stays.
    """
    first = 0
    for k in range(1, len(table)):
        if table[k, 0] < table[first, 0]:
            first = k
    for j in range(len(table)):
        k = (first + j) % len(table)
        if time > table[k, 0] - _EARLY:
            row = int(table[k, 2])
            for channel in range(3):
                floor.zones[row, 6 + channel] = table[k, 3 + channel]
            table[k, 0] += table[k, 1]


def _mistakes(
    times: tuple[float, ...], colors: tuple[Colour, ...], every: float | None, rows: int
) -> Iterator[FieldError]:
    if len(times) != len(colors):
        yield FieldError("colors", f"expected one for each of {len(times)} times, found {len(colors)}")
    if any(later <= earlier for earlier, later in itertools.pairwise(times)):
        yield FieldError("times", "expected each later than the one before")
    if every is not None and every <= times[-1] - times[0]:
        yield FieldError("every", f"expected more than the {times[-1] - times[0]:g} s from the first time to the last")
    if len(times) * rows > _MAX_CHANGES:
        yield FieldError(
            "times", f"expected at most {_MAX_CHANGES} changes, found {len(times)} of {rows} zones and tiles"
        )


@dynamic(change=repaint)
def schedule(
    site: Site,
    *,
    zones: Zones,  # zones that change
    times: Annotated[tuple[Time, ...], Length(1, 1000)],  # [s] since the start, each later than the one before
    colors: Annotated[tuple[Colour, ...], Length(1, 1000)],  # colours that the zones take, one for each time
    every: Positive | None = None,  # [s] after which all comes again; null: never
) -> list[tuple[float, ...]]:
    """At each of `times` [s] the zones take the corresponding colour; repeated with the period `every` [s]."""
    rows = site.of(zones)
    checked(_mistakes(times, colors, every, len(rows)))
    again = math.inf if every is None else every
    return [(time, again, float(row), *rgb(colour)) for time, colour in zip(times, colors, strict=True) for row in rows]


@dynamic(change=repaint)
def drawn_colors(
    site: Site,
    *,
    zones: Zones,  # zones that change, all to one colour
    colors: Annotated[tuple[Colour, ...], Length(1, 1000)],  # colours of which one is drawn for each instance
    earliest: Time = 0.0,  # [s] since the start, when they may change
    latest: Time = 0.0,  # [s] since the start, when they have changed
) -> list[tuple[float, ...]]:
    """The zones take one colour, drawn for each instance, at a time drawn between `earliest` and `latest` [s]."""
    if latest < earliest:
        raise FieldError("latest", f"expected at least the earliest, {earliest:g} s")
    colour = colors[int(site.rng.integers(len(colors)))]
    time = earliest + (latest - earliest) * float(site.rng.random())
    return [(time, math.inf, float(row), *rgb(colour)) for row in site.of(zones)]
