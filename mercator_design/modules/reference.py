"""The reference model: what a behaviour may know and set, and the constants by which it is interpreted.

Lengths are metres, angles radians counter-clockwise from the robot's front, colours 0 to 255 a channel.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, NamedTuple

from mercator_design.config.colours import Levels
from mercator_design.config.schema import Range
from mercator_design.jit import jittable

Constant = Annotated[float, Range(-1e9, 1e9)]
NonNegative = Annotated[float, Range(0.0, 1e9)]
Positive = Annotated[float, Range(1e-6, 1e9)]
Power = Annotated[float, Range(1e-6, 100.0)]
Speed = Annotated[float, Range(-1.0, 1.0)]
Step = Annotated[float, Range(0.0, 1000.0)]
Cycles = Annotated[float, Range(0.0, 1000.0)]


Part = Annotated[float, Range(-1.0, 1.0)]
Channel = Annotated[float, Range(0.0, 255.0)]
Weight = Annotated[float, Range(0.0, 1.0)]
Angle = Annotated[float, Range(-math.pi, math.pi)]
Place = Annotated[float, Range(-100.0, 100.0)]


class Readings(NamedTuple):
    """The perception of a robot in one control cycle. The defaults are neutral: nothing perceived.

    A field begins with the name of its sense (SENSES). Modules are tried with values of its range. A comment is that of
    the fields below it, too.
    """

    proximity_x: Part = 0.0  # vector to obstacles, of length 0 (none) to 1 (very near): forwards, to the left
    proximity_y: Part = 0.0
    neighbours: Annotated[float, Range(0, 20)] = 0.0  # how many robots are within `neighbour_range`
    neighbours_x: Annotated[float, Range(-1e6, 1e6)] = 0.0  # sum of vectors to them, the longer the nearer
    neighbours_y: Annotated[float, Range(-1e6, 1e6)] = 0.0
    ground_red: Channel = 255.0  # of the floor, 0 to 255
    ground_green: Channel = 255.0
    ground_blue: Channel = 255.0
    light_x: Part = 0.0  # vector to the light, of length 0 (none perceived) or 1: forwards, to the left
    light_y: Part = 0.0
    heading: Angle = 0.0  # [rad] -pi to pi, counter-clockwise from that at the start
    odometry_x: Place = 0.0  # [m] from the start, along the heading there
    odometry_y: Place = 0.0  # [m] to the left of that
    ranges_0: Weight = 0.0  # weight of what each proximity sensor sees (not metres), counter-clockwise from the front
    ranges_1: Weight = 0.0
    ranges_2: Weight = 0.0
    ranges_3: Weight = 0.0
    ranges_4: Weight = 0.0
    ranges_5: Weight = 0.0
    ranges_6: Weight = 0.0
    ranges_7: Weight = 0.0
    lights_0: Weight = 0.0  # reading of each sensor of a ring of light sensors, counter-clockwise from the front
    lights_1: Weight = 0.0
    lights_2: Weight = 0.0
    lights_3: Weight = 0.0
    lights_4: Weight = 0.0
    lights_5: Weight = 0.0
    lights_6: Weight = 0.0
    lights_7: Weight = 0.0
    grounds_0: Channel = 255.0  # gray level under each of three ground sensors, from left to right
    grounds_1: Channel = 255.0
    grounds_2: Channel = 255.0


@jittable
def readings_of(row: Any) -> Readings:  # noqa: ANN401 - a list, or an array
    """Readings of a row with a number for each field, in their order."""
    return Readings(
        row[0],
        row[1],
        row[2],
        row[3],
        row[4],
        row[5],
        row[6],
        row[7],
        row[8],
        row[9],
        row[10],
        row[11],
        row[12],
        row[13],
        row[14],
        row[15],
        row[16],
        row[17],
        row[18],
        row[19],
        row[20],
        row[21],
        row[22],
        row[23],
        row[24],
        row[25],
        row[26],
        row[27],
        row[28],
        row[29],
        row[30],
        row[31],
    )


class Sense(NamedTuple):
    """The devices that measure the readings of a sense, in simulation and on the robot."""

    device: str  # key of robot models: its device in simulation
    sample: str  # of the robot, a sensor of robot/devices/samples.py, or "lidar"; empty: robots lack it
    follows_turns: bool = False  # whether a robot corrects it by how far it has turned since it was measured
    counts_from_start: bool = False  # whether it counts from the pose in which the robot was started up
    each: str = ""  # key of the device's list of sensors, if there must be one for each reading


SENSES: Mapping[str, Sense] = {
    "proximity": Sense("proximity", "proximity", follows_turns=True),
    "neighbours": Sense("neighbours", "lidar", follows_turns=True),
    "ground": Sense("ground", "ground"),
    "light": Sense("light", ""),
    "heading": Sense("imu", "attitude", follows_turns=True, counts_from_start=True),
    "odometry": Sense("locator", "position", counts_from_start=True),
    "ranges": Sense("proximity", "proximity", each="angles"),
    "lights": Sense("light", "", each="angles"),
    "grounds": Sense("ground", "", each="positions"),
}
"""What readings are made of. A robot may lack some; what an active part does not read is not sensed."""

N_READINGS = len(Readings._fields)


def sense_of(field: str) -> str:
    """The sense of a field of Readings."""
    return field.partition("_")[0]


def first_reading(sense: str) -> int:
    """The place of a sense's first reading."""
    return next(k for k, field in enumerate(Readings._fields) if sense_of(field) == sense)


