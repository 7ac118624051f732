"""The joint refinement: factors against finite differences, the solver against a direct one, and drifting robots."""

import math

import numpy as np
import pytest

from mercator_design.jit import compiled
from mercator_design.mapping.joint import kernels
from mercator_design.mapping.joint.pairing import pairs_of_nodes
from mercator_design.mapping.joint.solving import solve
from mercator_design.mapping.poses import between, compose, transform

pytestmark = pytest.mark.together

POSES = np.array([[0.1, 0.2, 0.3], [0.5, -0.3, 2.0], [-0.4, 0.6, -1.5]])
PAIRS = np.array([[1, 0], [2, 0], [1, 2]])


def numerical_gradient(cost, poses, pairs):
    """The negative gradient (m, 3) of half of the cost of each pair to motions of i, and of j moved back."""
    found = np.zeros((len(pairs), 2, 3))
    for side in (0, 1):
        for axis in range(3):
            for m, pair in enumerate(pairs):
                for sign in (1.0, -1.0):
                    moved = poses.copy()
                    small = np.zeros(3)
                    small[axis] = sign * 1e-6
                    moved[pair[side]] = compose(moved[pair[side]], small)
                    found[m, side, axis] -= sign * 0.5 * cost(moved, m) / 2e-6
    return found


def factors_and_sums(fill, *arguments):
    information, gradients = np.zeros((len(PAIRS), 3, 3)), np.zeros((len(PAIRS), 3))
    compiled(fill)(POSES, PAIRS, *arguments, information, gradients)
    return information, gradients


def test_gradients_of_motions():
    motions = between(POSES[PAIRS[:, 1]], POSES[PAIRS[:, 0]]) + np.array([[0.002, 0.001, 0.0005]])
    deviations = np.full((3, 3), 0.1)

    def cost(poses, m):
        i, j = PAIRS[m]
        error = between(motions[m], between(poses[j], poses[i]))
        return float(np.sum((error / deviations[m]) ** 2))

    _, gradients = factors_and_sums(kernels.add_motion_factors, motions, deviations)
    assert gradients == pytest.approx(numerical_gradient(cost, POSES, PAIRS)[:, 0], abs=2e-3)


def test_gradients_of_sightings_with_the_weight_of_a_step():
    heads = np.array([[0.4, 0.1], [0.2, -0.3], [1.0, 0.5]])
    places = np.array(
        [transform(between(POSES[j], POSES[i]), heads[m : m + 1])[0] for m, (i, j) in enumerate(PAIRS)]
    ) + np.array([0.01, -0.005])
    _, gradients = factors_and_sums(kernels.add_sighting_factors, heads, places, 0.015, 1e6)

    def cost(poses, m):
        i, j = PAIRS[m]
        return float(np.sum((transform(between(poses[j], poses[i]), heads[m : m + 1])[0] - places[m]) ** 2)) / 0.015**2

    assert gradients == pytest.approx(numerical_gradient(cost, POSES, PAIRS)[:, 0], rel=1e-4, abs=1e-3)


def square_room(pose, shift=0.0):
    """Points every 2 degrees, and normals, of a room of 2 x 2 m as a robot at a pose sees it."""
    angles = math.radians(1.0) + np.radians(np.arange(-180.0, 180.0, 2.0))
    c, s = np.cos(angles + pose[2]), np.sin(angles + pose[2])
    far = np.minimum(
        np.where(c > 0, 1.0 - pose[0], 1.0 + pose[0]) / np.abs(c),
        np.where(s > 0, 1.0 - pose[1], 1.0 + pose[1]) / np.abs(s),
    )
    world = pose[:2] + far[:, None] * np.column_stack([c, s])
    on_side = np.abs(world[:, 0]) > np.abs(world[:, 1])
    normals = np.where(
        on_side[:, None],
        np.column_stack([-np.sign(world[:, 0]), 0 * c]),
        np.column_stack([0 * c, -np.sign(world[:, 1])]),
    )
    own = (far + shift)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    turned = transform(np.array([0.0, 0.0, -pose[2]]), normals)
    return own.astype(np.float32), turned.astype(np.float32)


def room_seen_from(poses):
    scans = [square_room(pose) for pose in poses]
    points, normals = (np.concatenate([scan[k] for scan in scans]) for k in (0, 1))
    first = np.cumsum([0, *[len(scan[0]) for scan in scans]])
    bins = np.empty((len(poses), kernels.N_BINS + 1), dtype=np.int32)
    for k, (own, _) in enumerate(scans):
        at = np.floor((np.arctan2(own[:, 1], own[:, 0]).astype(float) / (2.0 * math.pi) + 0.5) * kernels.N_BINS)
        assert (np.diff(at) >= 0).all()
        bins[k] = np.searchsorted(at, np.arange(kernels.N_BINS + 1))
    return points, normals, first, bins


def point_factors(poses, pairs, room, gate=0.1, scale=1e6, most=1000, least=0.25):
    information, gradients = np.zeros((len(pairs), 3, 3)), np.zeros((len(pairs), 3))
    held = compiled(kernels.add_point_factors)(
        poses, pairs, *room, most, gate, scale, 0.02, least, np.zeros((10, 3)), information, gradients
    )
    return held, information, gradients


TRUE = np.array([[0.1, 0.2, 0.3], [0.4, -0.3, 2.0], [-0.4, 0.5, -1.5]])


