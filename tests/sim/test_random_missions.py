"""Random valid missions, robots and PFSMs: nothing crashes, gets lost, leaves the arena, or moves by itself."""

import functools
import itertools
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mercator_design.config import shipped
from mercator_design.config.colours import COLOURS
from mercator_design.config.schema import FieldError
from mercator_design.designer import flavour_space
from mercator_design.errors import MissionError
from mercator_design.fsm.space.grammar import to_pfsm
from mercator_design.missions.arena import Arena, Box, Light, Polygon, RegularPolygon
from mercator_design.missions.floor import (
    Disc,
    Dynamics,
    Floor,
    HalfPlane,
    Image,
    PolygonZone,
    Rectangle,
    Ring,
    Tiles,
)
from mercator_design.missions.mission import Mission, Objective
from mercator_design.missions.placement import (
    DiscPlacement,
    DrawnPlacement,
    FixedPlacement,
    HalfPlaneLimit,
    RectanglePlacement,
)
from mercator_design.sim import world
from mercator_design.sim.checks.reach import reach_of
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import (
    BoxBody,
    DiscBody,
    Drive,
    Gaussian,
    Lidar,
    LidarNeighbours,
    LightCamera,
    LightRing,
    Neighbours,
    Physics,
    Uniform,
)
from mercator_design.sim.simulate import Simulator
from tests.fsm.strategies import FLAVOURS
from tests.tiers import cases

pytestmark = pytest.mark.together("kernels")  # compiled once

PICTURE = str(Path(__file__).parents[2] / "docs/pictures/missions/mapping.png")

shipped_robot = functools.cache(load_robot_model)


@functools.cache
def pfsms(flavour):
    """The space of all PFSMs of a flavour."""
    return flavour_space(flavour)


def check(seed):
    """One random experiment, and what must hold in each of its cycles; returns how close it came to the limits."""
    draw = np.random.default_rng(seed)
    simulator = random_simulator(draw, seed)
    pfsm = random_pfsm(draw, simulator.robot_model)
    outcome = simulator.run(pfsm, seed)
    trace, mission, model = outcome.trace, simulator.mission, outcome.recording.robot_model
    assert math.isfinite(outcome.score)
    assert np.isfinite(trace.poses).all()
    if seed % 10 == 0:
        referee = simulator.run(pfsm, seed, referee=True, record=True)
        assert np.array_equal(trace.poses, referee.trace.poses)
        assert outcome.score == referee.score
    poses = trace.poses.reshape(-1, 3)
    assert mission.arena.contains(poses[:, :2]).all()
    if seed % 4 == 0 and (reach := reach_of(mission, simulator.robot_model)) is not None:
        columns, rows = np.floor((poses[:, :2] - reach.low) / reach.cell).astype(int).T
        assert reach.reached[rows, columns].all(), "a robot is where it is said that none can come"
    speed = speed_share(trace, model)
    assert speed < 2.0
    if model.physics.wall_overlap is None:  # the original's, which mends no overlaps
        return 0.0, 0.0, speed
    inside_walls = depth_in_walls(poses, model.body, mission.arena)
    assert inside_walls < 0.003
    # In a crowd that is squeezed robots reach into each other, but do not come to the other side.
    inside_robots = depth_in_robots(trace, model.body) / min(model.body.half_size)
    assert inside_robots < 1.0
    return inside_walls, inside_robots, speed


def test_few_random_missions(monkeypatch):
    """Of missions whose robots do not fit it takes long to find out, and others are drawn instead: that may be soon."""
    monkeypatch.setattr(world, "_MAX_TRIALS", 5_000)
    for seed in range(20):
        check(seed)


@pytest.mark.thorough
def test_random_missions(monkeypatch):
    monkeypatch.setattr(world, "_MAX_TRIALS", 5_000)
    with ThreadPoolExecutor(2) as pool:
        inside_walls, inside_robots, speed = np.max(list(pool.map(check, range(120))), axis=0)
    assert inside_walls > 0.0019  # they did push
    assert inside_robots > 0.02
    assert speed > 0.2


