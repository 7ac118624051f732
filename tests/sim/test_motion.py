"""How robots move: the original's law where nothing touches, and what contacts may do."""

import dataclasses
import functools
import math

import numpy as np
import pymunk
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.errors import MissionError
from mercator_design.fsm import parse
from mercator_design.missions.arena import Arena, Box, Polygon, RegularPolygon
from mercator_design.sim.kernels.overlaps import PlacedBody, box_overlap
from mercator_design.sim.placing import first_free
from mercator_design.sim.referee import Referee
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import Drive, Gaussian
from mercator_design.sim.simulate import Simulator
from tests.sim.worlds import at, mission, simulator

pytestmark = pytest.mark.together("kernels")  # compiled once

MERCATOR = load_robot_model("mercator")
BLIND = dataclasses.replace(MERCATOR, reference_model=MERCATOR.reference_model._replace(obstacle_threshold=2.0))
EXPLORE = parse("--nstates 1 --s0 0 --rwm0 20")
WANDER = parse(
    "--nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 5 --p0x0 0.1 "
    "--s1 3 --rep1 5 --n1 1 --n1x0 0 --c1x0 5 --p1x0 0.1"
)


def room(vertices, model, **given):
    """A simulator in walls from corner to corner."""
    arena = Arena(walls=Polygon(vertices=tuple(vertices)))
    return Simulator(dataclasses.replace(mission(**given), arena=arena), model)


def law(start, commands, sub_steps=10, period=0.1, inertia=2.0 * (0.286**2 + 0.286**2) / 12):
    """Contact-free motion as measured from ARGoS: position first, then velocity within 0.75 m/s2 and 55 rad/s2."""
    x, y, heading = start
    vx = vy = turn = 0.0
    dt = period / sub_steps
    poses = [(x, y, heading)]
    for left, right in commands:
        speed = (left + right) / 2
        goal = speed * math.cos(heading), speed * math.sin(heading), (right - left) / 0.147
        for _ in range(sub_steps):
            x, y, heading = x + vx * dt, y + vy * dt, heading + turn * dt
            dx, dy = goal[0] - vx, goal[1] - vy
            size, most = math.hypot(dx, dy), 1.5 / 2.0 * dt
            scale = min(1.0, most / size) if size else 1.0
            vx, vy = vx + dx * scale, vy + dy * scale
            most = 1.5 / inertia * dt
            turn += max(-most, min(most, goal[2] - turn))
        poses.append((x, y, heading))
    return np.array(poses)


@pytest.mark.parametrize("seed", range(4))
def test_contact_free_motion_follows_the_law(seed):
    """A robot that explores for a minute, and turns before it touches a wall."""
    world = simulator(duration=60, apothem=1.5, placement=at((0, 0, 0.1)))
    outcome = world.run(EXPLORE, seed, record=True)
    wheels = 0.3 * outcome.history.wheels[:, 0]
    assert (wheels[:, 0] < 0).sum() > 50  # it did turn
    # A command moves the robot one cycle later; nothing moves in the first.
    expected = law(outcome.trace.poses[0, 0], np.vstack([[0, 0], wheels[:-1]]))
    assert np.abs(outcome.trace.poses[:, 0] - expected).max() < 1e-9


def test_a_model_may_say_its_moment_of_inertia():
    """Twenty times that of the box: the robot turns so much more slowly, and Chipmunk's body has it too."""
    inertia = 20 * MERCATOR.body.moment_of_inertia
    model = dataclasses.replace(MERCATOR, body=dataclasses.replace(MERCATOR.body, inertia=inertia))
    world = simulator(duration=60, apothem=1.5, placement=at((0, 0, 0.1)), robot_model=model)
    assert world.instance(0).scene.physics.inertia == inertia
    outcome = world.run(EXPLORE, 3, record=True)
    wheels = 0.3 * outcome.history.wheels[:, 0]
    turning = np.flatnonzero(wheels[:, 0] < 0)[:1]
    until = slice(0, int(turning[0]) + 5)
    expected = law(outcome.trace.poses[0, 0], np.vstack([[0, 0], wheels[:-1]]), inertia=inertia)
    assert np.abs(outcome.trace.poses[:, 0] - expected)[until].max() < 1e-9
    light = law(outcome.trace.poses[0, 0], np.vstack([[0, 0], wheels[:-1]]))
    assert np.abs(outcome.trace.poses[:, 0] - light)[until].max() > 0.01


