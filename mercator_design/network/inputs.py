"""The inputs of a network: what they mean, and a kernel for each version of the reference model.

Directions are those of the four quarters around a robot: front left, rear left, rear right, front right. Sources: the
e-puck's and Mercator's versions of EvoStick (demiurge-project's ARGoS3-NEAT and ARGoS3-NEAT-rvr).
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

from mercator_design.jit import jittable
from mercator_design.modules.conditions import ground_level, logistic
from mercator_design.modules.perception import MutableRow, Row, grounds, lights, ranges
from mercator_design.modules.reference import Readings, ReferenceModel

_QUARTERS = ("front left", "rear left", "rear right", "front right")


class Input(NamedTuple):
    """An input of a network."""

    name: str
    sense: str  # that it comes from, of modules.SENSES; empty: none


def _named(sense: str, names: str, places: tuple[object, ...]) -> tuple[Input, ...]:
    return tuple(Input(f"{names} {place}", sense) for place in places)


_NEIGHBOURS = (Input("number of neighbours", "neighbours"), *_named("neighbours", "neighbours", _QUARTERS))
_BIAS = Input("bias", "")

INPUTS: Mapping[str, tuple[Input, ...]] = {
    "1.2": (
        *_named("proximity", "obstacle", _QUARTERS),
        *_named("light", "light", _QUARTERS),
        Input("floor", "ground"),
        *_NEIGHBOURS,
        _BIAS,
    ),
    "1.1": (
        *_named("ranges", "proximity sensor", (*range(1, 9),)),
        *_named("lights", "light sensor", (*range(1, 9),)),
        *_named("grounds", "floor", ("left", "centre", "right")),
        *_NEIGHBOURS,
        _BIAS,
    ),
}
"""The inputs of a version of the reference model, in their order."""

N_INPUTS = len(INPUTS["1.2"])
_RING = 8

_DIAGONAL = math.sqrt(0.5)

# Quantiles of 4204 gray readings that the original recorded with real e-pucks, from which it draws one in each cycle.
# The samples themselves are not known; their mean is 0.41, that of what is drawn here 0.416.
_SHARES = (0.0, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 1.0)
_LEVELS = (0.0, 0.18, 0.24, 0.30, 0.37, 0.50, 0.59, 0.92, 1.0)


@jittable
def gray_sample(u: float) -> float:
    """A reading of an e-puck's sensor on gray floor, 0 to 1, for a uniform draw in [0, 1)."""
    k = 1
    while k < len(_SHARES) - 1 and u > _SHARES[k]:
        k += 1
    return _LEVELS[k - 1] + (u - _SHARES[k - 1]) * (_LEVELS[k] - _LEVELS[k - 1]) / (_SHARES[k] - _SHARES[k - 1])


@jittable
def fill_inputs(model: ReferenceModel, readings: Readings, gray: float, row: MutableRow, first: int) -> None:
    """Fill in the 15 inputs of reference model 1.2.

    Args:
        model: Constants.
        readings: What the robot perceives.
        gray: The floor input where the floor is neither black nor white, 0 to 1.
        row: Filled from place `first` on.
        first: See row.
    """
    _fill_quarters(readings.proximity_x, readings.proximity_y, row, first)
    _fill_quarters(readings.light_x, readings.light_y, row, first + 4)
    row[first + 8] = _floor(model, ground_level(readings), gray)
    row[first + 9] = 1.0 - 2.0 * logistic(-readings.neighbours)
    _fill_quarters(readings.neighbours_x, readings.neighbours_y, row, first + 10)
    row[first + 14] = 1.0


@jittable
def fill_sensors(model: ReferenceModel, readings: Readings, draws: Row, row: MutableRow, first: int) -> None:
    """Fill in the 25 inputs of reference model 1.1: single sensors, and the neighbours by a shorter vector.

    The e-puck numbers its sensors counter-clockwise, from the one on the left of the front on.

    Args:
        model: Constants.
        readings: What the robot perceives.
        draws: (3,) uniform in [0, 1): of what each ground sensor reads on gray floor.
        row: Filled from place `first` on.
        first: See row.
    """
    near, lit, levels = ranges(readings), lights(readings), grounds(readings)
    for k in range(_RING):
        row[first + k] = near[(k + 1) % _RING]
        row[first + _RING + k] = lit[(k + 1) % _RING]
    for k in range(3):
        row[first + 16 + k] = _floor(model, levels[k], gray_sample(draws[k]))
    row[first + 19] = 1.0 - 2.0 * logistic(-readings.neighbours)
    x, y = readings.neighbours_x, readings.neighbours_y
    length = math.sqrt(x * x + y * y)
    if length > 0.0:
        scale = (2.0 * logistic(length) - 1.0) / length
        x, y = scale * x, scale * y
    _fill_quarters(x, y, row, first + 20)
    row[first + 24] = 1.0


@jittable
def _floor(model: ReferenceModel, level: float, gray: float) -> float:
    """A floor input: 0 on black, 1 on white, else what an e-puck reads on gray."""
    if level <= model.network_black_highest:
        return 0.0
    return 1.0 if level >= model.network_white_lowest else gray


@jittable
def _fill_quarters(x: float, y: float, row: MutableRow, first: int) -> None:
    """Fill in the projections of a vector on the directions of the four quarters, 0 if it points away from one."""
    row[first] = max(0.0, (x + y) * _DIAGONAL)
    row[first + 1] = max(0.0, (y - x) * _DIAGONAL)
    row[first + 2] = max(0.0, (-x - y) * _DIAGONAL)
    row[first + 3] = max(0.0, (x - y) * _DIAGONAL)