@pytest.mark.thorough
def test_many_random_missions():
    with ThreadPoolExecutor() as pool:
        for start in range(0, len(cases(200)), 200):
            list(pool.map(check, range(200 + start, 400 + start)))


def corners_of(poses, length, width):
    """The corners (n, 4, 2) of boxes at poses (n, 3)."""
    c, s = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    x, y = 0.5 * length * np.array([1, -1, -1, 1]), 0.5 * width * np.array([1, 1, -1, -1])
    return np.stack([poses[:, :1] + c * x - s * y, poses[:, 1:2] + s * x + c * y], axis=-1)


def depth_in_walls(poses, body, arena):
    """How deep [m] a robot was in an outer wall or a box, at most."""
    outline = arena.corners()
    boxes = [box.corners() for box in arena.obstacles]
    if isinstance(body, DiscBody):
        return body.radius - min(way_to(poses[:, :2], each).min() for each in (outline, *boxes))
    corners = corners_of(poses, body.length, body.width)
    outside = corners.reshape(-1, 2)[~arena.contains(corners.reshape(-1, 2))]
    depths = [0.0, *way_to(outside, outline)]  # of the robots' corners in walls
    c, s = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    x, y = (outline - poses[:, None, :2]).transpose(2, 0, 1)
    inside = np.minimum(0.5 * body.length - abs(c * x + s * y), 0.5 * body.width - abs(c * y - s * x))
    return max([*depths, inside.max(), *(overlap(corners, box[None]).max() for box in boxes)])


def depth_in_robots(trace, body):
    """How deep [m] a robot was in another one, at most."""
    robots = np.moveaxis(trace.poses, 1, 0)
    if isinstance(body, DiscBody):
        depths = [2 * body.radius - np.hypot(*(a - b).T[:2]).min() for a, b in itertools.combinations(robots, 2)]
    else:
        corners = [corners_of(poses, body.length, body.width) for poses in robots]
        depths = [overlap(a, b).max() for a, b in itertools.combinations(corners, 2)]
    return max([0.0, *depths])


def way_to(points, outline):
    """The distances [m] of points (n, 2) from a polygon's outline."""
    along = np.roll(outline, -1, axis=0) - outline
    offset = points[:, None] - outline
    part = np.clip(np.sum(offset * along, axis=-1) / np.sum(along * along, axis=-1), 0, 1)
    return np.linalg.norm(offset - part[..., None] * along, axis=-1).min(axis=1)


def overlap(one, other):
    """Overlap of boxes (n, 4, 2) [m] along the axis on which it is least."""
    axes = np.concatenate(np.broadcast_arrays(np.diff(one[:, :3], axis=1), np.diff(other[:, :3], axis=1)), axis=1)
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    ours, theirs = axes @ one.transpose(0, 2, 1), axes @ other.transpose(0, 2, 1)
    return np.minimum(ours.max(-1) - theirs.min(-1), theirs.max(-1) - ours.min(-1)).min(-1)


def speed_share(trace, model):
    """The highest speed of a robot, and of its corners around its centre, as a share of the fastest corner's.

    A robot that turns with a corner at a wall is kicked away faster than it drives; and where it meets the corner of
    another that turns, they part at most twice as fast as corners are. If contacts gave energy, nothing would limit it.
    """
    moved = np.diff(trace.poses, axis=0) / trace.control_period
    fastest = np.maximum(np.hypot(moved[..., 0], moved[..., 1]), model.body.corner * abs(moved[..., 2])).max()
    noise = model.drive.noise
    if isinstance(noise, Gaussian):  # beyond six standard deviations: once in 500 million draws
        return float(fastest / (model.fastest * (1.0 + 6.0 * noise.sd)))
    return float(fastest / (model.fastest * (1.0 + (noise.half_width if noise else 0.0))))


def random_simulator(draw, seed):
    while True:
        try:
            robot = random_robot(draw)
            simulator = Simulator(random_mission(draw, robot), robot)
            simulator.instance(seed)
        except (FieldError, MissionError):  # walls that cross, no room for the robots, and so on
            continue
        return simulator


