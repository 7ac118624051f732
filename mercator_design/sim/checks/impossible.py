"""Warnings of impossible parts and probable mistakes in a mission: zones outside the walls or out of reach, angles in
degrees, a constant score.

Races and `mdesign validate` refuse an impossible mission (`Simulator.refuse_impossible`); other findings are warnings.
Each cause has one message, with its consequence.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from mercator_design.config.schema import Radians, values_in
from mercator_design.missions.floor import FloorTable
from mercator_design.missions.mission import Mission
from mercator_design.missions.objectives.scoring import Objective
from mercator_design.missions.plugins import is_by_zones
from mercator_design.missions.zone_distance import border_points, distance_to
from mercator_design.plugins.registries import is_ours
from mercator_design.seeds import generator
from mercator_design.sim.checks.reach import Reach, reach_of
from mercator_design.sim.checks.score_range import TRACES, score_can_differ
from mercator_design.sim.robot_model import RobotModel

_MAX_OUTSIDE_COUNTED = 0.1
_MAX_OUTSIDE = 0.5
"""Shares of a zone's area outside the walls: for a zone that the objective uses, and for another zone."""
_MUCH_SHARED = 0.1
"""Share of a nest's area."""
_OF_LIDARS = ("seen_area", "seen_walls")
"""Objectives about what lidars see."""
_POINTS = 10_000
"""Number of points to measure the area of a zone."""


@dataclass(frozen=True, slots=True)
class MissionWarning:
    """A warning on a mission, with its place."""

    message: str
    is_impossible: bool = False
    explains_score: bool = False  # whether it is the cause of equal scores


def mission_warnings(mission: Mission, model: RobotModel) -> list[MissionWarning]:
    """All warnings on a mission with a robot model."""
    found = [*angle_warnings(mission), *angle_warnings(model)]
    for where, one in mission.placed_objectives():
        found += _unseen_walls(mission, model, where, one)
    if not all(is_ours(dynamics.function) for dynamics in mission.floor.dynamics):
        return found  # dynamics of plugins may change which zones are reached
    reach = reach_of(mission, model)
    if reach is None or not reach.reached.any():
        return found
    floor = mission.realise_floor(generator(0, "floor"))
    places = [*_zones(mission, model, floor, reach)]
    for where, one in mission.placed_objectives():
        places += _shared(mission, floor, reach, where, one)
    for where, one in mission.placed_objectives():
        if score_can_differ(mission, one, reach) is False:
            places = _with_score(mission, places, where, one)
    return found + places


def angle_warnings(record: Mission | RobotModel) -> Iterator[MissionWarning]:
    """Warn of angles that may be in degrees.

    Small degrees are valid radians. But few users write an angle of more than half a turn as a whole number of
    radians.
    """
    for annotation, value, path in values_in(type(record), record):
        if not any(isinstance(mark, Radians) for mark in getattr(annotation, "__metadata__", ())):
            continue
        if abs(value) > 2.0 * math.pi + 1e-9:
            what = "is more than a whole turn"
        elif abs(value) > math.pi and value == round(value):
            what = "is more than half a turn, and a whole number"
        else:
            continue
        meant = f"angles are in radians, {value:g} degrees are {math.radians(value):.4g}"
        yield MissionWarning(f"{record.where(path)}: {value:g} rad {what}; {meant}")


def _unseen_walls(
    mission: Mission, model: RobotModel, where_scored: str, objective: Objective
) -> Iterator[MissionWarning]:
    """Warn of walls and boxes that are lower than the lidar, if the objective is about what lidars see."""
    if objective.name not in _OF_LIDARS:
        return
    if model.lidar is None:
        what = f"{objective.name} needs robots with a lidar, and {model.name} has none"
        yield MissionWarning(f"{mission.where(where_scored)}: {what}", is_impossible=True)
        return
    arena, height = mission.arena, model.lidar.height
    over = f"the lidar of {model.name}, at {height:g} m, looks over them"
    low = [f"arena.obstacles[{k}].height" for k, box in enumerate(arena.obstacles) if box.height <= height]
    low = ["arena.wall_height"] * (arena.wall_height <= height) + low
    if len(low) == 1 + len(arena.obstacles):
        is_impossible = objective.name == "seen_walls"
        if is_impossible or arena.room is None:
            needs = "the objective needs walls or boxes that lidars see" if is_impossible else "lidars see no wall"
            where = mission.where("arena.wall_height")
            found = f"walls are {arena.wall_height:g} m high, and {over}: {needs}; expected more than {height:g} m"
            yield MissionWarning(f"{where}: {found}", is_impossible=is_impossible)
    elif low:
        heights = "walls" if low[0] == "arena.wall_height" else "boxes"
        others = f" and {len(low) - 1} more" if len(low) > 1 else ""
        yield MissionWarning(f"{mission.where(low[0])}{others}: {heights} do not count, as {over}")


