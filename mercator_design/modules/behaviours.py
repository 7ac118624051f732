"""The behaviours of this package: what a robot does in one control cycle while a part of its software is active.

`u` is a uniform draw in [0, 1) made by the caller: behaviours never touch a generator.

Sources: Garzón Ramos, Szpirer, Birattari et al., the Mercator paper (eqs. 14-19) for Watermelon; Francesca et al.
2014 and 2015 for Vanilla and Chocolate; the source of AutoMoDe-Maple for those that only trees have. Where the paper
leaves open what happens, and in exploration, the rule is that of the published AutoMoDe source;
docs/explanation/paper-and-code.md has all differences.
"""

import math
from collections.abc import Callable
from typing import Annotated

from mercator_design.config.schema import Range
from mercator_design.jit import jittable, open_dispatcher
from mercator_design.modules.module import (
    BEHAVIOUR_CALLS,
    FAILURE_CALLS,
    Designed,
    KnownSwarm,
    Written,
    behaviour,
    like,
)
from mercator_design.modules.perception import MutableRow
from mercator_design.modules.reference import Actions, Readings, ReferenceModel, drive
from mercator_design.modules.words import others_words, seconds_words

TURN_CYCLES, TURN_SIDE = 0, 1
"""Places in the memory of exploration: cycles that it still has to turn; the side it turns to (+1 left, -1 right)."""

CURVE_SIDE, CURVE_ENDED = 0, 1
"""Places in the memory of curve: the side it drives to; whether it has ended since it last drove (see `end_mark`)."""

_RIGHT, _LEFT = 0.0, 1.0
_CURVE_WIDTH = 5.3
"""Distance of the wheels [cm] in the formula of curve: that of the e-puck, on any robot."""

_Tau = Annotated[int, Range(0, 100), Designed(1, log=True), Written("rwm", "RWM")]  # 0 is legal, and means 1
_Attracted = Annotated[float, Range(1, 5), Written("att", "ATT")]
_Radius = Annotated[float, Range(0, 2), Designed(0.1), Written("r", "R")]
_Repelled = Annotated[float, Range(1, 5), Written("rep", "REP")]


@jittable
def wheels_from_vector(model: ReferenceModel, x: float, y: float) -> Actions:
    """Actions that steer towards a vector: the outer one at full speed, the inner one at the cosine of the angle.

    A vector shorter than `weakest_pull` counts as none: straight on. The inner wheel keeps at least `slowest_wheel`.
    """
    length = math.sqrt(x * x + y * y)
    if length < model.weakest_pull:
        return drive(1.0, 1.0)
    inner = max(model.slowest_wheel, x / length)
    if y > 0.0:
        return drive(inner, 1.0)
    return drive(1.0, inner)


@jittable
def strength(model: ReferenceModel, alpha: float) -> float:
    """Alpha as the reference model understands it: real, or rounded down to a multiple of `strength_step`."""
    if model.strength_step > 0.0:
        return float(math.floor(alpha / model.strength_step)) * model.strength_step
    return alpha


@jittable
def obstacle_in_front(model: ReferenceModel, readings: Readings) -> bool:
    """Whether there is an obstacle in the front half."""
    x, y = readings.proximity_x, readings.proximity_y
    return x >= 0.0 and math.sqrt(x * x + y * y) >= model.obstacle_threshold


@jittable
def obstacle_before_curve(model: ReferenceModel, readings: Readings, radius: float) -> bool:
    """As `obstacle_in_front`, for any radius."""
    return obstacle_in_front(model, readings)


def _exploring(swarm: KnownSwarm, tau: float) -> str:
    longest = max(1, int(tau) - 1)
    time = f"1 to {longest} cycles" if longest > 1 else "1 cycle"
    return f"drives straight on; before an obstacle it turns away for {time} (at most {seconds_words(longest, swarm)})"


def _attracted(swarm: KnownSwarm, alpha: float) -> str:
    alone = f"; {others_words(1)}" * (swarm.robots == 1)
    return f"goes to its neighbours (strength {alpha:g} of 1 to 5) and keeps away from obstacles{alone}"


def _repelled(swarm: KnownSwarm, alpha: float) -> str:
    alone = f"; {others_words(1)}" * (swarm.robots == 1)
    return f"goes away from its neighbours (strength {alpha:g} of 1 to 5) and from obstacles{alone}"


@behaviour(label="Exploration", reads={"proximity"}, memory=2, words=_exploring)
def exploration(
    model: ReferenceModel,
    readings: Readings,
    memory: MutableRow,
    u: float,
    tau: _Tau,  # [cycles] a turn away from an obstacle takes fewer cycles than this; 0 means 1
) -> Actions:
    """Drive straight on; before an obstacle, turn away from it for a random time.

    A turn takes fewer cycles than tau, and at least one.
    """
    if memory[TURN_CYCLES] > 0.0:
        memory[TURN_CYCLES] -= 1.0
        return drive(-memory[TURN_SIDE], memory[TURN_SIDE])
    if obstacle_in_front(model, readings):
        # The turn begins in the next cycle; this one still drives straight on.
        memory[TURN_CYCLES] = max(1.0, float(math.floor(u * tau)))
        memory[TURN_SIDE] = 1.0 if readings.proximity_y < 0.0 else -1.0
    return drive(1.0, 1.0)


