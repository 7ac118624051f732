"""The conditions of this package: with which probability they hold in one control cycle.

The caller makes the draw: conditions never touch a generator. Sources as in behaviours.py.
"""

import math
from collections.abc import Callable
from typing import Annotated, Literal, get_args

from mercator_design.config.schema import Range
from mercator_design.jit import jittable, open_dispatcher
from mercator_design.modules.module import CONDITION_CALLS, Designed, KnownSwarm, Written, condition, like
from mercator_design.modules.perception import MutableRow, gray_level
from mercator_design.modules.reference import Readings, ReferenceModel
from mercator_design.modules.words import others_words, percent_words, probability_words

Label = Literal["green", "blue", "red", "yellow"]
COLOUR_LABELS: tuple[str, ...] = get_args(Label)
"""What the label parameter of the colour condition means."""

_Beta = Annotated[float, Range(0, 1), Written("p", "P")]
_Xi = Annotated[int, Range(0, 10), Designed(1), Written("p", "B")]
_Eta = Annotated[float, Range(0, 20), Written("w", "W")]
_NotXi = Annotated[int, Range(0, 10), Designed(1), Written("p", "BI")]
_NotEta = Annotated[float, Range(0, 20), Written("w", "WI")]

_Pull = Annotated[float, Range(0, 5), Written("d", "D")]

_NEAR_OBSTACLE = 0.5
"""Length of the proximity vector from which the condition on obstacles holds, on any robot."""

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


def _where(place: str) -> Callable[[KnownSwarm, float], str]:
    """Words for a probability beta at a place."""
    return lambda swarm, beta: probability_words(beta, swarm, place)


def _coloured(swarm: KnownSwarm, beta: float, label: float) -> str:
    return probability_words(beta, swarm, f"where the ground is {COLOUR_LABELS[int(label)]}")


def _many(swarm: KnownSwarm, xi: float, eta: float) -> str:
    return _by_neighbours("more", xi, eta, swarm)


def _few(swarm: KnownSwarm, xi: float, eta: float) -> str:
    return _by_neighbours("fewer", xi, eta, swarm)


def _pulled(swarm: KnownSwarm, beta: float, pull: float) -> str:
    return probability_words(beta, swarm, f"where the sum of the vectors to neighbours is not longer than {pull:g}")


def _by_neighbours(which: Literal["more", "fewer"], xi: float, eta: float, swarm: KnownSwarm) -> str:
    """The probabilities with none and with about xi neighbours; no more than there are other robots."""
    numbers = {0, max(0, int(xi) - 1), int(xi), int(xi) + 1}
    only = ""
    if swarm.robots is not None and swarm.robots <= max(numbers):
        numbers = {min(n, swarm.robots - 1) for n in numbers}
        only = f"; {others_words(swarm.robots)}"
    found = []
    for n in sorted(numbers):
        p = crowding(swarm.model, Readings(neighbours=float(n)), xi, eta)
        found.append(f"{percent_words(p if which == 'more' else 1.0 - p)} with {n or 'none'}")
    holds = "never" if which == "more" else "always"
    beyond = f", but {holds} with more than {int(xi)}" * (swarm.model.count_wraps != 0.0 and eta > 0.0)
    probabilities = " and ".join(filter(None, (", ".join(found[:-1]), found[-1])))
    return f"the {which} neighbours the likelier{beyond}: {probabilities}, in each cycle{only}"


@condition(label="BlackFloor", reads={"ground"}, words=_where("where the ground is black"))
def black_floor(
    model: ReferenceModel,
    readings: Readings,
    memory: MutableRow,
    beta: _Beta,  # [per cycle] probability where the ground is black
) -> float:
    """The ground is black."""
    return beta if ground_level(readings) <= model.black_highest else 0.0


@condition(label="GrayFloor", reads={"ground"}, words=_where("where the ground is as bright as gray (green is)"))
def gray_floor(
    model: ReferenceModel,
    readings: Readings,
    memory: MutableRow,
    beta: _Beta,  # [per cycle] probability where the ground is gray
) -> float:
    """The ground is gray; green is as bright as gray."""
    level = ground_level(readings)
    return beta if model.gray_lowest < level < model.gray_highest else 0.0