def random_mission(draw, robot):
    walls = one_of(draw, WALLS)(draw, robot.body.corner * draw.uniform(5, 9))  # 5: lengths are a Mercator's
    reach = np.abs(walls.corners()).max()
    room = Arena(walls=walls).area / (12.0 * robot.body.corner**2)  # more seldom fit, and to find that out takes long
    robots = int(draw.integers(1, np.clip(room, 2, 13)))
    period = float(draw.choice([0.02, 0.05, 0.1, 0.1, 0.1, 0.2, 1 / 3]))
    zones = "abcd"[: draw.integers(5)]
    objectives = {name: make for name, make in OBJECTIVES.items() if robot.lidar or not name.startswith("seen_")}
    return Mission(
        schema=1,
        name="random",
        robots=robots,
        duration=period * int(draw.integers(10, 50)),
        control_period=period,
        arena=Arena(
            walls=walls,
            wall_height=height(draw),
            obstacles=several(draw, 4 * draw.integers(2), lambda: random_box(draw, reach)),
            room=maybe(draw, lambda: RegularPolygon(sides=6, apothem=draw.uniform(1.7, 3) * reach)),
        ),
        floor=Floor(
            background=colour(draw),
            image=maybe(draw, lambda: Image(path=PICTURE, size=size(draw, 3 * reach), center=point(draw, reach))),
            zones=tuple(one_of(draw, ZONES)(draw, reach, name) for name in zones),
            dynamics=several(draw, 2 * bool(zones), lambda: random_call(draw, Dynamics, DYNAMICS, reach)),
        ),
        lights=several(draw, 3, lambda: random_light(draw, reach, robots)),
        placement=random_placement(draw, reach, robots),
        objective=random_call(draw, Objective, objectives, reach, direction="maximise"),
    )


def corridor(draw, unit):
    """Walls between which a robot hardly turns."""
    pose = np.array([[0.0, 0.0, angle(draw)]])
    return polygon(corners_of(pose, unit * draw.uniform(0.6, 3), unit * draw.uniform(0.29, 0.6))[0])


def partition(draw, unit):
    """A room with a wall that begins at a wall."""
    (width, top), half = pair(draw, 0.4 * unit, 1.5 * unit), draw.uniform(0.011, 0.1)
    end = draw.uniform(-0.9, 0.9) * top
    outer = [(-width, -top), (width, -top), (width, top)]
    return polygon([*outer, (half, top), (half, end), (-half, end), (-half, top), (-width, top)])


def star(draw, most):
    """Corners, all of which are seen from the middle."""
    n = int(draw.integers(3, 12))
    angles, radii = np.sort(draw.uniform(0, 2 * math.pi, n)), draw.uniform(0.2, 1, n) * most
    return np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])


def polygon(corners, kind=Polygon, **more):
    return kind(vertices=tuple((float(x), float(y)) for x, y in corners), **more)


WALLS = (
    corridor,
    partition,
    lambda draw, unit: polygon(star(draw, 2 * unit)),
    lambda draw, unit: RegularPolygon(
        sides=int(draw.choice([3, 4, 5, 6, 8, 12, 50])), apothem=unit * draw.uniform(0.5, 1.5), rotation=angle(draw)
    ),
)

ZONES = (
    lambda draw, reach, name: Disc(
        center=point(draw, reach), radius=draw.uniform(0.1, 0.6) * reach, color=colour(draw), name=name
    ),
    lambda draw, reach, name: Ring(
        center=point(draw, reach),
        inner_radius=draw.uniform(0.01, 0.5) * reach,
        radius=draw.uniform(0.5, 1) * reach,
        color=colour(draw),
        name=name,
    ),
    lambda draw, reach, name: Rectangle(
        center=point(draw, reach), size=size(draw, reach), angle=angle(draw), color=colour(draw), name=name
    ),
    lambda draw, reach, name: HalfPlane(
        point=point(draw, reach), normal=point(draw, reach), color=colour(draw), name=name
    ),
    lambda draw, reach, name: polygon(
        star(draw, reach) + point(draw, 0.5 * reach), PolygonZone, color=colour(draw), name=name
    ),
    lambda draw, reach, name: Tiles(
        centers=tuple(point(draw, reach) for _ in range(3)),
        size=0.3 * reach,
        colors={"black": 1, "blue": 2},
        name=name,
    ),
)

