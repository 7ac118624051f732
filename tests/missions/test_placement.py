"""Where robots start. The statistical tests use a fixed seed; the chance of failing by luck is stated."""

import math
from dataclasses import replace

import numpy as np
import pytest

from mercator_design import seeds
from mercator_design.config.schema import FieldError
from mercator_design.missions.arena import Arena, RegularPolygon
from mercator_design.missions.mission import load_mission
from mercator_design.missions.placement import (
    DiscPlacement,
    DrawnPlacement,
    FixedPlacement,
    HalfPlaneLimit,
    RectanglePlacement,
    candidates,
    covers,
    outside,
)
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.world import World

RNG = seeds.generator(1, "test")
N = 20_000
FIVE_SIGMA = 5.5  # two-sided chance 4e-8 for a mean of N draws


def drawn(placement):
    rng = seeds.generator(7, "placement")
    return candidates(placement, rng, 0, N)


def assert_uniform(values, low, high):
    """Mean and mean square of uniform draws, each within 5.5 standard errors."""
    u = (values - low) / (high - low)
    assert u.min() >= 0.0
    assert u.max() <= 1.0
    assert abs(u.mean() - 1 / 2) < FIVE_SIGMA * math.sqrt(1 / 12 / N)
    assert abs((u**2).mean() - 1 / 3) < FIVE_SIGMA * math.sqrt(4 / 45 / N)


@pytest.mark.parametrize("inner", [0.0, 0.7])
def test_a_disc_or_ring_is_filled_evenly(inner):
    placement = DiscPlacement(center=(0.5, -1.0), radius=1.2, inner_radius=inner)
    poses = drawn(placement)
    x, y = poses[:, 0] - 0.5, poses[:, 1] + 1.0
    assert_uniform(x**2 + y**2, inner**2, 1.2**2)
    assert_uniform(np.arctan2(y, x) % (2 * math.pi), 0.0, 2 * math.pi)
    assert_uniform(poses[:, 2], 0.0, 2 * math.pi)


def test_a_disc_or_ring_may_be_filled_evenly_by_radius():
    """As SCAaround of NEATvsEvo: the radius is uniform, so the density is not."""
    poses = drawn(DiscPlacement(radius=1.2, inner_radius=0.35, uniform_in="radius"))
    assert_uniform(np.hypot(poses[:, 0], poses[:, 1]), 0.35, 1.2)
    assert_uniform(np.arctan2(poses[:, 1], poses[:, 0]) % (2 * math.pi), 0.0, 2 * math.pi)


def test_one_of_several_regions():
    discs = tuple(DiscPlacement(center=(x, 0.0), radius=0.3, uniform_in="radius") for x in (-0.8, 0.8))
    poses = drawn(DrawnPlacement(regions=discs))
    right = poses[:, 0] > 0.0
    assert abs(right.mean() - 0.5) < FIVE_SIGMA * math.sqrt(0.25 / N)
    assert_uniform(poses[:, 2], 0.0, 2 * math.pi)
    from_center = np.hypot(poses[:, 0] - np.where(right, 0.8, -0.8), poses[:, 1])
    assert_uniform(from_center, 0.0, 0.3)
    with pytest.raises(FieldError, match=r"regions\[1\].heading: expected beside the regions"):
        DrawnPlacement(regions=(discs[0], DiscPlacement(radius=1.0, heading=0.0)))


def test_a_half_plane_lets_only_its_side_through_and_moves_nobody():
    free = DiscPlacement(radius=1.0)
    limited = DiscPlacement(radius=1.0, half_plane=HalfPlaneLimit(point=(0.0, 0.15), normal=(0.0, 2.0)))
    all_poses = drawn(free)
    assert np.array_equal(drawn(limited), all_poses[all_poses[:, 1] >= 0.15])
    with pytest.raises(FieldError, match="normal: expected a direction"):
        HalfPlaneLimit(point=(0.0, 0.0), normal=(0.0, 0.0))


RING = DiscPlacement(center=(1.0, 0.0), radius=0.5, inner_radius=0.2)
BAR = RectanglePlacement(center=(-1.0, 0.5), size=(0.2, 1.0))
UPPER = HalfPlaneLimit(point=(0.0, 0.1), normal=(0.0, 1.0))