def sense_number(sense: str) -> int:
    """The number of a sense, from 0."""
    return [*SENSES].index(sense)


def senses_bits(senses: Iterable[str]) -> int:
    """A set of senses as a number."""
    return sum(1 << sense_number(sense) for sense in set(senses))


EVERYTHING = senses_bits(SENSES)
"""All senses, as a number; those that a robot lacks have neutral readings."""


def n_readings(sense: str) -> int:
    """Count of the readings of a sense."""
    return sum(sense_of(field) == sense for field in Readings._fields)


N_RANGES = n_readings("ranges")


class Actions(NamedTuple):
    """The outputs of a robot in one control cycle."""

    left: float  # speed of the left tread, as a fraction -1 to 1 of the robot's maximum speed
    right: float  # of the right tread
    led_colour: float  # 0 off, 1 green, 2 blue, 3 red, 4 yellow, 5 magenta, 6 cyan: all LEDs; -1: as they were
    signal: float  # 0 to 7, sent to other robots in this cycle; 0: none


ACTIVE = 0
"""Place in a controller's memory of the number of the active part, such as the state of a PFSM."""

SCRATCH = len(Actions._fields)
ACTIONS = SCRATCH + 1
"""Length of a row of Actions, behind which there is a place for what a condition returns."""

OUTPUTS = ("wheels", "led_colour", "signal")
"""What a behaviour may set."""

LED_COLOURS: Mapping[str, Levels] = {
    "off": (0, 0, 0),
    "green": (0, 255, 0),
    "blue": (0, 0, 255),
    "red": (255, 0, 0),
    "yellow": (255, 255, 0),
    "magenta": (255, 0, 255),
    "cyan": (0, 255, 255),
}
"""What `Actions.led_colour` means, by number from 0 (AutoMoDe-TuttiFrutti), and the levels of red, green and blue."""

MAX_SIGNAL = 7

WRONG = -2
"""What is recorded of an LED colour or signal that no robot can show or send."""


@jittable
def whole(value: float, lowest: int, highest: int) -> int:
    """A number as an integer; WRONG if it is not whole, or not from the lowest to the highest."""
    if lowest <= value <= highest and value == math.floor(value):
        return int(value)
    return WRONG


@jittable
def led_colour_of(actions: Sequence[float]) -> int:
    """The LED colour of a row of Actions, of LED_COLOURS; -1: as it was; WRONG."""
    return whole(actions[2], -1, 6)


@jittable
def signal_of(actions: Sequence[float]) -> int:
    """The signal of a row of Actions, or WRONG."""
    return whole(actions[3], 0, MAX_SIGNAL)


@jittable
def drive(left: float, right: float) -> Actions:
    """Drive, and leave the LEDs as they were."""
    return Actions(left, right, -1.0, 0.0)