@condition(label="WhiteFloor", reads={"ground"}, words=_where("where the ground is as bright as white (yellow is)"))
def white_floor(
    model: ReferenceModel,
    readings: Readings,
    memory: MutableRow,
    beta: _Beta,  # [per cycle] probability where the ground is white
) -> float:
    """The ground is white; yellow is as bright as white."""
    return beta if ground_level(readings) >= model.white_lowest else 0.0


@condition(label="NeighborsCount", reads={"neighbours"}, words=_many)
def neighbours_count(
    model: ReferenceModel,
    readings: Readings,
    memory: MutableRow,
    xi: _Xi,  # [robots] number of neighbours at which the probability is 1/2 a cycle
    eta: _Eta,  # steepness: 0 is a probability of 1/2 for any number of neighbours, 20 nearly a threshold
) -> float:
    """The robot has many neighbours.

    The probability is `crowding`.
    """
    return crowding(model, readings, xi, eta)


@condition(label="InvertedNeighborsCount", reads={"neighbours"}, words=_few)
def inverted_neighbours_count(
    model: ReferenceModel,
    readings: Readings,
    memory: MutableRow,
    xi: _NotXi,  # [robots] number of neighbours at which the probability is 1/2 a cycle
    eta: _NotEta,  # steepness: 0 is a probability of 1/2 for any number of neighbours, 20 nearly a threshold
) -> float:
    """The robot has few neighbours.

    The probability is one minus that of `neighbours_count`.
    """
    return 1.0 - crowding(model, readings, xi, eta)


@condition(label="FixedProbability", words=_where(""))
def fixed_probability(
    model: ReferenceModel,
    readings: Readings,
    memory: MutableRow,
    beta: _Beta,  # [per cycle] probability
) -> float:
    """By chance."""
    return float(beta)


@condition(label="ProbColor", reads={"ground"}, words=_coloured)
def floor_colour(
    model: ReferenceModel,
    readings: Readings,
    memory: MutableRow,
    beta: _Beta,  # [per cycle] probability where the ground has the colour
    label: Annotated[Label, Written("l", "L")],  # the colour
) -> float:
    """The ground has a colour."""
    shown = colour_label(model, readings.ground_red, readings.ground_green, readings.ground_blue)
    return beta if shown >= 0 and shown == label else 0.0  # type: ignore[comparison-overlap]  # a number, in kernels


@condition(label="Light", reads={"light"}, words=_where("where it perceives a light"))
def light(
    model: ReferenceModel,
    readings: Readings,
    memory: MutableRow,
    beta: _Beta,  # [per cycle] probability where a light is perceived
) -> float:
    """The robot perceives a light."""
    return beta if readings.light_x != 0.0 or readings.light_y != 0.0 else 0.0


@condition(label="Obstacle", reads={"proximity"}, words=_where("near an obstacle in front or on the right"))
def obstacle(
    model: ReferenceModel,
    readings: Readings,
    memory: MutableRow,
    beta: _Beta,  # [per cycle] probability near an obstacle in front or on the right
) -> float:
    """An obstacle is near, in front or on the right.

    The original tests the signed angle, so what is behind on the right counts, too.
    """
    x, y = readings.proximity_x, readings.proximity_y
    is_near = math.sqrt(x * x + y * y) >= _NEAR_OBSTACLE
    return beta if is_near and (x >= 0.0 or y < 0.0) else 0.0


@condition(label="CloseToNeighbors", reads={"neighbours"}, words=_pulled)
def close_to_neighbours(
    model: ReferenceModel,
    readings: Readings,
    memory: MutableRow,
    beta: _Beta,  # [per cycle] probability where the neighbours pull no more than that
    pull: _Pull,  # length of the sum of the vectors to neighbours, at most
) -> float:
    """The vectors to the neighbours, the longer the nearer, have a short sum: none is near, or they are all around."""
    x, y = readings.neighbours_x, readings.neighbours_y
    return beta if math.sqrt(x * x + y * y) <= pull else 0.0


probability: Callable[..., None] = open_dispatcher("conditions", CONDITION_CALLS, like=like())
"""`probability(position in CONDITIONS, model, readings, parameters, memory, found)`, which stores it in found[0]."""
