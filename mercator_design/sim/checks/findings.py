"""What findings on control software are, and what a robot may perceive on a mission.

A condition is tried in all situations that a robot may be in: each reading of the ground, with each number of
neighbours. What is not known (a noisy ground, no mission) is taken to be anything, so a finding is certain.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mercator_design.config.colours import COLOURS, LABELS, RGB
from mercator_design.missions.mission import Mission
from mercator_design.modules.architecture import Placed
from mercator_design.modules.module import Module
from mercator_design.modules.reference import Readings, ReferenceModel
from mercator_design.plugins.registries import is_ours
from mercator_design.sim.checks.no_effect import ground_levels, readings_on, seen_colours
from mercator_design.sim.robot_model import RobotModel
from mercator_design.sim.robot_parts import LidarNeighbours, Uniform

NEGLIGIBLE = 1e-6
"""Probability a cycle below which a transition counts as one that never fires: once in a day of a robot."""
_MANY = 40
"""Number of neighbours up to which each is tried."""
_MAX_NEIGHBOURS = 1000
"""The maximum number of robots of a mission: it stands for all numbers above `_MANY`."""
_ANY_GROUND: tuple[RGB, ...] = (*(COLOURS[name] for name in LABELS), (64.0, 64.0, 64.0))
"""All that conditions distinguish; the last is between black and gray, where no condition holds."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that a person should look at."""

    code: str  # the kind of finding, for programs
    place: str  # the state, transition or node
    message: str  # a sentence
    is_note: bool = False  # whether it may well be meant


def beta_of(one: Placed) -> float | None:
    """The probability that is a condition's first parameter, if it has one."""
    return one.parameters[0] if one.module.has_beta else None


def chances_in(
    tried: Sequence[Readings],
    one: Placed,
    reference: ReferenceModel,
    mission: Mission | None,
    model: RobotModel | None,
) -> list[float]:
    """The probability of a condition in each situation; NaN if it may also depend on other things."""
    if not _is_judged(one.module, mission, model):
        return [math.nan] * len(tried)
    return [one.module.probability(reference, each, one.parameters) for each in tried]


def _is_judged(module: Module, mission: Mission | None, model: RobotModel | None) -> bool:
    """Whether the situations have all that a condition depends on; own ones may distinguish any colours."""
    if not module.reads <= {"ground", "neighbours"} or module.memory:
        return False
    if is_ours(module.function) or "ground" not in module.reads:
        return True
    return mission is not None and model is not None and ground_levels(mission, model) is not None


def sense_findings(place: str, module: Module, mission: Mission | None, model: RobotModel | None) -> Iterator[Finding]:
    """Senses that the robot lacks, or that never have anything to read on the mission."""
    reads, name = module.reads, module.name
    if model is not None and (missing := sorted(reads - model.senses)):
        yield Finding("missing-sense", place, f"{name} needs {' and '.join(missing)}, which {model.name} lacks")
        return
    if mission is None or module.kind == "condition":
        return
    if "neighbours" in reads and mission.robots == 1:
        yield Finding("nothing-to-read", place, f"{name} reads neighbours, and one robot has none")
    if "light" in reads and not mission.lights:
        yield Finding("nothing-to-read", place, f"{name} reads the light, and {mission.name} has none")


def why_never(
    one: Placed,
    chances: Sequence[float],
    tried: Sequence[Readings],
    mission: Mission | None,
    model: RobotModel | None,
    fires: str,
) -> str:
    """Why a condition never fires, or succeeds, given its chances in the situations that were tried."""
    if (beta := beta_of(one)) is not None and beta <= NEGLIGIBLE:
        return f"never {fires}: its beta is {beta:g}"
    if one.module.labelled and "ground" in one.module.reads and model is not None and not model.sees_colours:
        return f"never {fires}: robot {model.name} sees only how bright the ground is"
    if "neighbours" in one.module.reads:
        neighbours = max(int(each.neighbours) for each in tried)
        found = f"{max(chances):.1g} a cycle with at most {neighbours} neighbours"
        return f"never {fires}: its probability is {found}"
    if mission is not None and model is not None:
        return f"never {fires}: on {mission.name}, robots see {seen_colours(mission, model)}"
    return f"never {fires}: no ground has such a colour"


def situations(mission: Mission | None, model: RobotModel | None) -> list[Readings]:
    """All situations of a robot that conditions distinguish."""
    levels = ground_levels(mission, model) if mission is not None and model is not None else None
    numbers = [*range(_MANY + 1), _MAX_NEIGHBOURS]
    if mission is not None and model is not None and _counts_robots_alone(mission, model):
        numbers = [n for n in numbers if n < mission.robots]
    grounds = [
        readings_on(model, one) if model else Readings(ground_red=one[0], ground_green=one[1], ground_blue=one[2])
        for one in (_ANY_GROUND if levels is None else levels)
    ]
    return [ground._replace(neighbours=float(n)) for ground in grounds for n in numbers]


def _counts_robots_alone(mission: Mission, model: RobotModel) -> bool:
    """Whether a robot never counts more neighbours than there are: it counts no wall, and no robot as two."""
    if model.reference_model.neighbour_count_memory > 0.0:
        return False
    lidar, arena = model.lidar, mission.arena
    if not isinstance(model.neighbours, LidarNeighbours) or lidar is None:
        return True
    noise = lidar.noise
    jump = 0.0 if noise is None else 2.0 * noise.half_width if isinstance(noise, Uniform) else math.inf
    highest = max(model.body.height, arena.wall_height, *(box.height for box in arena.obstacles))
    return arena.room is None and highest <= lidar.height and jump < model.reference_model.cluster_distance