def test_points_pull_to_the_true_pose():
    room = room_seen_from(TRUE)
    error = np.array([0.01, -0.008, 0.006])
    poses = TRUE.copy()
    poses[1] = compose(TRUE[1], error)
    held, information, gradients = point_factors(poses, np.array([[1, 0]]), room)
    assert held == 1
    assert np.linalg.solve(information[0], gradients[0]) == pytest.approx(-error, abs=2e-4)


def test_fewer_points_weigh_as_much():
    room = room_seen_from(TRUE)
    poses = TRUE + np.array([[0.0, 0, 0], [0.01, 0.0, 0.0], [0.0, 0.0, 0.0]])
    _, every, _ = point_factors(poses, np.array([[1, 0]]), room)
    _, some, _ = point_factors(poses, np.array([[1, 0]]), room, most=60)
    assert np.trace(some[0]) == pytest.approx(np.trace(every[0]), rel=0.1)


def test_pairs_with_few_matches_have_no_factor():
    poses = TRUE + np.array([[0.0, 0, 0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    held, information, gradients = point_factors(poses, np.array([[1, 0]]), room_seen_from(TRUE), gate=0.02)
    assert held == 0
    assert not information.any()
    assert not gradients.any()


def test_a_single_wall_leaves_a_direction_open():
    room = list(room_seen_from(TRUE[:2] * [1.0, 1.0, 0.0]))
    poses = TRUE[:2] * [1.0, 1.0, 0.0]
    for k in range(2):  # only the points of the wall at y = 1
        own = slice(room[2][k], room[2][k + 1])
        away = np.abs(room[1][own][:, 1] + 1.0) > 1e-3
        room[1][own][away] = 0.0
    held, information, _ = point_factors(poses, np.array([[1, 0]]), room, least=0.1)
    assert held == 1
    values = np.linalg.eigvalsh(information[0])
    assert abs(values[0]) < 1e-6 * values[2]


def dense(poses, pairs, information, gradients):
    """The normal equations of all poses but the first one, by the definition of the factors."""
    k = len(poses)
    matrix, right = np.zeros((3 * k, 3 * k)), np.zeros(3 * k)
    for (i, j), h, g in zip(pairs, information, gradients, strict=True):
        x, y, theta = between(poses[i], poses[j])
        c, s = math.cos(theta), math.sin(theta)
        row = np.zeros((3, 3 * k))
        row[:, 3 * i : 3 * i + 3] = np.eye(3)
        row[:, 3 * j : 3 * j + 3] -= np.array([[c, -s, y], [s, c, -x], [0.0, 0.0, 1.0]])
        matrix += row.T @ h @ row
        right += row.T @ g
    return np.linalg.solve(matrix[3:, 3:], right[3:]).reshape(-1, 3)


def test_conjugate_gradients_solve_the_normal_equations():
    generator = np.random.default_rng(2)
    poses = generator.normal(size=(20, 3))
    chain = np.column_stack([np.arange(1, 20), np.arange(19)])
    pairs = np.concatenate([chain, generator.integers(0, 20, (60, 2))])
    pairs = np.ascontiguousarray(pairs[pairs[:, 0] != pairs[:, 1]])
    roots = generator.normal(size=(len(pairs), 3, 3))
    information, gradients = roots @ roots.transpose(0, 2, 1), generator.normal(size=(len(pairs), 3))
    found = solve(poses, pairs, information, gradients, tolerance=1e-9)
    assert not found[0].any()
    assert found[1:] == pytest.approx(dense(poses, pairs, information, gradients), rel=1e-5, abs=1e-7)


def test_a_motion_of_j_is_one_of_i_backwards():
    motions = between(POSES[PAIRS[:, 1]], POSES[PAIRS[:, 0]]) + np.array([[0.003, -0.001, 0.002]])

    def cost(poses, m):
        error = between(motions[m], between(poses[PAIRS[m, 1]], poses[PAIRS[m, 0]]))
        return float(error @ error)

    information, gradients = factors_and_sums(kernels.add_motion_factors, motions, np.ones((3, 3)))
    right = np.zeros((3, 3))
    compiled(kernels.set_up)(POSES, PAIRS, information, gradients, np.zeros((3, 3)), np.zeros((3, 3, 3)), right)
    by_pair = numerical_gradient(cost, POSES, PAIRS)
    expected = np.zeros((3, 3))
    for m, (i, j) in enumerate(PAIRS):
        expected[i] += by_pair[m, 0]
        expected[j] += by_pair[m, 1]
    assert right == pytest.approx(expected, abs=2e-5)


def test_pairs_spread_over_robots_and_are_near():
    generator = np.random.default_rng(4)
    poses = np.column_stack([generator.uniform(0.0, 12.0, (600, 2)), np.zeros(600)])
    parts = np.repeat([0, 1, 2], 200)
    pairs = pairs_of_nodes(poses, parts, 6, np.random.default_rng(1))
    assert (np.hypot(*(poses[pairs[:, 0], :2] - poses[pairs[:, 1], :2]).T) <= 2.0).all()
    assert (pairs[:, 0] != pairs[:, 1]).all()
    of_robots = np.bincount(3 * parts[pairs[:, 0]] + parts[pairs[:, 1]])
    assert of_robots.min() > 0.6 * of_robots.mean()
    assert np.bincount(pairs[:, 0], minlength=600).max() <= 6
    assert np.array_equal(pairs, pairs_of_nodes(poses, parts, 6, np.random.default_rng(1)))
