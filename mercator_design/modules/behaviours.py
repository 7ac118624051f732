"""The behaviours of this package: what a robot does in one control cycle while a part of its software is active.

`u` is a uniform draw in [0, 1) made by the caller: behaviours never touch a generator.

Sources: Garzón Ramos, Szpirer, Birattari et al., the Mercator paper (eqs. 14-19) for Watermelon; Francesca et al.
2014 and 2015 for Vanilla and Chocolate. Where the paper leaves open what happens, and in exploration, the rule is that
of the published AutoMoDe source; docs/explanation/paper-and-code.md has all differences.
"""

import math
from collections.abc import Callable
from typing import Annotated

from mercator_design.config.schema import Range
from mercator_design.jit import jittable, open_dispatcher
from mercator_design.modules.module import BEHAVIOUR_CALLS, Designed, KnownSwarm, Written, behaviour, like
from mercator_design.modules.perception import MutableRow
from mercator_design.modules.reference import Actions, Readings, ReferenceModel, drive
from mercator_design.modules.words import others_words, seconds_words

TURN_CYCLES, TURN_SIDE = 0, 1
"""Places in the memory of exploration: cycles that it still has to turn; the side it turns to (+1 left, -1 right)."""

_Tau = Annotated[
    int, Range(0, 100), Designed(1, log=True), Written("rwm", "RWM")
]  # 0 is legal, and means the same as 1
_Attracted = Annotated[float, Range(1, 5), Written("att", "ATT")]
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
    x, y = readings.proximity_x, readings.proximity_y
    in_front = x >= 0.0 and math.sqrt(x * x + y * y) >= model.obstacle_threshold
    if in_front:
        # The turn begins in the next cycle; this one still drives straight on.
        memory[TURN_CYCLES] = max(1.0, float(math.floor(u * tau)))
        memory[TURN_SIDE] = 1.0 if y < 0.0 else -1.0
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


behave: Callable[..., None] = open_dispatcher("behaviours", BEHAVIOUR_CALLS, like=like(u=0.0))
"""`behave(position in BEHAVIOURS, model, readings, parameters, memory, u, actions)`, which stores Actions in a row."""