def test_from_rest_to_full_speed():
    """Mean speeds of the first cycles [m/s], as measured from ARGoS beta48 with argos3-rvr."""
    poses = simulator(duration=1, apothem=5, placement=at((0, 0, 0))).run(EXPLORE, 1).trace.poses[:, 0, 0]
    assert np.diff(poses)[:7] / 0.1 == pytest.approx([0, 0.03375, 0.10875, 0.18375, 0.25875, 0.3, 0.3], abs=1e-9)


def test_stop_stops():
    outcome = simulator(robots=5, duration=20).run(parse("--nstates 1 --s0 1"), 4)
    assert np.array_equal(outcome.trace.poses, np.repeat(outcome.trace.poses[:1], 201, axis=0))


@pytest.mark.parametrize("seed", range(4))
def test_crowded_robots_stay_inside_and_apart(seed):
    """Ten robots that push blindly for 30 s.

    Contacts act once bodies overlap, so robots reach into each other by what the fastest corners cover in a sub-step of
    0.01 s: driving at 0.3 m/s and spinning at 4.08 rad/s, 0.202 m from the centre, that is twice 11 mm.
    """
    sides, apothem = 12, 1.226
    trace = simulator(robots=10, duration=30, sides=sides, apothem=apothem, robot_model=BLIND).run(WANDER, seed).trace
    half = 0.143
    offsets = half * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    x, y, heading = np.moveaxis(trace.poses, -1, 0)
    c, s = np.cos(heading)[..., None], np.sin(heading)[..., None]
    corners_x = x[..., None] + c * offsets[:, 0] - s * offsets[:, 1]
    corners_y = y[..., None] + s * offsets[:, 0] + c * offsets[:, 1]
    normals = 2 * math.pi * np.arange(sides) / sides
    beyond = np.max([corners_x * math.cos(a) + corners_y * math.sin(a) for a in normals], axis=0) - apothem
    assert beyond.max() < 0.003
    assert beyond.max() > 0.001  # they did push
    # Corners of one robot within the body of another.
    for i in range(10):
        dx, dy = corners_x - x[:, i, None, None], corners_y - y[:, i, None, None]
        ci, si = c[:, i, None], s[:, i, None]
        depth = half - np.maximum(np.abs(ci * dx + si * dy), np.abs(ci * dy - si * dx))
        depth[:, i] = -1
        assert depth.max() < 0.022
        assert (depth > 0.003).mean() < 0.01


@pytest.mark.parametrize("angle", [0.2, 0.15, 0.05])
def test_pushing_a_wall_keeps_the_heading_and_slides_against_friction(angle):
    """Robot against wall rubs with 0.7 * 0.1; measured in ARGoS: 0.039 m/s at 0.199 rad, and held fast below 0.07."""
    world = simulator(duration=9, sides=4, apothem=1.0, robot_model=BLIND, placement=at((0.6, 0, angle)))
    poses = world.run(EXPLORE, 1).trace.poses[:, 0]
    heading = poses[90, 2]
    assert heading == pytest.approx(angle, abs=0.03)
    assert poses[50, 2] == pytest.approx(heading, abs=1e-6)
    slide = max(0.0, 0.3 * math.sin(heading) - 0.07 * 0.3 * math.cos(heading))
    assert (poses[90, 1] - poses[50, 1]) / 4 == pytest.approx(slide, abs=5e-4)


def test_a_robot_that_has_no_room_to_turn_stays_in_its_corridor():
    """It tries at the end: 0.3 m long, 0.17 m wide, between walls 0.25 m apart, which no way out of both leaves."""
    model = dataclasses.replace(MERCATOR, body=dataclasses.replace(MERCATOR.body, length=0.3, width=0.17))
    walls = [[-1, -0.125], [1, -0.125], [1, 0.125], [-1, 0.125]]
    poses = room(walls, model, duration=60, placement=at((0.5, 0, 0))).run(EXPLORE, 1).trace.poses[:, 0]
    c, s = abs(np.cos(poses[:, 2])), abs(np.sin(poses[:, 2]))
    assert (abs(poses[:, 0]) + 0.15 * c + 0.085 * s).max() < 1.003
    across = abs(poses[:, 1]) + 0.15 * s + 0.085 * c
    assert 0.126 < across.max() < 0.128
    assert np.sum(np.all(np.diff(poses, axis=0) == 0.0, axis=1)) > 5  # it stood still for it


