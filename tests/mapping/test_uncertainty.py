"""How uncertain poses are: draws against known variances, and against the errors of a simulated map."""

import numpy as np
import pytest

from mercator_design.mapping import poses as motions
from mercator_design.mapping.joint.uncertainty import sampled, uncertainty_of
from mercator_design.mapping.merit.merits import error_of, truth_of
from mercator_design.mapping.plan.plans import plans_of
from mercator_design.mapping.swarm import map_swarm
from tests.mapping import worlds

pytestmark = pytest.mark.together("kernels")  # compiled once

SAMPLES = 4000


def test_a_chain_grows_uncertain():
    """Along x, with a deviation of 1 cm and 0.01 rad a metre: the variances of a random walk with its lever."""
    steps = 5
    poses = np.column_stack([np.arange(steps + 1.0), np.zeros((steps + 1, 2))])
    pairs = np.column_stack([np.arange(1, steps + 1), np.arange(steps)])
    information = np.tile(np.diag([1e4, 1e4, 1e4]), (steps, 1, 1))
    drawn = sampled(poses, pairs, information, SAMPLES, np.random.default_rng(1))
    assert (drawn[:, 0] == 0.0).all()
    number = np.arange(steps + 1)
    heading = number * 1e-4
    across = number * 1e-4 + 1e-4 * np.array([sum((n - k) ** 2 for k in range(1, n)) for n in number])
    # A variance of 4000 draws errs by sqrt(2 / 4000), 2.2 %: 12 % is more than five times that, in 15 cases (< 1e-6).
    assert drawn[:, :, 0].var(axis=0) == pytest.approx(number * 1e-4, rel=0.12)
    assert drawn[:, :, 1].var(axis=0) == pytest.approx(across, rel=0.12)
    assert drawn[:, :, 2].var(axis=0) == pytest.approx(heading, rel=0.12)


def test_directions_that_nothing_holds_do_not_move():
    """A corridor: its factor says nothing of the place along it, and a draw does not run away."""
    information = np.diag([0.0, 1e4, 1e4])[np.newaxis]
    drawn = sampled(np.zeros((2, 3)), np.array([[1, 0]]), information, 100, np.random.default_rng(1))
    assert np.isfinite(drawn).all()
    assert np.abs(drawn[:, 1, 0]).max() < 1e-6
    assert 0.005 < drawn[:, 1, 1].std() < 0.02


def test_what_all_keyframes_share_is_no_uncertainty_of_the_map():
    parts = [np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 1.0], [1.0, 1.0, 1.0]])]
    moved = np.random.default_rng(2).normal(0.0, 0.01, (50, 1, 3)) * (1.0, 1.0, 0.0)
    turned = [motions.rotate(-heading, moved[:, 0, :2]) for heading in (0.0, 0.0, 1.0, 1.0)]
    together = np.stack([np.column_stack([one, np.zeros(50)]) for one in turned], axis=1)
    found = uncertainty_of(parts, together)
    assert np.abs(np.concatenate(found.keyframes)).max() < 1e-12
    assert np.abs(found.frames).max() < 1e-12


def test_a_robot_whose_frame_is_loose():
    """The second part moves by itself, by 1 cm along x; the first one is the reference."""
    parts = [np.zeros((1, 3)), np.zeros((0, 3)), np.array([[0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])]
    drawn = np.zeros((SAMPLES, 3, 3))
    drawn[:, 1:, 0] = np.random.default_rng(3).normal(0.0, 0.01, SAMPLES)[:, np.newaxis]
    found = uncertainty_of(parts, drawn)
    assert [len(one) for one in found.keyframes] == [1, 0, 2]
    assert found.frames[2, 0, 0] == pytest.approx(1e-4, rel=0.15)
    assert not found.frames[:2].any()
    assert found.frames[2, 1, 1] == found.frames[2, 2, 2] == 0.0


@pytest.mark.thorough
def test_regions_of_95_percent_hold_nearly_all_keyframes():
    """Of two robots in a dodecagon: the truth is in the ellipsoid of at least 85 % of their keyframes."""
    generator = np.random.default_rng(5)
    ways = [worlds.Curve(generator, (0.2 * k, 0.0), (0.6, 0.6)) for k in range(2)]
    logs = [worlds.drifting_log(ways, k, worlds.polygon(12, 1.25), 60.0, 5) for k in range(2)]
    plan = plans_of(map_swarm(logs, clock_search=0.0))[0]
    alignment = error_of(plan.ways, at_keyframes=True).alignment
    inside = []
    for way in plan.ways:
        true = motions.compose(motions.inverse(alignment), truth_of(way, way.keyframe_times))
        apart = way.keyframe_poses - true
        apart[:, 2] = motions.wrap(apart[:, 2])
        squares = np.einsum("ka,kab,kb->k", apart, np.linalg.inv(way.covariances + 1e-12 * np.eye(3)), apart)
        inside.extend(squares < 7.815)
    assert np.mean(inside) > 0.85
    second = plan.ways[1].frame_covariance
    assert 0.0 < np.sqrt(second[0, 0]) < 0.01
    assert not plan.ways[0].frame_covariance[0, 0] > 1e-6