def _zones(mission: Mission, model: RobotModel, floor: FloorTable, reach: Reach) -> Iterator[MissionWarning]:
    """Warn of zones that are outside the walls, partly or completely, or out of reach."""
    counted = {name for one in mission.all_objectives for _, name in one.zones()}
    size = 2.0 * min(model.body.half_size)
    for index, (zone, rows) in enumerate(mission.floor.with_rows()):
        called = f"zone '{zone.name}'" if zone.name else "this zone"
        place = mission.where(f"floor.zones[{index}]")
        is_counted = zone.name in counted
        outside = _share_outside(mission, floor, rows)
        if not any((reach.touched(floor, row) & reach.inside).any() for row in rows):
            consequence = ", and the objective counts on it" if is_counted else ""
            message = f"{place}: {called} lies outside the walls{consequence}"
            yield MissionWarning(message, is_impossible=is_counted, explains_score=is_counted)
        elif not any(reach.is_reached(floor, row) for row in rows):
            yield MissionWarning(
                f"{place}: no robot can reach {called}: from where they start, there is no way for the centre of a "
                f"robot that is {size:.3g} m wide",
                explains_score=is_counted,
            )
        elif outside > (_MAX_OUTSIDE_COUNTED if is_counted else _MAX_OUTSIDE):
            yield MissionWarning(f"{place}: {100.0 * outside:.0f} % of {called} lie outside the walls")


def _share_outside(mission: Mission, floor: FloorTable, rows: range) -> float:
    """The share of some zones' area outside the walls; 0 for half planes, which are infinite."""
    along = max(3, math.isqrt(_POINTS // len(rows)))
    inside = total = 0
    for row in rows:
        border = border_points(floor, row)
        if len(border):
            axes = [
                np.linspace(low, high, along) for low, high in zip(border.min(axis=0), border.max(axis=0), strict=True)
            ]
            points = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
            points = points[distance_to(floor, row, points) <= 0.0]
            total += len(points)
            inside += int(np.sum(mission.arena.contains(points)))
    return 1.0 - inside / total if total else 0.0


def _shared(
    mission: Mission, floor: FloorTable, reach: Reach, where_scored: str, objective: Objective
) -> Iterator[MissionWarning]:
    """Warn of nests that are also sources: a robot there is at the source."""
    given, zone_rows = objective.parameters, mission.floor.zone_rows()
    if not {"sources", "nests"} <= given.keys():
        return
    sources, nests = (
        np.any([reach.cells_of(floor, row) for name in given[kind] for row in zone_rows[name]], axis=0) & reach.reached
        for kind in ("sources", "nests")
    )
    share = np.sum(sources & nests) / max(1, np.sum(nests))
    if share > _MUCH_SHARED:
        place = mission.where(f"{where_scored}.nests")
        words = "the nests are sources, too" if share == 1.0 else f"{100.0 * share:.0f} % of the nests are sources, too"
        message = f"{place}: {words}: a robot there is at a source, and brings nothing home"
        yield MissionWarning(message, explains_score=share == 1.0)


def _with_score(
    mission: Mission, places: list[MissionWarning], where_scored: str, objective: Objective
) -> list[MissionWarning]:
    """Add that all scores are equal: to each warning that is the cause of it, else as a warning on the objective."""
    is_proved = is_by_zones(objective.function)
    same = (
        "every score is the same, whatever the robots do"
        if is_proved
        else f"in {TRACES} made-up experiments every score was the same, whatever the robots did"
    )
    if not any(warning.explains_score for warning in places):
        return [*places, MissionWarning(f"{mission.where(where_scored)}: {same}", is_impossible=is_proved)]
    return [
        replace(warning, message=f"{warning.message}; so {same}", is_impossible=is_proved or warning.is_impossible)
        if warning.explains_score
        else warning
        for warning in places
    ]