DYNAMICS = {
    "schedule": lambda draw, reach: {
        "zones": zones_of(draw, 1),
        "times": tuple(np.cumsum(draw.uniform(0.1, 1, 3)).tolist()),
        "colors": (colour(draw), colour(draw), colour(draw)),
        "every": maybe(draw, lambda: draw.uniform(2, 4)),
    },
    "drawn_colors": lambda draw, reach: {
        "zones": zones_of(draw, 1),
        "colors": (colour(draw), colour(draw)),
        "latest": draw.uniform(0, 3),
    },
    "visited": lambda draw, reach: {
        "zones": zones_of(draw, 1),
        "color": colour(draw),
        "lasts": maybe(draw, lambda: draw.uniform(0.1, 2)),
    },
}

OBJECTIVES = {
    "cell_age": lambda draw, reach: {"side": 2 * reach, "cells": int(draw.integers(1, 40))},
    "cells_visited": lambda draw, reach: {"side": reach, "cells": int(draw.integers(1, 40))},
    "surface_and_perimeter": lambda draw, reach: {
        "square_center": point(draw, reach),
        "square_side": reach,
        "circle_center": point(draw, reach),
        "circle_radius": 0.3 * reach,
    },
    "surface_distance": lambda draw, reach: {"square_center": point(draw, reach), "square_side": reach},
    "coverage_outside_zones": lambda draw, reach: {"zones": zones_of(draw, 1), "radius": reach},
    "pair_distance": lambda draw, reach: {},
    "nearest_distance": lambda draw, reach: {},
    "path_length": lambda draw, reach: {},
    "distance_to": lambda draw, reach: {"point": point(draw, reach)},
    "network_area": lambda draw, reach: {"link": draw.uniform(0.1, 1) * reach, "sight": 0.25, "radius": 0.5},
    "network_share": lambda draw, reach: {"zones": zones_of(draw, 1), "link": 0.5 * reach, "radius": 0.5},
    "network_diameter": lambda draw, reach: {"link": draw.uniform(0.1, 1) * reach},
    "robots_in_zone": lambda draw, reach: {"zones": zones_of(draw, 1), "when": when(draw), "share": True},
    "robots_in_fullest_zone": lambda draw, reach: {"zones": zones_of(draw, 2), "when": when(draw)},
    "robots_in_emptiest_zone": lambda draw, reach: {"zones": zones_of(draw, 2), "when": when(draw)},
    "color_value": lambda draw, reach: {"values": {"black": 1.0, colour(draw): -2.0}, "when": when(draw)},
    "zones_in_color": lambda draw, reach: {"zones": zones_of(draw, 1), "color": colour(draw), "when": when(draw)},
    "trips": lambda draw, reach: {"sources": zones_of(draw, 1), "nests": zones_of(draw, 1)},
    "robots_evenly_in_zones": lambda draw, reach: {"zones": zones_of(draw, 2), "when": when(draw)},
    "zone_difference": lambda draw, reach: {"zones": zones_of(draw, 2), "when": when(draw), "share": True},
    "zone_value": lambda draw, reach: {"values": {name: draw.uniform(-2, 2) for name in zones_of(draw, 1)}},
    "gate_crossings": lambda draw, reach: {"width": reach, "center": point(draw, 0.5 * reach), "angle": angle(draw)},
    "seen_area": lambda draw, reach: {"side": 2 * reach, "cells": 50, "every": int(draw.integers(5, 20))},
    "stop_when_found": lambda draw, reach: {"zones": zones_of(draw, 1)},
    "stop_when_told": lambda draw, reach: {"signal": "a", "color": colour(draw)},
    "robots_where_told": lambda draw, reach: {"signal": "a", "places": {"black": "b", colour(draw): "a"}},
}


def random_call(draw, kind, table, reach, **more):
    """A dynamic or an objective; of zones that are not on the floor, it is not valid."""
    name = one_of(draw, tuple(table))
    return kind(name=name, parameters=table[name](draw, reach), **more)


