"""From what single sensors measure to the reference model's readings, the same in simulation and on the robot."""

import math
from array import array
from collections.abc import Sequence
from typing import Any, Protocol, cast

from mercator_design.jit import jittable
from mercator_design.modules.reference import Readings, ReferenceModel, first_reading, readings_of

_PROXIMITY, _NEIGHBOURS, _GROUND, _LIGHT = map(first_reading, ("proximity", "neighbours", "ground", "light"))


class Row(Protocol):
    """Numbers that can be counted, indexed and sliced: a tuple or list in plain Python, an array in compiled code."""

    def __len__(self) -> int: ...
    def __getitem__(self, index: Any, /) -> Any: ...  # noqa: ANN401 - numpy says so of its elements


class MutableRow(Row, Protocol):
    """A row that a kernel may write to: a list, or an array."""

    def __setitem__(self, index: int, value: float, /) -> None: ...


def new_row(n: int) -> MutableRow:
    """A row of n zeros; slices of it are views, as those of arrays in compiled code."""
    return cast("MutableRow", memoryview(array("d", bytes(8 * n))))


def ring_order(angles: Sequence[float]) -> list[int]:
    """The numbers of sensors, which look at angles [rad], counter-clockwise from the front.

    A sensor up to a 16th of a turn to the right of the front is the first.
    """
    return sorted(range(len(angles)), key=lambda k: (angles[k] + math.pi / 8.0) % math.tau)


@jittable
def ranges(readings: Readings) -> tuple[float, float, float, float, float, float, float, float]:
    """The readings of the proximity sensors, counter-clockwise from the front, to be indexed in kernels."""
    return (
        readings.ranges_0,
        readings.ranges_1,
        readings.ranges_2,
        readings.ranges_3,
        readings.ranges_4,
        readings.ranges_5,
        readings.ranges_6,
        readings.ranges_7,
    )


@jittable
def lights(readings: Readings) -> tuple[float, float, float, float, float, float, float, float]:
    """The readings of the light sensors, counter-clockwise from the front, to be indexed in kernels."""
    return (
        readings.lights_0,
        readings.lights_1,
        readings.lights_2,
        readings.lights_3,
        readings.lights_4,
        readings.lights_5,
        readings.lights_6,
        readings.lights_7,
    )


@jittable
def grounds(readings: Readings) -> tuple[float, float, float]:
    """The gray levels under the ground sensors, from left to right, to be indexed in kernels."""
    return readings.grounds_0, readings.grounds_1, readings.grounds_2


@jittable
def proximity_weight(model: ReferenceModel, distance: float) -> float:
    """The weight of an obstacle at a distance [m]: 0 beyond the range, growing as it gets nearer."""
    if distance > model.proximity_range:
        return 0.0
    if distance < model.proximity_near:
        return model.proximity_near_weight
    weight = model.proximity_constant + model.proximity_inverse / distance
    weight += distance * (model.proximity_slope + model.proximity_square * distance)
    if model.proximity_exponential != 0.0:
        weight += model.proximity_exponential * math.exp(-distance / model.proximity_decay)
    return max(0.0, weight)


@jittable
def gray_level(red: float, green: float, blue: float) -> float:
    """Brightness of a colour, 0 to 255 (ITU-R BT.601 luma, as in ARGoS)."""
    return 0.299 * red + 0.587 * green + 0.114 * blue