@given(*[st.floats(-0.1, 0.1)] * 2, st.floats(-4, 4), *[st.floats(0.02, 0.3)] * 2, st.floats(-4, 4))
def test_the_way_out_of_a_box_is_the_shortest(x, y, heading, half_length, half_width, direction):
    def depth(x, y):
        box = PlacedBody(x, y, math.cos(heading), math.sin(heading), half_length, half_width)
        return box_overlap(box, PlacedBody(0.01, 0.02, 0.8, 0.6, 0.1, 0.05))

    overlap, out_x, out_y = depth(x, y)
    if overlap > 0:
        assert depth(x + overlap * out_x, y + overlap * out_y)[0] == pytest.approx(0, abs=1e-9)
        shorter = 0.99 * overlap
        assert depth(x + shorter * math.cos(direction), y + shorter * math.sin(direction))[0] > 0


def test_wheel_noise_is_proportional_to_speed():
    drive = Drive(tread_distance=0.147, maximum_speed=0.3, force=1e6, torque=1e6, noise=Gaussian(sd=0.1))
    model = dataclasses.replace(MERCATOR, drive=drive)
    poses = simulator(duration=500, apothem=900, robot_model=model, placement=at((0, 0, 0))).run(EXPLORE, 1).trace.poses
    steps = np.linalg.norm(np.diff(poses[5:, 0, :2], axis=0), axis=1) / 0.1
    # Mean of two treads: sd 0.3 * 0.1 / sqrt(2); a tenth of each step is still at the speed before. 5000 steps; six
    # standard errors.
    sd = 0.03 / math.sqrt(2) * math.hypot(0.1, 0.9)
    assert steps.mean() == pytest.approx(0.3, abs=6 * sd / math.sqrt(len(steps)) + 2e-3)
    assert steps.std() == pytest.approx(sd, rel=6 / math.sqrt(2 * len(steps)))


def test_robots_touch_nothing_before_they_have_made_a_step_in_the_space(monkeypatch):
    """In no step of crowded runs a robot comes to overlap a wall or robot if it is not in the space, or new there."""
    poses, close = [], []
    step = Referee.step

    def noted(referee):
        step(referee)
        referee.read()
        poses.append(referee.swarm.poses[:, :3].copy())
        close.append(referee.swarm.close.astype(bool))

    monkeypatch.setattr(Referee, "step", noted)
    world = simulator(robots=8, duration=30, robot_model=BLIND)
    free = new = touching = 0
    for seed in range(3):
        poses.clear()
        close.clear()
        world.run(WANDER, seed, referee=True)
        settled, now = np.array(close[:-1]), np.array(close[1:])
        beyond, depth = beyond_walls(np.array(poses)), overlaps(np.array(poses))
        touching += np.sum(beyond[1:][now] > 0)
        free += np.sum(~now)
        new += np.sum(now & ~settled)
        others = ~(settled & now)
        assert (beyond[1:] - np.maximum(0.0, beyond[:-1]))[others].max() <= 1e-9
        deeper = depth[1:] - np.maximum(0.0, depth[:-1])
        deeper[:, range(8), range(8)] = 0.0  # of a robot and itself
        assert deeper[others].max() <= 1e-9
    assert min(free, new, touching) > 100  # there was something to see of each


def beyond_walls(poses):
    """How far [m] the outermost corner of robots (..., 3) lies beyond the dodecagon's walls; negative if within."""
    x, y, heading = np.moveaxis(poses[..., None, :], -1, 0)
    normals = 2 * math.pi * np.arange(12) / 12
    extent = 0.143 * (np.abs(np.cos(normals - heading)) + np.abs(np.sin(normals - heading)))
    return (x * np.cos(normals) + y * np.sin(normals) + extent).max(axis=-1) - 1.226


