"""Pseudo-realities that are sampled around the robot model of a design.

Ligot and Birattari (2020, Simulation-only experiments to mimic the effects of the reality gap, Swarm Intelligence 14)
assess designs on a pseudo-reality chosen by hand, then on many that are sampled uniformly around the design model; the
drop of the scores does not depend on the choice. Ligot and Birattari (2022, On using simulation to predict the
performance of robot swarms, Scientific Data 9) compare such predictors with robots. The ranges of their samples are
not stated in what this project could read. Here the reach of each range at width 1 is that of this project's
pseudo-realities chosen by hand, or a stated guess; a width scales all of them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mercator_design.seeds import generator
from mercator_design.sim.fields import found_at, replaced
from mercator_design.sim.robot_model import RobotModel
from mercator_design.sim.robot_parts import Gaussian, Uniform


@dataclass(frozen=True, slots=True)
class _Reach:
    """How far a value may be from the design model's at width 1; `relative`: as a part of that value."""

    amount: float
    high: float = float("inf")
    relative: bool = False


NOISES: Mapping[str, _Reach] = {
    "drive.noise": _Reach(0.15),  # of a tread's speed: mercator-pseudo-reality; of e-pucks 0.10
    "proximity.noise": _Reach(0.03),  # [m] mercator-pseudo-reality
    "proximity.weight_noise": _Reach(0.05),
    "ground.noise": _Reach(15.0),  # of 255: mercator-pseudo-reality
    "neighbours.noise": _Reach(0.90),  # of the distance: mercator-pseudo-reality
    "light.noise": _Reach(0.85),  # epuck-pseudo-reality
    "lidar.noise": _Reach(0.02),  # [m] a guess: 2 % at a metre
}
"""Reach of the spread of each noise (standard deviation or half width, as the design model has it)."""
VALUES: Mapping[str, _Reach] = {
    "drive.maximum_speed": _Reach(0.1, relative=True),  # a guess, as the next: mercator-varied
    "drive.tread_distance": _Reach(0.1, relative=True),
    "neighbours.loss": _Reach(0.05, high=1.0),  # epuck-pseudo-reality
    "lidar.loss": _Reach(0.05, high=1.0),
}
"""Reach of other values of sensing and actuation."""


def sampled_reality(robot_model: RobotModel, width: float, seed: int) -> RobotModel:
    """A pseudo-reality around a robot model: each noise and actuation value uniform within `width` times its reach.

    A range ends where the value would be invalid, as at a noise of 0. A noise that the model lacks is Gaussian. Devices
    that the model lacks stay away. Values of the reference model, which is the program of the robot, do not change.
    """
    random = generator(seed, "sampled reality")
    model = robot_model
    for way, reach in NOISES.items():
        draw = float(random.uniform(-1.0, 1.0))  # in any case, so that a device does not change the draws of others
        device, name = way.split(".")
        if not hasattr(getattr(model, device), name):
            continue
        _, noise = found_at(model, way)
        before = noise.half_width if isinstance(noise, Uniform) else noise.sd if isinstance(noise, Gaussian) else 0.0
        model = replaced(model, [device, name], _spread(noise, _around(before, reach, width, draw)))
    for way, reach in VALUES.items():
        draw = float(random.uniform(-1.0, 1.0))
        _, value = found_at(model, way)
        if isinstance(value, float):
            model = replaced(model, way.split("."), _around(value, reach, width, draw))
    return replace(model, name=f"{robot_model.name} sampled {width:g} {seed}")


def _spread(noise: object, spread: float) -> Any:  # noqa: ANN401 - a noise, for `replaced`
    if isinstance(noise, Uniform):
        return replace(noise, half_width=spread)
    return replace(noise, sd=spread) if isinstance(noise, Gaussian) else Gaussian(sd=spread)


def _around(value: float, reach: _Reach, width: float, draw: float) -> float:
    """The value at a draw from -1 to 1 of the range around it, as far as it is valid."""
    by = width * reach.amount * (value if reach.relative else 1.0)
    low, high = max(value - by, 0.1 * value if reach.relative else 0.0), min(value + by, reach.high)
    return float(np.interp(draw, (-1.0, 1.0), (low, high)))