def zones_of(draw, least):
    return tuple(sorted(str(name) for name in draw.permutation(list("abc"))[: draw.integers(least, 3)]))


def when(draw):
    return one_of(draw, ("end", "always"))


def random_box(draw, reach):
    return Box(center=point(draw, reach), size=size(draw, 0.4 * reach), angle=angle(draw), height=height(draw))


def random_light(draw, reach, robots):
    return Light(
        position=(*point(draw, 2 * reach), draw.uniform(0, 1)),
        intensity=draw.uniform(0, 5) * draw.integers(2),
        kind=one_of(draw, (None, "lamp", "beacon")),
        seen_by=maybe(draw, lambda: (int(draw.integers(robots)),)),
    )


REGIONS = (
    lambda draw, reach, **more: DiscPlacement(
        center=point(draw, 0.5 * reach), radius=draw.uniform(0.2, 1) * reach, **more
    ),
    lambda draw, reach, **more: DiscPlacement(
        inner_radius=draw.uniform(0, 0.3) * reach, radius=reach, uniform_in="radius", **more
    ),
    lambda draw, reach, **more: RectanglePlacement(center=point(draw, 0.5 * reach), size=size(draw, 2 * reach), **more),
)


def random_placement(draw, reach, robots):
    cells = draw.permutation(16)[:robots]
    places = 0.35 * reach * np.column_stack([cells % 4 - 1.5, cells // 4 - 1.5])
    poses = np.column_stack([places, draw.uniform(-4, 4, robots)])
    poses = tuple(map(tuple, poses.tolist()))
    if draw.random() < 0.25:
        return FixedPlacement(poses=poses)
    more = {
        "heading": one_of(draw, ("uniform", "uniform", angle(draw))),
        "half_plane": maybe(draw, lambda: HalfPlaneLimit(point=point(draw, 0.5 * reach), normal=point(draw, 1))),
        "waiting": one_of(draw, ((), poses)),
    }
    if draw.random() < 0.33:
        regions = (one_of(draw, REGIONS)(draw, reach) for _ in range(draw.integers(1, 4)))
        return DrawnPlacement(regions=tuple(regions), **more)
    return one_of(draw, REGIONS)(draw, reach, **more)


def random_pfsm(draw, model):
    flavour = "watermelon" if model.light is None else one_of(draw, FLAVOURS)
    configuration = pfsms(flavour).build(lambda parameter, bounds: parameter.quantile(draw.random(), bounds))
    return to_pfsm(configuration, flavour)


def random_robot(draw):
    """A shipped robot, each part of which is perhaps another."""
    model = shipped_robot(one_of(draw, tuple(shipped.robot_models())))
    for change in CHANGES:
        if draw.random() < 0.3:
            model = replace(model, **change(draw, model))
    return model


def another_body(draw, model):
    length, width = pair(draw, 0.1, 0.4)
    common = {"mass": draw.uniform(0.5, 5), "friction": draw.random(), "elasticity": 0.5 * draw.random()}
    common["height"] = height(draw)
    box = draw.random() < 0.7
    return {
        "body": BoxBody(length=length, width=width, **common) if box else DiscBody(radius=0.5 * width, **common),
        "drive": Drive(
            tread_distance=draw.uniform(0.5, 1) * width,
            maximum_speed=draw.uniform(0.05, 0.5),
            force=draw.uniform(0.5, 10),
            torque=draw.uniform(0.5, 10),
            noise=noise(draw, 0.1),
        ),
        "vary": None,  # not every noise has what it names
    }


def physics(draw, _model):
    step, iterations = draw.uniform(0.002, 0.02), int(draw.integers(5, 20))
    rounding = one_of(draw, (0.0, draw.uniform(0.0, 0.004)))
    return {"physics": Physics(time_step=step, solver_iterations=iterations, corner_radius=rounding)}


def neighbours_by_lidar(draw, _model):
    lidar = Lidar(
        beams=int(draw.integers(8, 720)),
        first_angle=angle(draw),
        height=height(draw),
        ring_radius=draw.uniform(0, 0.05),
        head_radius=one_of(draw, (0.0, 0.035)),
        noise=noise(draw, 0.02),
    )
    return {"neighbours": LidarNeighbours(), "lidar": lidar, "vary": None}


def camera(draw, _model):
    device = Neighbours(
        range=draw.uniform(0, 3),
        height=one_of(draw, (0.0, height(draw))),
        occlusion=bool(draw.integers(2)),
        loss=draw.random(),
        noise=noise(draw, 1),
    )
    return {"neighbours": device, "vary": None}


def light(draw, _model):
    common = {
        "height": height(draw),
        "range": draw.uniform(0, 5),
        "occlusion": bool(draw.integers(2)),
        "noise": noise(draw, 1),
    }
    ring = LightRing(angles=tuple(draw.uniform(-4, 4, draw.integers(1, 9)).tolist()), **common)
    return {"light": one_of(draw, (None, ring, LightCamera(**common)))}


def constants(draw, model):
    changed = model.reference_model._replace(
        neighbour_memory=float(draw.integers(10)),
        neighbour_repeats=float(draw.integers(2)),
        neighbour_count_memory=float(draw.integers(10)),
        neighbour_obstacle_range=draw.uniform(0, 1) * draw.integers(2),
        neighbour_gap=draw.uniform(0, 0.3),
        cluster_points=float(draw.integers(8)),
        ground_vote_cycles=float(draw.integers(7)),
        ground_majority=float(draw.integers(10)),
        strength_step=float(draw.integers(2)),
        weakest_pull=draw.uniform(0.01, 0.5),
        light_threshold=draw.random(),
    )
    votes = changed.ground_vote_cycles > 0.0
    return {"reference_model": changed, "ground": replace(model.ground, labels=None) if votes else model.ground}


def blind(_draw, model):
    """It never turns away from obstacles, but pushes."""
    return {"reference_model": model.reference_model._replace(obstacle_threshold=2.0)}


def ground(draw, model):
    positions = tuple(point(draw, 0.1) for _ in range(draw.integers(1, 5)))
    gray = bool(draw.integers(2))
    without_colours = gray or model.reference_model.ground_vote_cycles > 0.0
    labels = None if without_colours else one_of(draw, (None, "floor", ("black", "red")))
    changed = replace(model.ground, positions=positions, gray=gray, labels=labels, noise=noise(draw, 20))
    return {"ground": changed, "vary": None}


def proximity(draw, model):
    return {"proximity": replace(model.proximity, noise=noise(draw, 0.1), weight_noise=noise(draw, 0.5)), "vary": None}


def vary(draw, model):
    values = {
        "body.mass": model.body.mass,
        "body.friction": model.body.friction,
        "drive.maximum_speed": model.drive.maximum_speed,
        "drive.tread_distance": model.drive.tread_distance,
        "reference_model.neighbour_range": model.reference_model.neighbour_range,
    }
    return {
        "vary": {key: (draw.uniform(0.7, 1) * value, draw.uniform(1, 1.3) * value) for key, value in values.items()}
    }


CHANGES = (
    another_body,
    physics,
    camera,
    neighbours_by_lidar,
    light,
    constants,
    blind,
    ground,
    proximity,
    vary,
)


def noise(draw, most):
    return one_of(draw, (None, Gaussian(sd=most * draw.random()), Uniform(half_width=most * draw.random())))


def colour(draw):
    return one_of(draw, (*COLOURS, (10, 200, 100)))


def height(draw):
    """[m] Lower and higher than robots, their sensors and walls are by default."""
    return draw.uniform(0.01, 0.3)


def angle(draw):
    return draw.uniform(-4, 4)


def size(draw, most):
    return pair(draw, 0.01, most)


def point(draw, reach):
    return pair(draw, -reach, reach)


def pair(draw, low, high):
    return float(draw.uniform(low, high)), float(draw.uniform(low, high))


def one_of(draw, table):
    return table[draw.integers(len(table))]


def maybe(draw, make):
    return make() if draw.random() < 0.3 else None


def several(draw, most, make):
    return tuple(make() for _ in range(draw.integers(most + 1)))