@jittable
def nearest_label(labels: Row, red: float, green: float, blue: float) -> int:
    """Number of the label whose colour is nearest to a measured one, the first of several (Mercator paper, eqs. 1, 2).

    Args:
        labels: (3 * n,) red, green and blue of each label, 0 to 255; n is at least 1.
        red: Of what was measured, 0 to 255; so the others.
        green: See red.
        blue: See red.
    """
    found = 0
    nearest = math.inf
    for k in range(len(labels) // 3):
        off_red = labels[3 * k] - red
        off_green = labels[3 * k + 1] - green
        off_blue = labels[3 * k + 2] - blue
        squared = off_red * off_red + off_green * off_green + off_blue * off_blue
        if squared < nearest:
            found = k
            nearest = squared
    return found


@jittable
def ground_by_vote(model: ReferenceModel, blacks: float, whites: float) -> float:
    """The ground's gray level, given how many of the latest readings were black and how many white."""
    if blacks > model.ground_majority:
        return 0.0
    return 255.0 if whites > model.ground_majority else 127.5


@jittable
def light_direction(model: ReferenceModel, readings: Row, directions_x: Row, directions_y: Row) -> tuple[float, float]:
    """Unit vector towards the light, forwards and to the left; no length where none is perceived.

    Args:
        model: Constants.
        readings: (sensors,) of brightness, 0 to 1.
        directions_x: (sensors,) where each sensor looks: unit vectors, forwards ...
        directions_y: ... and to the left.
    """
    x = 0.0
    y = 0.0
    perceived = False
    for i in range(len(readings)):
        perceived = perceived or readings[i] > model.light_threshold
        x += readings[i] * directions_x[i]
        y += readings[i] * directions_y[i]
    length = math.sqrt(x * x + y * y)
    if not perceived or length == 0.0:
        return 0.0, 0.0
    return x / length, y / length


@jittable
def perceive(
    model: ReferenceModel,
    proximity: Row,
    directions_x: Row,
    directions_y: Row,
    distances: Row,
    bearings_x: Row,
    bearings_y: Row,
    n_neighbours: int,
    neighbours: float,
    ground: Row,
    light: Row,
    row: MutableRow,
) -> Readings:
    """Readings of one robot in one control cycle.

    Args:
        model: Constants.
        proximity: (sensors,) how much the nearest obstacle counts that each sensor sees (`proximity_weight`).
        directions_x: (sensors,) where each proximity sensor looks: unit vectors, forwards ...
        directions_y: ... and to the left.
        distances: (at least n_neighbours,) of each robot that pulls [m].
        bearings_x: (at least n_neighbours,) where each is: unit vectors, forwards ...
        bearings_y: ... and to the left.
        n_neighbours: How many rows that is; one robot may pull more than once.
        neighbours: How many robots count as neighbours.
        ground: (3,) red, green, blue, 0 to 255.
        light: (2,) vector towards the light.
        row: (N_READINGS,) of the readings, where those of all other senses are; these are filled in.
    """
    obstacle_x = 0.0
    obstacle_y = 0.0
    for i in range(len(directions_x)):
        obstacle_x += proximity[i] * directions_x[i]
        obstacle_y += proximity[i] * directions_y[i]
    pull_x = 0.0
    pull_y = 0.0
    for i in range(n_neighbours):
        gap = max(0.0, distances[i] - model.neighbour_gap)
        weight = 1.0 / max(1e-6, model.neighbour_offset + model.neighbour_scale * gap)
        pull_x += weight * bearings_x[i]
        pull_y += weight * bearings_y[i]
        if distances[i] <= model.neighbour_obstacle_range:
            gap = max(0.001, distances[i] - model.neighbour_obstacle_radius)
            weight = proximity_weight(model, gap)
            obstacle_x += weight * bearings_x[i]
            obstacle_y += weight * bearings_y[i]
    length = math.sqrt(obstacle_x * obstacle_x + obstacle_y * obstacle_y)
    if length > 1.0:
        obstacle_x /= length
        obstacle_y /= length
    row[_PROXIMITY] = obstacle_x
    row[_PROXIMITY + 1] = obstacle_y
    row[_NEIGHBOURS] = neighbours
    row[_NEIGHBOURS + 1] = pull_x
    row[_NEIGHBOURS + 2] = pull_y
    for k in range(3):
        row[_GROUND + k] = ground[k]
    for k in range(2):
        row[_LIGHT + k] = light[k]
    return readings_of(row)
