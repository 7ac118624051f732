"""Neighbours as clusters of lidar readings, the same in simulation and on the robot.

The lidar heads of robots are all that stands at the height of a lidar within the arena, so readings in a robot's range
that follow each other closely belong to one robot (the Mercator paper, section 4.4). Here a cluster may go on over the
end of a turn, which the original did not allow.
"""

import math

from mercator_design.jit import jittable
from mercator_design.modules.perception import MutableRow, Row
from mercator_design.modules.reference import ReferenceModel


def lidar_neighbours(
    model: ReferenceModel,
    ranges: Row,
    first_angle: float,
    angle_step: float,
    distances: MutableRow,
    bearings_x: MutableRow,
    bearings_y: MutableRow,
) -> int:
    """Find robots in a turn of lidar readings.

    Args:
        model: Constants.
        ranges: (readings,) [m], 0 where nothing was hit, at angles that grow evenly over one turn.
        first_angle: Of the first reading [rad] from the robot's front.
        angle_step: From one to the next [rad].
        distances: (readings / cluster_points or more,) filled: of each robot found [m].
        bearings_x: (the same,) filled: unit vectors towards them, forwards ...
        bearings_y: ... and to the left.

    Returns:
        How many robots were found.
    """
    every = range(len(ranges))
    return neighbours_in_hits(
        model, ranges, every, len(ranges), first_angle, angle_step, distances, bearings_x, bearings_y
    )


@jittable
def neighbours_in_hits(
    model: ReferenceModel,
    ranges: Row,
    hits: Row,
    n_hits: int,
    first_angle: float,
    angle_step: float,
    distances: MutableRow,
    bearings_x: MutableRow,
    bearings_y: MutableRow,
) -> int:
    """As `lidar_neighbours`, of some readings: `hits` has the numbers of n_hits that may be robots, in order."""
    nearest = model.lidar_nearest
    furthest = model.neighbour_range
    n = 0
    last_range = 0.0
    last_angle = -math.inf  # of the last reading that may be a robot's
    points = 0.0  # in the open cluster; its sums
    sum_range = 0.0
    sum_angle = 0.0
    # The first cluster stays open until the turn ends: the last may belong to it.
    first_range = 0.0
    first_points = -1.0  # none yet
    first_sum_range = 0.0
    first_sum_angle = 0.0
    start_angle = 0.0
    for hit in range(n_hits):
        k = hits[hit]
        distance = ranges[k]
        if not nearest <= distance <= furthest:
            continue
        angle = first_angle + k * angle_step
        joins = abs(distance - last_range) < model.cluster_distance and angle - last_angle < model.cluster_angle
        if points == 0.0:
            first_range = distance
            start_angle = angle
        elif not joins:
            if first_points < 0.0:
                first_points = points
                first_sum_range = sum_range
                first_sum_angle = sum_angle
            else:
                n = _close(model, points, sum_range, sum_angle, distances, bearings_x, bearings_y, n)
            points = 0.0
            sum_range = 0.0
            sum_angle = 0.0
        points += 1.0
        sum_range += distance
        sum_angle += angle
        last_range = distance
        last_angle = angle
    turn = 2.0 * math.pi
    if first_points >= 0.0:
        around = start_angle + turn - last_angle
        if abs(first_range - last_range) < model.cluster_distance and around < model.cluster_angle:
            points += first_points
            sum_range += first_sum_range
            sum_angle += first_sum_angle + turn * first_points
        else:
            n = _close(model, first_points, first_sum_range, first_sum_angle, distances, bearings_x, bearings_y, n)
    return _close(model, points, sum_range, sum_angle, distances, bearings_x, bearings_y, n)


@jittable
def _close(
    model: ReferenceModel,
    points: float,
    sum_range: float,
    sum_angle: float,
    distances: MutableRow,
    bearings_x: MutableRow,
    bearings_y: MutableRow,
    n: int,
) -> int:
    """End a cluster: if it is large enough, it is robot number n."""
    if points < max(1.0, model.cluster_points):
        return n
    angle = sum_angle / points
    distances[n] = sum_range / points
    bearings_x[n] = math.cos(angle)
    bearings_y[n] = math.sin(angle)
    return n + 1
