"""From what single sensors measure to the reference model's readings, the same in simulation and on the robot."""

import math
from typing import Any, Protocol

from mercator_design.fsm.reference import Readings, ReferenceModel
from mercator_design.jit import jittable


class Row(Protocol):
    """Numbers that can be counted and indexed: a tuple or list in plain Python, an array in compiled code."""

    def __len__(self) -> int: ...
    def __getitem__(self, index: int, /) -> Any: ...  # noqa: ANN401 - numpy says so of its elements


@jittable
def proximity_weight(model: ReferenceModel, distance: float) -> float:
    """How much an obstacle at a distance [m] counts: 0 beyond the range, growing as it gets nearer."""
    if distance > model.proximity_range:
        return 0.0
    if distance < model.proximity_near:
        return model.proximity_near_weight
    return max(0.0, (1.0 / distance - model.proximity_offset) * model.proximity_scale)


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
    ground: Row,
    light: Row,
) -> Readings:
    """Readings of one robot in one control cycle.

    Args:
        model: Constants.
        proximity: (sensors,) distance to the nearest obstacle [m]; infinity where there is none.
        directions_x: (sensors,) where each proximity sensor looks: unit vectors, forwards ...
        directions_y: ... and to the left.
        distances: (at least n_neighbours,) of each robot in range [m].
        bearings_x: (at least n_neighbours,) where each is: unit vectors, forwards ...
        bearings_y: ... and to the left.
        n_neighbours: How many neighbours there are.
        ground: (3,) red, green, blue, 0 to 255.
        light: (2,) vector towards the light.
    """
    obstacle_x = 0.0
    obstacle_y = 0.0
    for i in range(len(directions_x)):
        weight = proximity_weight(model, proximity[i])
        obstacle_x += weight * directions_x[i]
        obstacle_y += weight * directions_y[i]
    pull_x = 0.0
    pull_y = 0.0
    for i in range(n_neighbours):
        weight = 1.0 / (model.neighbour_offset + model.neighbour_scale * distances[i])
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
    return Readings(
        obstacle_x,
        obstacle_y,
        float(n_neighbours),
        pull_x,
        pull_y,
        ground[0],
        ground[1],
        ground[2],
        light[0],
        light[1],
    )
