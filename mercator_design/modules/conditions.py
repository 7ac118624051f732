"""The conditions: with which probability a transition is taken in one control cycle, and the table of them.

Each is a kernel `condition(model, readings, parameters) -> probability`. The caller makes the draw: conditions never
touch a generator. Sources as in behaviours.py.
"""

import math
from collections.abc import Callable

from mercator_design.jit import dispatcher, jittable
from mercator_design.modules.module import Module, ModuleParameter
from mercator_design.modules.perception import Row, gray_level
from mercator_design.modules.reference import Readings, ReferenceModel

COLOUR_LABELS = ("green", "blue", "red", "yellow")
"""What the label parameter of the colour condition means."""

_UNSIGNED = 2.0**32
"""Difference between an unsigned number of 32 bits and the negative one that it was meant to be."""

_LABEL_HUES = (2.0 * math.pi / 3.0, 4.0 * math.pi / 3.0, 0.0, math.pi / 3.0)


@jittable
def ground_level(readings: Readings) -> float:
    """Brightness of the ground, 0 to 255."""
    return gray_level(readings.ground_red, readings.ground_green, readings.ground_blue)


@jittable
def logistic(x: float) -> float:
    """1 / (1 + exp(-x)), without overflow for any x."""
    if x >= 0.0:
        return 1.0 / (1.0 + math.exp(-x))
    e = math.exp(x)
    return e / (1.0 + e)


@jittable
def crowding(model: ReferenceModel, readings: Readings, xi: float, eta: float) -> float:
    """The more neighbours the nearer to 1: 1 / (1 + exp(eta * (xi - n))) (eq. 20)."""
    more = readings.neighbours - xi
    if more > 0.0 and model.count_wraps != 0.0:
        more -= _UNSIGNED
    return logistic(eta * more)


@jittable
def colour_label(model: ReferenceModel, red: float, green: float, blue: float) -> int:
    """Number of the label that a colour shows, or -1 for none (gray levels and hues in between)."""
    highest = max(red, green, blue)
    spread = highest - min(red, green, blue)
    if spread <= 0.0 or 1.0 - spread / highest >= model.saturation_tolerance:
        return -1
    if highest == red:
        sixths = (green - blue) / spread
    elif highest == green:
        sixths = 2.0 + (blue - red) / spread
    else:
        sixths = 4.0 + (red - green) / spread
    hue = sixths * math.pi / 3.0
    if hue < 0.0:
        hue += 2.0 * math.pi
    found = -1
    nearest = model.hue_tolerance
    for label in range(len(_LABEL_HUES)):
        difference = abs(hue - _LABEL_HUES[label])
        difference = min(difference, abs(model.hue_period - difference))
        if difference < nearest:
            found = label
            nearest = difference
    return found


@jittable
def black_floor(model: ReferenceModel, readings: Readings, parameters: Row) -> float:
    """Beta where the ground is black."""
    return parameters[0] if ground_level(readings) <= model.black_highest else 0.0


@jittable
def gray_floor(model: ReferenceModel, readings: Readings, parameters: Row) -> float:
    """Beta where the ground is gray. Colours count by their brightness: green is gray, red is nearly."""
    level = ground_level(readings)
    return parameters[0] if model.gray_lowest < level < model.gray_highest else 0.0


@jittable
def white_floor(model: ReferenceModel, readings: Readings, parameters: Row) -> float:
    """Beta where the ground is white. Yellow is bright enough to count."""
    return parameters[0] if ground_level(readings) >= model.white_lowest else 0.0


@jittable
def neighbours_count(model: ReferenceModel, readings: Readings, parameters: Row) -> float:
    """The more neighbours the likelier, as `crowding` says."""
    return crowding(model, readings, parameters[0], parameters[1])


@jittable
def inverted_neighbours_count(model: ReferenceModel, readings: Readings, parameters: Row) -> float:
    """The fewer neighbours the likelier: one minus the probability of `neighbours_count`."""
    return 1.0 - crowding(model, readings, parameters[0], parameters[1])


@jittable
def fixed_probability(model: ReferenceModel, readings: Readings, parameters: Row) -> float:
    """Beta, always."""
    return float(parameters[0])


@jittable
def floor_colour(model: ReferenceModel, readings: Readings, parameters: Row) -> float:
    """Beta where the ground shows the label's colour."""
    label = colour_label(model, readings.ground_red, readings.ground_green, readings.ground_blue)
    return parameters[0] if label >= 0 and label == parameters[1] else 0.0


def _beta() -> ModuleParameter:
    return ModuleParameter(name="beta", flag="p", grammar="P", low=0, high=1)


def _count(suffix: str) -> tuple[ModuleParameter, ModuleParameter]:
    return (
        ModuleParameter(name="xi", flag="p", grammar="B" + suffix, low=0, high=10, integer=True, sampled_low=1),
        ModuleParameter(name="eta", flag="w", grammar="W" + suffix, low=0, high=20),
    )


_GROUND = frozenset({"ground"})
_NEIGHBOURS = frozenset({"neighbours"})


def _both(number: int) -> dict[str, int]:
    return {"watermelon": number, "chocolate": number}


CONDITIONS = (
    Module(
        name="black floor",
        label="BlackFloor",
        function=black_floor,
        numbers=_both(0),
        reads=_GROUND,
        parameters=(_beta(),),
    ),
    Module(
        name="gray floor",
        label="GrayFloor",
        function=gray_floor,
        numbers=_both(1),
        reads=_GROUND,
        parameters=(_beta(),),
    ),
    Module(
        name="white floor",
        label="WhiteFloor",
        function=white_floor,
        numbers=_both(2),
        reads=_GROUND,
        parameters=(_beta(),),
    ),
    Module(
        name="neighbours count",
        label="NeighborsCount",
        function=neighbours_count,
        numbers=_both(3),
        reads=_NEIGHBOURS,
        parameters=_count(""),
    ),
    Module(
        name="inverted neighbours count",
        label="InvertedNeighborsCount",
        function=inverted_neighbours_count,
        numbers=_both(4),
        reads=_NEIGHBOURS,
        parameters=_count("I"),
    ),
    Module(
        name="fixed probability",
        label="FixedProbability",
        function=fixed_probability,
        numbers=_both(5),
        parameters=(_beta(),),
    ),
    Module(
        name="floor colour",
        label="ProbColor",
        function=floor_colour,
        numbers={"watermelon": 6},
        reads=_GROUND,
        colours=True,
        parameters=(_beta(), ModuleParameter(name="label", flag="l", grammar="L", low=0, high=3, integer=True)),
    ),
)

probability: Callable[..., float] = dispatcher(module.function for module in CONDITIONS)
"""`probability(position in CONDITIONS, model, readings, parameters) -> probability`."""
