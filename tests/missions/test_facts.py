"""The literature's missions are what their sources say: tests/data/mission_facts.yaml, written by hand from them."""

from collections.abc import Mapping
from pathlib import Path

import pytest
import yaml

from mercator_design.config import shipped
from mercator_design.missions.arena import WALL_THICKNESS
from mercator_design.missions.floor import Disc, HalfPlane, PolygonZone, Rectangle, Tiles
from mercator_design.missions.mission import load_mission
from mercator_design.missions.placement import DiscPlacement, DrawnPlacement

FACTS = yaml.safe_load((Path(__file__).parents[1] / "data" / "mission_facts.yaml").read_text())


@pytest.mark.parametrize("name", FACTS["missions"])
def test_a_mission_is_what_its_source_says(name):
    assert described(load_mission(name)) == {**FACTS["usual"], **FACTS["missions"][name]}


def test_every_mission_of_the_literature_has_its_facts():
    ours = {name for name in shipped.missions() if load_mission(name).source.startswith("this project")}
    assert set(FACTS["missions"]) == set(shipped.missions()) - ours
    maps = {"map_corridor", "map_dodecagon", "map_empty_dodecagon", "map_hall", "map_office", "map_rooms"}
    assert ours == {"changing_decision", "cleaning", "frugal_aggregation", "mapping", "stop_signal", *maps}


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("aggregation", "floor.zones[0].radius=0.51"),
        ("aggregation", "floor.background=white"),
        ("aggregation", "placement.heading=0"),
        ("color_aggregation", "floor.zones[0].centers[3][1]=0.26"),
        ("color_aggregation", "objective.values.yellow=4"),
        ("foraging", "objective.values={left source: 2}"),
        ("aggregation_20", "arena.walls.apothem=4.7957"),
        ("chocolate_aac", "lights[0].intensity=2"),
        ("chocolate_sca", "arena.obstacles[0].angle=0.01"),
        ("shelter_black", "placement.regions[1].uniform_in=area"),
        ("directional_gate", "objective.angle=-1.57"),
        ("gianduja_decision", "floor.dynamics[0].colors[1]=gray"),
        ("mapping", "robots=4"),
    ],
)
def test_the_description_says_all(name, change):
    assert described(load_mission(name, [change])) != described(load_mission(name))


def described(mission):
    """A mission as the file of facts has it; what is not usual there and here no fact (a rotation) is said, too."""
    arena, floor = mission.arena, mission.floor
    walls = arena.walls
    zones = [zone(z) for z in floor.zones]
    if floor.background != "gray" or floor.image is not None:
        zones = [f"background: {floor.background} {floor.image}", *zones]
    return {
        "swarm": f"{mission.robots} {mission.robot_model} for {number(mission.cycles * mission.control_period)}",
        "walls": f"{walls.sides} at {number(walls.apothem + WALL_THICKNESS / 2)}" + unless(walls.rotation, 0)
        if walls.shape == "regular_polygon"
        else numbers(*walls.vertices),
        "starts": starts(mission.placement),
        "zones": zones + [f"{d.name}: {parameters(d.parameters)}" for d in floor.dynamics],
        "boxes": [
            f"{numbers(box.center)}; {' x '.join(map(number, (*box.size, box.height)))}" + unless(box.angle, 0)
            for box in arena.obstacles
        ],
        "lights": [
            f"{numbers(light.position)} of {number(light.intensity)}"
            + unless(light.kind, None)
            + unless(light.seen_by, None)
            for light in mission.lights
        ],
        "objective": "; ".join(
            filter(
                None,
                [f"{mission.objective.direction} {mission.objective.name}", parameters(mission.objective.parameters)],
            )
        ),
    }


def starts(placement):
    if isinstance(placement, DrawnPlacement):
        where = " or ".join(map(starts, placement.regions))
    elif isinstance(placement, DiscPlacement):
        inner = f"{number(placement.inner_radius)} to " if placement.inner_radius else ""
        by = " by radius" if placement.uniform_in == "radius" else ""
        where = f"disc of {inner}{number(placement.radius)} at {numbers(placement.center)}{by}"
    else:
        where = bounds(placement.center, placement.size)
    limit = placement.half_plane
    side = f", {beyond(limit.point, limit.normal).replace('<', '<=').replace('>', '>=')}" if limit else ""
    return where + side + unless(placement.heading, "uniform") + unless(placement.waiting, ())


def zone(zone):
    match zone:
        case Disc():
            what = f"{zone.color} disc of {number(zone.radius)} at {numbers(zone.center)}"
        case Rectangle():
            what = f"{zone.color} {bounds(zone.center, zone.size)}" + unless(zone.angle, 0)
        case HalfPlane():
            what = f"{zone.color} {beyond(zone.point, zone.normal)}"
        case PolygonZone():
            what = f"{zone.color} polygon {numbers(*zone.vertices)}"
        case Tiles():
            counts = " ".join(f"{count} {color}" for color, count in zone.colors.items())
            what = f"{counts} squares of {number(zone.size)} at {numbers(*sorted(zone.centers))}"
    return f"{zone.name}: {what}"


def beyond(point, normal):
    (axis,) = (i for i in (0, 1) if normal[i])
    return f"{'xy'[axis]} {'<' if normal[axis] < 0 else '>'} {number(point[axis])}"


def bounds(center, size):
    (left, right), (bottom, top) = ((c - s / 2, c + s / 2) for c, s in zip(center, size, strict=True))
    return f"x {number(left)} to {number(right)}, y {number(bottom)} to {number(top)}"


def parameters(values):
    return "; ".join(f"{key} {value(v)}" for key, v in values.items())


def value(v):
    if isinstance(v, Mapping):
        return " ".join(f"{key} {value(entry)}" for key, entry in v.items()) or "none"
    if isinstance(v, (tuple, list)):
        return (", " if isinstance(v[0], str) else " ").join(map(value, v))
    return str(v).removesuffix(".0")


def numbers(*points):
    return ", ".join(" ".join(map(number, point)) for point in points)


def number(x):
    """To a tenth of a millimetre."""
    return f"{round(x, 4) + 0.0:.8g}"


def unless(found, usual):
    return "" if found == usual else f" ({found})"
