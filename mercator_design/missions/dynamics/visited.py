"""Zones that take another colour when a robot visits them: trails, collected items, fields that grow again."""

from mercator_design.arrays import Floats
from mercator_design.config.colours import Colour, rgb
from mercator_design.config.schema import Positive
from mercator_design.jit import jittable
from mercator_design.missions.floor import FloorTable
from mercator_design.missions.floor_kernels import zone_contains
from mercator_design.missions.plugins import Site, Zones, dynamic

_FOR_EVER = 0.0


@jittable
def mark_visited(floor: FloorTable, table: Floats, poses: Floats, time: float) -> None:
    """Rows of the table: row of the zone, its new and its old colour, how long the new one lasts, and until when."""
    for k in range(len(table)):
        row = int(table[k, 0])
        lasts, until = table[k, 7], table[k, 8]
        if lasts == _FOR_EVER and until > 0.0:
            continue
        for i in range(len(poses)):
            if zone_contains(floor, row, poses[i, 0], poses[i, 1]):
                table[k, 8] = time + lasts
                break
        if table[k, 8] > 0.0:
            colour = 1 if lasts == _FOR_EVER or time < table[k, 8] else 4
            for channel in range(3):
                floor.zones[row, 6 + channel] = table[k, colour + channel]
            if colour == 4:
                table[k, 8] = 0.0


@dynamic(change=mark_visited)
def visited(
    site: Site,
    *,
    zones: Zones,  # zones that change, each for itself
    color: Colour,  # colour that a zone takes when a robot comes into it
    lasts: Positive | None = None,  # [s] from when the last robot leaves it; null: for ever
) -> list[tuple[float, ...]]:
    """A zone takes `color` when a robot's centre comes into it: for ever, or for `lasts` s after the last one left."""
    new = rgb(color)
    return [
        (float(row), *new, *site.zones[row, 6:9].tolist(), _FOR_EVER if lasts is None else lasts, 0.0)
        for row in site.of(zones)
    ]