@behaviour(label="Stop", words=lambda _: "stands still")
def stop(
    model: ReferenceModel,
    readings: Readings,
    memory: MutableRow,
    u: float,
) -> Actions:
    """Stand still."""
    return drive(0.0, 0.0)


@behaviour(
    label="Phototaxis",
    reads={"light", "proximity"},
    words=lambda _: "goes to the light and keeps away from obstacles",
)
def phototaxis(
    model: ReferenceModel,
    readings: Readings,
    memory: MutableRow,
    u: float,
) -> Actions:
    """Go to the light, away from obstacles (eq. 14)."""
    x = model.light_gain * readings.light_x - model.light_obstacle_gain * readings.proximity_x
    y = model.light_gain * readings.light_y - model.light_obstacle_gain * readings.proximity_y
    return wheels_from_vector(model, x, y)


@behaviour(
    name="anti-phototaxis",
    label="Anti-Phototaxis",
    reads={"light", "proximity"},
    words=lambda _: "goes away from the light and from obstacles",
)
def anti_phototaxis(
    model: ReferenceModel,
    readings: Readings,
    memory: MutableRow,
    u: float,
) -> Actions:
    """Go away from the light and from obstacles (eq. 15)."""
    x = -model.light_gain * readings.light_x - model.light_obstacle_gain * readings.proximity_x
    y = -model.light_gain * readings.light_y - model.light_obstacle_gain * readings.proximity_y
    return wheels_from_vector(model, x, y)


@behaviour(label="Attraction", reads={"neighbours", "proximity"}, words=_attracted)
def attraction(
    model: ReferenceModel,
    readings: Readings,
    memory: MutableRow,
    u: float,
    alpha: _Attracted,  # strength, from 1 (weak) to 5 (strong), against that of obstacles
) -> Actions:
    """Go to the neighbours, away from obstacles (eq. 18)."""
    gain = model.attraction_gain * strength(model, alpha)
    x = gain * readings.neighbours_x - model.attraction_obstacle_gain * readings.proximity_x
    y = gain * readings.neighbours_y - model.attraction_obstacle_gain * readings.proximity_y
    return wheels_from_vector(model, x, y)


@behaviour(label="Repulsion", reads={"neighbours", "proximity"}, words=_repelled)
def repulsion(
    model: ReferenceModel,
    readings: Readings,
    memory: MutableRow,
    u: float,
    alpha: _Repelled,  # strength, from 1 (weak) to 5 (strong), against that of obstacles
) -> Actions:
    """Go away from the neighbours and from obstacles (eq. 19)."""
    gain = model.repulsion_gain * strength(model, alpha) ** model.repulsion_power
    x = -gain * readings.neighbours_x - model.repulsion_obstacle_gain * readings.proximity_x
    y = -gain * readings.neighbours_y - model.repulsion_obstacle_gain * readings.proximity_y
    return wheels_from_vector(model, x, y)


@behaviour(
    label="Straight",
    reads={"proximity"},
    fails=obstacle_in_front,
    words=lambda _: "drives straight on; in a tree it fails before an obstacle",
)
def straight(model: ReferenceModel, readings: Readings, memory: MutableRow, u: float) -> Actions:
    """Drive straight on; in a behaviour tree, fail before an obstacle."""
    return drive(1.0, 1.0)


@behaviour(
    label="Rotation", reads={"proximity"}, words=lambda _: "turns on the spot, away from obstacles, else to the left"
)
def rotation(model: ReferenceModel, readings: Readings, memory: MutableRow, u: float) -> Actions:
    """Turn on the spot, away from obstacles; to the left where there are none."""
    x, y = readings.proximity_x, readings.proximity_y
    if y > 0.0 or (y == 0.0 and x < 0.0):  # an angle of 0 to 180 degrees; 0 itself is on the right
        return drive(1.0, -1.0)
    return drive(-1.0, 1.0)


@behaviour(
    label="Curve",
    reads={"proximity"},
    memory=2,
    fails=obstacle_before_curve,
    end_mark=True,
    words=lambda _, radius: f"drives in a curve of a radius of {radius:g} dm; in a tree it fails before an obstacle",
)
def curve(
    model: ReferenceModel,
    readings: Readings,
    memory: MutableRow,
    u: float,
    radius: _Radius,  # [dm] of the circle of the inner wheel
) -> Actions:
    """Drive in a curve to the right; in a behaviour tree, fail before an obstacle, and then draw the side anew."""
    if memory[CURVE_ENDED] != 0.0:
        memory[CURVE_SIDE] = _RIGHT if u < 0.5 else _LEFT
        memory[CURVE_ENDED] = 0.0
    inner = 10.0 * radius / (10.0 * radius + _CURVE_WIDTH)
    if memory[CURVE_SIDE] == _RIGHT:
        return drive(1.0, inner)
    return drive(inner, 1.0)


behave: Callable[..., None] = open_dispatcher("behaviours", BEHAVIOUR_CALLS, like=like(u=0.0))
"""`behave(position in BEHAVIOURS, model, readings, parameters, memory, u, actions)`, which stores Actions in a row."""

fail: Callable[..., None] = open_dispatcher("failures", FAILURE_CALLS, like=like()[:4])
"""`fail(position in FAILURE_CALLS, model, readings, parameters, found)`, which stores 1 in found[0] where one fails."""
