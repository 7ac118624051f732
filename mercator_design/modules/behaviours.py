"""The behaviours: what a robot does in one control cycle while a state is active, and the table of them.

Each is a kernel `behaviour(model, readings, parameters, memory, u) -> Wheels`. `memory` is the controller's row of
numbers (control.py), of which a behaviour owns the part from TURN_CYCLES on, zeroed when a state is entered. `u` is a
uniform draw in [0, 1) made by the caller: behaviours never touch a generator.

Sources: Garzón Ramos, Szpirer, Birattari et al., the Mercator paper (eqs. 14-19) for Watermelon; Francesca et al.
2014 and 2015 for Vanilla and Chocolate. Where the paper leaves open what happens, and in exploration, the rule is that
of the published AutoMoDe source; docs/explanation/paper-and-code.md has all differences.
"""

import math
from collections.abc import Callable

from mercator_design.jit import dispatcher, jittable
from mercator_design.modules.module import Module, ModuleParameter
from mercator_design.modules.perception import Row
from mercator_design.modules.reference import Readings, ReferenceModel, Wheels

TURN_CYCLES, TURN_SIDE = 2, 3
"""Places in `memory`: cycles that exploration still has to turn; the side it turns to (+1 left, -1 right)."""


@jittable
def wheels_from_vector(model: ReferenceModel, x: float, y: float) -> Wheels:
    """Wheels that steer towards a vector: the outer one at full speed, the inner one at the cosine of the angle.

    A vector shorter than `weakest_pull` counts as none: straight on. The inner wheel keeps at least `slowest_wheel`.
    """
    length = math.sqrt(x * x + y * y)
    if length < model.weakest_pull:
        return Wheels(1.0, 1.0)
    inner = max(model.slowest_wheel, x / length)
    if y > 0.0:
        return Wheels(inner, 1.0)
    return Wheels(1.0, inner)


@jittable
def strength(model: ReferenceModel, alpha: float) -> float:
    """Alpha as the reference model understands it: real, or rounded down to a multiple of `strength_step`."""
    if model.strength_step > 0.0:
        return float(math.floor(alpha / model.strength_step)) * model.strength_step
    return alpha


@jittable
def exploration(model: ReferenceModel, readings: Readings, parameters: Row, memory: list[float], u: float) -> Wheels:
    """Straight on; before an obstacle, turn away from it for a random number of cycles below tau, at least one."""
    tau = parameters[0]  # [cycles]
    if memory[TURN_CYCLES] > 0.0:
        memory[TURN_CYCLES] -= 1.0
        return Wheels(-memory[TURN_SIDE], memory[TURN_SIDE])
    x, y = readings.proximity_x, readings.proximity_y
    in_front = x >= 0.0 and math.sqrt(x * x + y * y) >= model.obstacle_threshold
    if in_front:
        # The turn begins in the next cycle; this one still drives straight on.
        memory[TURN_CYCLES] = max(1.0, float(math.floor(u * tau)))
        memory[TURN_SIDE] = 1.0 if y < 0.0 else -1.0
    return Wheels(1.0, 1.0)


@jittable
def stop(model: ReferenceModel, readings: Readings, parameters: Row, memory: list[float], u: float) -> Wheels:
    """Stand still."""
    return Wheels(0.0, 0.0)


@jittable
def phototaxis(model: ReferenceModel, readings: Readings, parameters: Row, memory: list[float], u: float) -> Wheels:
    """Go to the light, away from obstacles (eq. 14)."""
    x = model.light_gain * readings.light_x - model.light_obstacle_gain * readings.proximity_x
    y = model.light_gain * readings.light_y - model.light_obstacle_gain * readings.proximity_y
    return wheels_from_vector(model, x, y)


@jittable
def anti_phototaxis(
    model: ReferenceModel,
    readings: Readings,
    parameters: Row,
    memory: list[float],
    u: float,
) -> Wheels:
    """Go away from the light and from obstacles (eq. 15)."""
    x = -model.light_gain * readings.light_x - model.light_obstacle_gain * readings.proximity_x
    y = -model.light_gain * readings.light_y - model.light_obstacle_gain * readings.proximity_y
    return wheels_from_vector(model, x, y)


@jittable
def attraction(model: ReferenceModel, readings: Readings, parameters: Row, memory: list[float], u: float) -> Wheels:
    """Go to the neighbours, away from obstacles (eq. 18)."""
    gain = model.attraction_gain * strength(model, parameters[0])
    x = gain * readings.neighbours_x - model.attraction_obstacle_gain * readings.proximity_x
    y = gain * readings.neighbours_y - model.attraction_obstacle_gain * readings.proximity_y
    return wheels_from_vector(model, x, y)


@jittable
def repulsion(model: ReferenceModel, readings: Readings, parameters: Row, memory: list[float], u: float) -> Wheels:
    """Go away from the neighbours and from obstacles (eq. 19)."""
    gain = model.repulsion_gain * strength(model, parameters[0]) ** model.repulsion_power
    x = -gain * readings.neighbours_x - model.repulsion_obstacle_gain * readings.proximity_x
    y = -gain * readings.neighbours_y - model.repulsion_obstacle_gain * readings.proximity_y
    return wheels_from_vector(model, x, y)


_OBSTACLES = frozenset({"proximity"})
_LIGHT = frozenset({"light", "proximity"})
_NEIGHBOURS = frozenset({"neighbours", "proximity"})

BEHAVIOURS = (
    Module(
        name="exploration",
        label="Exploration",
        function=exploration,
        numbers={"watermelon": 0, "chocolate": 0},
        reads=_OBSTACLES,
        # 0 is legal in published controllers and means the same as 1.
        parameters=(
            ModuleParameter(
                name="tau", flag="rwm", grammar="RWM", low=0, high=100, integer=True, sampled_low=1, log=True
            ),
        ),
    ),
    Module(name="stop", label="Stop", function=stop, numbers={"watermelon": 1, "chocolate": 1}),
    Module(name="phototaxis", label="Phototaxis", function=phototaxis, numbers={"chocolate": 2}, reads=_LIGHT),
    Module(
        name="anti-phototaxis",
        label="Anti-Phototaxis",
        function=anti_phototaxis,
        numbers={"chocolate": 3},
        reads=_LIGHT,
    ),
    Module(
        name="attraction",
        label="Attraction",
        function=attraction,
        numbers={"watermelon": 2, "chocolate": 4},
        reads=_NEIGHBOURS,
        parameters=(ModuleParameter(name="alpha", flag="att", grammar="ATT", low=1, high=5),),
    ),
    Module(
        name="repulsion",
        label="Repulsion",
        function=repulsion,
        numbers={"watermelon": 3, "chocolate": 5},
        reads=_NEIGHBOURS,
        parameters=(ModuleParameter(name="alpha", flag="rep", grammar="REP", low=1, high=5),),
    ),
)

behave: Callable[..., Wheels] = dispatcher(module.function for module in BEHAVIOURS)
"""`behave(position in BEHAVIOURS, model, readings, parameters, memory, u) -> Wheels`."""