def overlaps(poses):
    """How deep boxes (..., n, 3) overlap [m], along the axis that separates a pair best; negative if apart."""
    x, y, turn = np.moveaxis(poses[..., None, :, :] - poses[..., :, None, :], -1, 0)
    c, s = np.cos(poses[..., 2, None]), np.sin(poses[..., 2, None])
    half = 0.143 * (1 + np.abs(np.cos(turn)) + np.abs(np.sin(turn)))
    depths = half - np.maximum(np.abs(c * x + s * y), np.abs(c * y - s * x))  # along the axes of the first
    return np.minimum(depths, np.swapaxes(depths, -1, -2))


@pytest.mark.parametrize(
    ("walls", "words"),
    [
        ([[-1, -1], [1, -1], [1, 1], [0.004, 1], [0.004, 0], [-0.004, 0], [-0.004, 1], [-1, 1]], "thick"),
        ([[-1, -1], [1, -1], [1, 1], [0.2, 1], [0, 0], [-0.2, 1], [-1, 1]], "sharp"),
    ],
)
def test_walls_too_thin_to_stand_between_two_places_are_refused(walls, words):
    with pytest.raises(MissionError, match=words):
        room(walls, MERCATOR)


def test_a_partition_stands_where_the_robot_sees_it():
    """A notch of 0.04 m in the outer wall: a blind robot stops at its face."""
    walls = [[-1, -1], [1, -1], [1, 1], [0.02, 1], [0.02, -0.5], [-0.02, -0.5], [-0.02, 1], [-1, 1]]
    x = room(walls, BLIND, duration=8, placement=at((0.7, 0, math.pi))).run(EXPLORE, 1).trace.poses[-1, 0, 0]
    assert x == pytest.approx(0.163, abs=0.003)


def test_steps_too_coarse_for_the_robot_are_refused():
    fast = dataclasses.replace(MERCATOR, drive=dataclasses.replace(MERCATOR.drive, maximum_speed=30.0))
    with pytest.raises(MissionError, match="time_step"):
        simulator(robot_model=fast)


def test_fixed_poses_that_touch_are_named():
    with pytest.raises(MissionError, match=r"placement.poses\[1\]"):
        simulator(robots=2, placement=at((0, 0, 0), (0.1, 0, 0))).run(EXPLORE, 1)


@functools.cache
def pentagon():
    room = simulator(sides=5, apothem=0.9, obstacles="[{center: [0.2, 0.1], size: [0.3, 0.2], angle: 0.5}]")
    return room.instance(0).scene


@given(
    st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-4, 4)), min_size=2, max_size=5),
    st.floats(0.01, 0.5),
    st.floats(0.01, 0.5),
    st.booleans(),
)
def test_a_place_is_free_where_pymunk_finds_nothing(poses, half_length, half_width, round_):
    """The first poses are taken, the last one is tried, in a room with a box."""
    scene = pentagon()
    rows = np.array([[x, y, math.cos(heading), math.sin(heading)] for x, y, heading in poses])
    n = len(rows) - 1
    free = first_free(rows[n:], rows[:n], scene.walls, scene.boxes, half_length, half_width, round_)

    def shape_of(body, slack):
        if round_:
            return pymunk.Circle(body, half_length + 0.5 * slack)
        return pymunk.Poly.create_box(body, (2 * half_length + slack, 2 * half_width + slack))

    space = pymunk.Space()
    for x, y, heading in poses[:n]:
        body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        body.position, body.angle = (x, y), heading
        space.add(body, shape_of(body, 0.0))
    for wall in scene.walls.tolist():
        space.add(pymunk.Segment(space.static_body, wall[:2], (wall[0] + wall[2], wall[1] + wall[3]), 0))
    corners = Box(center=(0.2, 0.1), size=(0.3, 0.2), angle=0.5).corners().tolist()
    space.add(pymunk.Poly(space.static_body, corners))

    def meets(slack):
        body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        body.position, body.angle = poses[n][:2], poses[n][2]
        return bool(space.shape_query(shape_of(body, slack)))

    inside = bool(Arena(walls=RegularPolygon(sides=5, apothem=0.9)).contains(rows[n:, :2])[0])
    if meets(-0.002) or not inside:
        assert free == -1
    elif not meets(0.002):
        assert free == 0