@pytest.mark.parametrize(
    ("placement", "points"),
    [
        (RING, {(1.3, 0.0): True, (1.0, -0.45): True, (1.1, 0.0): False, (1.4, 0.4): False, (0.0, 0.0): False}),
        (BAR, {(-1.05, 0.95): True, (-0.95, 0.05): True, (-0.85, 0.5): False, (-1.0, 1.05): False}),
        (DrawnPlacement(regions=(RING, BAR)), {(1.3, 0.0): True, (-1.05, 0.95): True, (0.0, 0.0): False}),
        (replace(RING, half_plane=UPPER), {(1.0, 0.3): True, (1.0, -0.3): False, (1.0, 0.15): False}),
    ],
)
def test_what_a_placement_covers(placement, points):
    assert covers(placement, np.array(list(points))).tolist() == list(points.values())
    assert covers(placement, drawn(placement)[:, :2]).all()


def test_a_rectangle_is_filled_evenly():
    placement = RectanglePlacement(center=(1.0, 2.0), size=(0.4, 3.0))
    poses = drawn(placement)
    assert_uniform(poses[:, 0], 0.8, 1.2)
    assert_uniform(poses[:, 1], 0.5, 3.5)
    assert_uniform(poses[:, 2], 0.0, 2 * math.pi)


def test_a_fixed_heading_moves_no_robot():
    free = DiscPlacement(radius=1.0)
    fixed = DiscPlacement(radius=1.0, heading=0.25)
    for seed in range(5):
        x, y, _ = candidates(free, seeds.generator(seed, "placement"), 0, 1)[0]
        assert candidates(fixed, seeds.generator(seed, "placement"), 0, 1).tolist() == [[x, y, 0.25]]


def test_fixed_poses_belong_to_robots_by_number():
    placement = FixedPlacement(poses=((0.0, 1.0, 2.0), (3.0, 4.0, 5.0)))
    assert [tuple(candidates(placement, RNG, robot, 5)[0]) for robot in (1, 0, 1)] == [
        (3.0, 4.0, 5.0),
        (0.0, 1.0, 2.0),
        (3.0, 4.0, 5.0),
    ]


def test_a_ring_needs_width():
    with pytest.raises(FieldError, match="inner_radius: expected less than the radius, 1 m"):
        DiscPlacement(radius=1.0, inner_radius=1.0)


def test_waiting_robots_block_their_places_until_it_is_their_turn():
    """As in the original: robots not yet placed stand where its file put them. Mercators are 0.286 m wide."""

    def starts(*overrides):
        mission = load_mission("aggregation", ["robots=2", "placement.radius=0.3", *overrides])
        world = World(mission, load_robot_model("mercator"))
        return np.array([world.instance(seed).swarm.poses[:, :2] for seed in range(200)])

    free, waiting = starts(), starts("placement.waiting=[[0, 0, 0], [0.1, 0, 0]]")
    assert np.hypot(free[:, 0, 0] - 0.1, free[:, 0, 1]).min() < 0.1
    assert np.hypot(waiting[:, 0, 0] - 0.1, waiting[:, 0, 1]).min() > 0.286
    second = np.hypot(waiting[:, 1, 0] - 0.1, waiting[:, 1, 1])
    assert second.min() < 0.286  # its own place is free to itself, and the first robot's is so when it has gone


@pytest.mark.parametrize(
    ("placement", "field"),
    [
        (DiscPlacement(radius=1.2), None),
        (DiscPlacement(radius=0.1, center=(1.2, 1.2)), "center"),
        (DiscPlacement(radius=0.2, center=(1.05, 0.0)), None),
        (DiscPlacement(radius=3.0, inner_radius=1.5), "center"),
        (RectanglePlacement(size=(9.0, 0.1)), None),
        (DiscPlacement(radius=1.2, half_plane=HalfPlaneLimit(point=(0.0, 1.1), normal=(0.0, 1.0))), "half_plane"),
        (DiscPlacement(radius=1.2, half_plane=HalfPlaneLimit(point=(0.0, 0.5), normal=(0.0, 1.0))), None),
        (DrawnPlacement(regions=(DiscPlacement(radius=0.1), DiscPlacement(radius=0.1, center=(5.0, 0.0)))), None),
        (DrawnPlacement(regions=(DiscPlacement(radius=0.1, center=(5.0, 0.0)),)), "regions"),
        (RectanglePlacement(size=(1.0, 1.0), center=(2.0, 0.0)), "center"),
        (FixedPlacement(poses=((0.0, 0.0, 0.0), (0.9, 0.0, 0.0))), None),
        (FixedPlacement(poses=((0.0, 0.0, 0.0), (1.1, 0.0, 0.0))), "poses[1]"),
    ],
)
def test_a_placement_beyond_the_walls(placement, field):
    assert outside(placement, Arena(walls=RegularPolygon(sides=4, apothem=1.0))) == field