class ReferenceModel(NamedTuple):
    """The constants of perception, behaviours and conditions; a robot model may set each.

    Defaults are AutoMoDe-Watermelon as its paper describes it, with the original's rules where the paper is silent or,
    for the reasons in docs/adr/0003, not followed. The differences between published variants are numbers in this
    table, never a second copy of a module.
    """

    # Proximity: a distance d [m] in [near, range] weighs, at least 0,
    #     constant + inverse / d + slope * d + square * d^2 + exponential * exp(-d / decay).
    # By default that is (1/d - 1/range) / (1/near - 1/range): 0 to 1.
    proximity_near: Positive = 0.05  # [m] below which a distance weighs proximity_near_weight
    proximity_range: NonNegative = 0.4  # [m] beyond which a distance weighs nothing
    proximity_near_weight: NonNegative = 1.0  # weight of a distance below proximity_near
    proximity_constant: Constant = -1.0 / 7.0  # added to the weight of a distance d
    proximity_inverse: Constant = 1.0 / 17.5  # [m] divided by d, then added to the weight of d
    proximity_slope: Constant = 0.0  # [1/m] multiplied by d, then added to the weight of d
    proximity_square: Constant = 0.0  # [1/m2] multiplied by d^2, then added to the weight of d
    proximity_exponential: Constant = 0.0  # multiplied by exp(-d / proximity_decay), then added to the weight
    proximity_decay: Positive = 1.0  # [m] after which what is exponential has fallen to 1/e

    # Neighbours: one at distance d < range weighs 1 / (offset + scale * (d - gap)), but 1e6 at most.
    neighbour_range: Positive = 0.75  # [m] within which a robot counts as a neighbour
    neighbour_offset: NonNegative = 1.0  # one over the weight of a neighbour at neighbour_gap; 0: the paper's alpha / d
    neighbour_scale: NonNegative = 1.0  # [1/m] by which one over the weight grows with the distance; 100: cm are meant
    neighbour_gap: NonNegative = 0.0  # [m] between the middles of robots that touch, where distances count from there
    neighbour_memory: Cycles = 0.0  # [cycles] for which a robot still pulls after it was perceived
    neighbour_repeats: NonNegative = 0.0  # not 0: a robot pulls once for each time it was perceived
    neighbour_count_memory: Cycles = 0.0  # [cycles] for which a robot still counts after it was perceived
    # By default never, because the proximity sensors see robots too.
    neighbour_obstacle_range: NonNegative = 0.0  # [m] within which a neighbour is an obstacle too; 0: never
    neighbour_obstacle_radius: NonNegative = 0.275  # [m] by which such an obstacle is nearer than the neighbour

    # Neighbours from a lidar: readings in [lidar_nearest, neighbour_range] are one robot's as long as each is within
    # cluster_distance and cluster_angle of the one before; fewer than cluster_points are none.
    lidar_nearest: Positive = 0.10  # [m] below which a reading of the lidar is not used
    cluster_distance: NonNegative = 0.02  # [m] at most between successive readings of one robot
    cluster_angle: NonNegative = math.radians(10.0)  # [rad] at most between successive readings of one robot
    cluster_points: NonNegative = 5.0  # readings of one robot, at least

    light_threshold: NonNegative = 0.2  # a light is perceived where a sensor reads more, of 0 to 1

    # Behaviours.
    obstacle_threshold: NonNegative = 0.1  # length of the proximity vector, 0 to 1, from which exploration turns
    attraction_gain: NonNegative = 1.2  # weight of the neighbours in attraction, k_w of the Mercator paper's eq. 18
    attraction_obstacle_gain: NonNegative = 5.0  # weight of obstacles in attraction, k_o of that equation
    repulsion_gain: NonNegative = 1.0  # weight of the neighbours in repulsion
    repulsion_obstacle_gain: NonNegative = 5.0  # weight of obstacles in repulsion
    light_gain: NonNegative = 1.0  # weight of the light in phototaxis and anti-phototaxis
    light_obstacle_gain: NonNegative = 5.0  # weight of obstacles in phototaxis and anti-phototaxis
    weakest_pull: Positive = 0.1  # length of the sum of weighted vectors below which a robot drives straight on
    strength_step: Step = 0.0  # the strength alpha is rounded down to a multiple of it; 0: not rounded
    repulsion_power: Power = 1.0  # power of the strength alpha in repulsion
    slowest_wheel: Speed = -1.0  # lowest speed of the inner wheel, of -1 to 1, where a robot steers towards a vector

    # Neighbour counts. AutoMoDe-Maple subtracts without sign: a robot with more than xi neighbours counts as with none.
    count_wraps: NonNegative = 0.0  # not 0: more neighbours than xi count as far fewer, unless eta is 0

    # Behaviour trees. In AutoMoDe-Maple a Selector* whose children all fail succeeds.
    starred_selector_succeeds: NonNegative = 0.0  # not 0: a Selector* succeeds if all its children fail

    # Floor, as gray level 0 to 255: black <= black_highest; gray_lowest < gray < gray_highest; white >= white_lowest.
    black_highest: NonNegative = 0.05 * 255  # gray level of 0 to 255 up to which the floor is black
    gray_lowest: NonNegative = 0.3 * 255  # gray level of 0 to 255 above which the floor is gray
    gray_highest: NonNegative = 0.7 * 255  # gray level of 0 to 255 below which the floor is gray
    white_lowest: NonNegative = 0.78 * 255  # gray level of 0 to 255 from which the floor is white

    # Where ground_vote_cycles is not 0, the ground is black, gray (127.5) or white as more than ground_majority of the
    # ground sensors' gray levels of so many cycles say: black < ground_vote_black, white > ground_vote_white.
    ground_vote_cycles: Cycles = 0.0  # [cycles] of which ground readings vote; 0: the mean of the latest counts
    ground_vote_black: NonNegative = 0.03 * 255  # gray level of 0 to 255 below which a reading votes for black
    ground_vote_white: NonNegative = 0.85 * 255  # gray level of 0 to 255 above which a reading votes for white
    ground_majority: NonNegative = 10.0  # votes that black or white needs more than

    # Floor, as input of a network: black is 0, white 1, in between a random sample of what e-pucks read on gray.
    network_black_highest: NonNegative = 0.1 * 255  # gray level of 0 to 255 up to which a network's floor input is 0
    network_white_lowest: NonNegative = 0.95 * 255  # gray level of 0 to 255 from which a network's floor input is 1

    # Colours.
    hue_tolerance: NonNegative = math.radians(15.0)  # [rad] from a label's hue within which it is recognised
    hue_period: Positive = 2.0 * math.pi  # [rad] after which hues repeat; a huge one makes their difference linear
    saturation_tolerance: NonNegative = 0.2  # by which a colour's saturation may be below 1 if it is recognised
