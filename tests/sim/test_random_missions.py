"""Random valid missions, robots and PFSMs: nothing crashes, gets lost, leaves the arena, or moves by itself."""

import dataclasses
import itertools
import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from mercator_design.errors import MissionError
from mercator_design.fsm.grammar import parameters_text, to_pfsm
from mercator_design.fsm.pfsm import FLAVOURS
from mercator_design.loading import FieldError
from mercator_design.missions.arena import Arena, Box, Light, Polygon, RegularPolygon
from mercator_design.missions.floor import Disc, Floor, Rectangle, Tiles
from mercator_design.missions.mission import Mission, Objective
from mercator_design.missions.placement import DiscPlacement, FixedPlacement, RectanglePlacement
from mercator_design.race import Space
from mercator_design.sim.robot_model import BoxBody, DiscBody, Drive, Gaussian, Physics, Uniform, load_robot_model
from mercator_design.sim.simulate import Simulator

ROBOTS = [
    dataclasses.replace(load_robot_model(name), physics=Physics())  # some have the original's, which mends no overlaps
    for name in ("mercator", "mercator", "epuck", "mercator-chocolate")
]
PFSMS = {flavour: Space.from_text(parameters_text(flavour), flavour) for flavour in FLAVOURS}
MANY = 100_000


def check(seed):
    """One random experiment, and what must hold in each of its cycles; returns how close it came to the limits."""
    draw = np.random.default_rng(seed)
    while True:
        try:
            simulator = Simulator(random_mission(draw), random_robot(draw))
            pfsm = random_pfsm(draw, simulator.robot_model)
            outcome = simulator.run(pfsm, seed)
            break
        except (FieldError, MissionError):  # walls that cross, no room for the robots, and so on
            continue
    trace, mission, body = outcome.trace, simulator.mission, simulator.robot_model.body
    assert math.isfinite(outcome.score)
    assert np.isfinite(trace.poses).all()
    if seed % 10 == 0:
        assert np.array_equal(trace.poses, simulator.run(pfsm, seed, referee=True).trace.poses)
    poses = trace.poses.reshape(-1, 3)
    assert mission.arena.contains(poses[:, :2]).all()
    inside_walls = depth_in_walls(poses, body, mission.arena)
    assert inside_walls < 0.003
    step = mission.control_period / math.ceil(mission.control_period / simulator.robot_model.physics.time_step)
    inside_robots = depth_in_robots(trace, body) / (2.0 * simulator.robot_model.fastest * step)
    assert inside_robots < 1.0
    speed = speed_share(trace, simulator.robot_model)
    assert speed < 2.0
    return inside_walls, inside_robots, speed


def test_random_missions():
    with ThreadPoolExecutor(2) as pool:
        inside_walls, inside_robots, speed = np.max(list(pool.map(check, range(200))), axis=0)
    assert inside_walls > 0.0019  # they did push
    assert min(inside_robots, speed) > 0.2


@pytest.mark.slow
def test_many_random_missions():
    with ThreadPoolExecutor() as pool:
        for start in range(200, MANY, 1000):
            list(pool.map(check, range(start, min(start + 1000, MANY))))


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


def random_mission(draw):
    walls = random_walls(draw)
    reach = np.abs(walls.corners()).max()
    room = Arena(walls=walls).area / 0.5  # more would seldom fit, and to find that out takes long
    robots = int(draw.integers(1, np.clip(room, 2, 13)))
    boxes = tuple(
        Box(center=point(draw, reach), size=pair(draw, 0.01, 0.5), angle=draw.uniform(-4, 4))
        for _ in range(draw.integers(0, 5) * draw.integers(0, 2))
    )
    period = float(draw.choice([0.05, 0.1, 0.1, 0.1, 0.2]))
    return Mission(
        schema=1,
        name="random",
        robots=robots,
        duration=period * int(draw.integers(10, 50)),
        control_period=period,
        arena=Arena(walls=walls, obstacles=boxes),
        floor=Floor(
            background=random_colour(draw), zones=tuple(random_zone(draw, reach) for _ in range(draw.integers(4)))
        ),
        lights=tuple(random_light(draw, reach) for _ in range(draw.integers(3))),
        placement=random_placement(draw, reach, robots),
        objective=random_objective(draw),
    )


