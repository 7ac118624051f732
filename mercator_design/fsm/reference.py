"""The reference model: what a behaviour may know and set, and the constants by which it is interpreted.

Lengths are metres, angles radians counter-clockwise from the robot's front, colours 0 to 255 a channel.
"""

import math
from typing import Annotated, NamedTuple

from mercator_design.schema import NonNegative, Positive, Range

Cycles = Annotated[float, Range(0.0, 1000.0)]


class Readings(NamedTuple):
    """What a robot perceives in one control cycle. The defaults are neutral: nothing perceived."""

    proximity_x: float = 0.0  # obstacles: a vector towards them, of length 0 (none) to 1 (very near)
    proximity_y: float = 0.0
    neighbours: float = 0.0  # how many robots are within ReferenceModel.neighbour_range
    neighbours_x: float = 0.0  # sum over them of a vector towards each, the longer the nearer
    neighbours_y: float = 0.0
    ground_red: float = 255.0
    ground_green: float = 255.0
    ground_blue: float = 255.0
    light_x: float = 0.0  # towards the light, of length 0 (none perceived) to 1
    light_y: float = 0.0


class Wheels(NamedTuple):
    """Speeds of the left and right tread, as fractions -1 to 1 of the robot's maximum speed."""

    left: float
    right: float


class ReferenceModel(NamedTuple):
    """The constants of perception, behaviours and conditions; a robot model may set each.

    Defaults are AutoMoDe-Watermelon as its paper describes it, with the simulated original's rules where the paper
    is silent. The differences between published variants are numbers in this table, never a second copy of a module.
    """

    # Proximity: a distance d [m] in [near, range] weighs, at least 0,
    #     constant + inverse / d + slope * d + square * d^2 + exponential * exp(-d / decay);
    # nearer weighs near_weight. By default that is (1/d - 1/range) / (1/near - 1/range): 0 to 1.
    proximity_near: Positive = 0.05
    proximity_range: NonNegative = 0.4
    proximity_near_weight: NonNegative = 1.0
    proximity_constant: float = -1.0 / 7.0
    proximity_inverse: float = 1.0 / 17.5  # [m]
    proximity_slope: float = 0.0  # [1/m]
    proximity_square: float = 0.0  # [1/m2]
    proximity_exponential: float = 0.0
    proximity_decay: Positive = 1.0  # [m]

    # Neighbours: one at distance d < range weighs 1 / (offset + scale * (d - gap)).
    neighbour_range: Positive = 0.75
    neighbour_offset: Positive = 1.0
    neighbour_scale: NonNegative = 1.0  # [1/m] 100 where a variant means centimetres
    neighbour_gap: NonNegative = 0.0  # [m] between the middles of robots that touch, where a variant starts there
    neighbour_memory: Cycles = 0.0  # for how many cycles more a robot pulls after it was perceived ...
    neighbour_repeats: NonNegative = 0.0  # ... if not 0: once for each time that it was, else where it was last
    neighbour_count_memory: Cycles = 0.0  # for how many cycles more it is counted
    # One within obstacle_range also weighs on the proximity vector, at its distance less obstacle_radius. 0: never,
    # because the proximity sensors see robots too.
    neighbour_obstacle_range: NonNegative = 0.0
    neighbour_obstacle_radius: NonNegative = 0.275

    # Neighbours from a lidar: readings in [lidar_nearest, neighbour_range] are one robot's as long as each is within
    # cluster_distance and cluster_angle of the one before; fewer than cluster_points are none.
    lidar_nearest: NonNegative = 0.10
    cluster_distance: NonNegative = 0.02
    cluster_angle: NonNegative = math.radians(10.0)
    cluster_points: NonNegative = 5.0

    # Light: perceived where one of several sensors, of readings 0 to 1, reads more than this.
    light_threshold: NonNegative = 0.2

    # Behaviours.
    obstacle_threshold: NonNegative = 0.1  # proximity from which exploration turns
    attraction_gain: NonNegative = 1.2  # k_w of the paper's eq. 18
    attraction_obstacle_gain: NonNegative = 5.0  # k_o of the same
    repulsion_gain: NonNegative = 1.0
    repulsion_obstacle_gain: NonNegative = 5.0
    light_gain: NonNegative = 1.0
    light_obstacle_gain: NonNegative = 5.0
    weakest_pull: Positive = 0.1  # a shorter vector counts as none: straight on
    strength_step: NonNegative = 0.0  # alpha is rounded down to a multiple of this; 0: real
    repulsion_power: Positive = 1.0  # the power with which alpha enters repulsion

    # Floor, as gray level 0 to 255: black <= black_highest; gray_lowest < gray < gray_highest; white >= white_lowest.
    black_highest: NonNegative = 0.05 * 255
    gray_lowest: NonNegative = 0.3 * 255
    gray_highest: NonNegative = 0.7 * 255
    white_lowest: NonNegative = 0.78 * 255

    # Where ground_vote_cycles is not 0, the ground is black, gray (127.5) or white as more than ground_majority of the
    # ground sensors' gray levels of so many cycles say: black < ground_vote_black, white > ground_vote_white.
    ground_vote_cycles: Cycles = 0.0
    ground_vote_black: NonNegative = 0.03 * 255
    ground_vote_white: NonNegative = 0.85 * 255
    ground_majority: NonNegative = 10.0

    # Colours: a label is recognised within these of its hue and of full saturation.
    hue_tolerance: NonNegative = math.radians(15.0)
    hue_period: Positive = 2.0 * math.pi  # a huge period makes the difference of hues linear instead of circular
    saturation_tolerance: NonNegative = 0.2