def random_walls(draw):
    kind = draw.integers(4)
    if kind == 0:
        return RegularPolygon(
            sides=int(draw.choice([3, 4, 5, 6, 8, 12, 50])),
            apothem=draw.uniform(0.5, 1.5),
            rotation=draw.uniform(-4, 4),
        )
    if kind == 1:  # any polygon whose corners are all seen from the middle
        n = int(draw.integers(3, 12))
        angles, radii = np.sort(draw.uniform(0, 2 * math.pi, n)), draw.uniform(0.4, 1.8, n)
        vertices = np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])
    elif kind == 2:  # a room with a partition that begins at a wall
        width, height, half = draw.uniform(0.4, 1.5), draw.uniform(0.4, 1.5), draw.uniform(0.011, 0.1)
        end = draw.uniform(-0.9, 0.9) * height
        vertices = [(-width, -height), (width, -height), (width, height), (half, height), (half, end), (-half, end)]
        vertices += [(-half, height), (-width, height)]
    else:  # a corridor in which a robot hardly turns
        width, length, angle = draw.uniform(0.29, 0.6), draw.uniform(0.6, 3), draw.uniform(-4, 4)
        vertices = corners_of(np.array([[0, 0, angle]]), length, width)[0]
    return Polygon(vertices=tuple((float(x), float(y)) for x, y in vertices))


def random_zone(draw, reach):
    kind, colour = draw.integers(3), random_colour(draw)
    if kind == 0:
        return Disc(center=point(draw, reach), radius=draw.uniform(0.1, 0.6), color=colour)
    if kind == 1:
        return Rectangle(center=point(draw, reach), size=pair(draw, 0.1, 1), angle=draw.uniform(-4, 4), color=colour)
    return Tiles(centers=(point(draw, reach), point(draw, reach)), size=0.3, colors={"black": 1, "blue": 1})


def random_light(draw, reach):
    return Light(position=(*point(draw, 2 * reach), draw.uniform(0, 1)), intensity=draw.uniform(0, 5))


def random_placement(draw, reach, robots):
    heading = float(draw.uniform(-4, 4)) if draw.random() < 0.3 else "uniform"
    kind = draw.integers(3)
    if kind == 0:
        return DiscPlacement(center=point(draw, 0.5 * reach), radius=draw.uniform(0.2, 1) * reach, heading=heading)
    if kind == 1:
        return RectanglePlacement(center=point(draw, 0.5 * reach), size=pair(draw, 0.1, 2 * reach), heading=heading)
    cells = draw.permutation(100)[:robots]
    poses = np.column_stack([0.45 * (cells % 10 - 4.5), 0.45 * (cells // 10 - 4.5), draw.uniform(-4, 4, robots)])
    return FixedPlacement(poses=tuple(tuple(pose) for pose in poses.tolist()))


def random_objective(draw):
    return [
        Objective(name="cell_age", direction="minimise", parameters={"side": 2.5, "cells": 10}),
        Objective(name="color_value", direction="maximise", parameters={"values": {"black": 1.0, "white": -1.0}}),
    ][draw.integers(2)]


def random_pfsm(draw, model):
    flavour = "watermelon" if model.light is None else "chocolate"
    configuration = PFSMS[flavour].build(lambda parameter, bounds: parameter.quantile(draw.random(), bounds))
    return to_pfsm(configuration, flavour)


def random_robot(draw):
    """A shipped robot, in every second mission with another body and drive; in every third it is blind, and pushes."""
    model = ROBOTS[draw.integers(len(ROBOTS))]
    if draw.random() < 0.5:
        length, width = pair(draw, 0.1, 0.4)
        common = {"mass": draw.uniform(0.5, 5), "friction": draw.random(), "elasticity": 0.5 * draw.random()}
        box = draw.random() < 0.7
        body = BoxBody(length=length, width=width, **common) if box else DiscBody(radius=0.5 * width, **common)
        drive = Drive(
            tread_distance=draw.uniform(0.5, 1) * width,
            maximum_speed=draw.uniform(0.05, 0.5),
            force=draw.uniform(0.5, 10),
            torque=draw.uniform(0.5, 10),
            noise=random_noise(draw, 0.1),
        )
        proximity = dataclasses.replace(model.proximity, noise=random_noise(draw, 0.1))
        ground = dataclasses.replace(model.ground, noise=random_noise(draw, 20))
        physics = Physics(time_step=draw.uniform(0.005, 0.02), solver_iterations=int(draw.integers(5, 20)))
        model = dataclasses.replace(model, body=body, drive=drive, proximity=proximity, ground=ground, physics=physics)
    if draw.random() < 0.33:
        constants = model.reference_model._replace(obstacle_threshold=2.0)
        model = dataclasses.replace(model, reference_model=constants)
    return model


def random_noise(draw, most):
    if draw.random() < 0.5:
        return None
    return Gaussian(sd=most * draw.random()) if draw.random() < 0.5 else Uniform(half_width=most * draw.random())


def random_colour(draw):
    return str(draw.choice(["black", "white", "gray", "red", "green", "blue"]))


def point(draw, reach):
    return pair(draw, -reach, reach)


def pair(draw, low, high):
    return float(draw.uniform(low, high)), float(draw.uniform(low, high))
