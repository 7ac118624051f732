"""Surfels and ICP against finite differences and known poses."""

import numpy as np
import pytest

from mercator_design.jit import compiled
from mercator_design.mapping import poses
from mercator_design.mapping.front import matching
from mercator_design.mapping.front.scans import Preparation
from mercator_design.mapping.front.surfels import SurfelMap, nearest
from tests.mapping import analytic


def wall_points(n=200, y=0.0, up=-1.0, x=(-1.0, 1.0)):
    points = np.column_stack([np.linspace(*x, n), np.full(n, y)])
    return points, np.tile([0.0, up], (n, 1)), np.zeros(n)


def test_two_faces_of_a_wall_stay_apart():
    surfels = SurfelMap()
    for _ in range(3):
        surfels.insert(np.zeros(3), *wall_points(y=0.001, up=-1.0))
        surfels.insert(np.zeros(3), *wall_points(y=0.045, up=1.0))
    found = surfels.surfels()
    assert found[found[:, 3] < 0, 1] == pytest.approx(0.001)
    assert found[found[:, 3] > 0, 1] == pytest.approx(0.045)


def test_a_map_grows_where_there_are_points():
    surfels = SurfelMap()
    for x in (-40.0, 0.0, 55.0):
        surfels.insert(np.array([x, -x, 0.0]), *wall_points())
    found = surfels.surfels()
    assert found[:, 4].sum() == pytest.approx(600)
    assert found[:, 0].min() < -40.9
    assert found[:, 0].max() > 55.9
    assert len(surfels.grid.rows) <= 16 * 512


def test_the_nearest_surfel_is_that_of_all():
    rng = np.random.default_rng(1)
    surfels = SurfelMap()
    points = rng.uniform(-1, 1, (300, 2))
    angles = rng.uniform(-np.pi, np.pi, 300)
    surfels.insert(np.zeros(3), points, np.column_stack([np.cos(angles), np.sin(angles)]), np.zeros(300))
    rows = surfels.grid.rows.astype(float)
    hits = 0
    for x, y, angle in rng.uniform((-1.2, -1.2, -np.pi), (1.2, 1.2, np.pi), (300, 3)):
        normal = np.cos(angle), np.sin(angle)
        found = compiled(nearest)(surfels.grid, x, y, *normal, 0.2, 0.8)
        away = np.where((rows[:, 4] > 0) & (rows[:, 2:4] @ normal > 0.8), np.hypot(rows[:, 0] - x, rows[:, 1] - y), 9.0)
        hits += found >= 0
        assert away.min() >= 0.2 if found < 0 else away[found] == pytest.approx(away.min())
    assert hits > 30


def room_map():
    """A map of a room from one place, and a scan from there."""
    log = analytic.log(seconds=0.1)
    scan = Preparation(log).scan(0)
    surfels = SurfelMap()
    surfels.insert(np.zeros(3), scan.points, scan.normals, scan.ages)
    return surfels, scan


def cost(surfels, scan, state, which):
    """The sum of the squared distances of points to the lines of fixed surfels."""
    theta = state[2] + state[3] * scan.ages
    c, s = np.cos(theta), np.sin(theta)
    x = state[0] + c * scan.points[:, 0] - s * scan.points[:, 1]
    y = state[1] + s * scan.points[:, 0] + c * scan.points[:, 1]
    rows = surfels.grid.rows[which[which >= 0]]
    placed = np.column_stack([x, y])[which >= 0]
    return np.sum((rows[:, 2:4] * (placed - rows[:, :2])).sum(axis=1) ** 2)


def matched_rows(surfels, scan, state, reach):
    theta = state[2] + state[3] * scan.ages
    points = np.array(
        [poses.transform([*state[:2], t], p[np.newaxis])[0] for t, p in zip(theta, scan.points, strict=True)]
    )
    normals = np.array([poses.rotate(t, p[np.newaxis])[0] for t, p in zip(theta, scan.normals, strict=True)])
    return np.array([compiled(nearest)(surfels.grid, *p, *n, reach, 0.8) for p, n in zip(points, normals, strict=True)])


def test_jacobians_are_slopes_of_the_cost():
    """At a scale of residuals that gives every point the same weight."""
    surfels, scan = room_map()
    state = np.array([0.01, -0.02, 0.015, 0.02])
    normal, gradient = np.zeros((4, 4)), np.zeros(4)
    points = scan.points, scan.normals, scan.ages
    matched, total = compiled(matching.add_points)(surfels.grid, state, *points, 0.1, 1e6, normal, gradient)
    which = matched_rows(surfels, scan, state, 0.1)
    assert matched == np.sum(which >= 0) > 100
    assert total == pytest.approx(cost(surfels, scan, state, which))
    step = 1e-5
    slopes = [
        (cost(surfels, scan, state + step * unit, which) - cost(surfels, scan, state - step * unit, which)) / (2 * step)
        for unit in np.eye(4)
    ]
    assert -2 * gradient == pytest.approx(slopes, rel=1e-4, abs=1e-5)
    assert normal == pytest.approx(normal.T)


def test_a_turn_comes_back_to_its_place():
    surfels, scan = room_map()
    wrong = np.array([0.06, -0.04, 0.05])
    found = matching.Matcher().match(surfels, wrong, np.array([0.1, 0.1, 0.1]), scan, matching.MatchSearch())
    assert found.pose == pytest.approx(0.0, abs=5e-4)
    assert found.share > 0.99
    assert found.ratio > 0.1


def test_walls_of_one_direction_leave_the_other_to_the_prior():
    surfels = SurfelMap()
    for y, up in ((-0.5, 1.0), (0.5, -1.0)):
        surfels.insert(np.zeros(3), *wall_points(y=y, up=up, x=(-3, 3)))
    points = [np.concatenate(both) for both in zip(wall_points(y=-0.5, up=1.0), wall_points(y=0.5), strict=True)]
    found = matching.Matcher().match_points(
        surfels, np.array([0.3, 0.02, 0.01]), np.array([0.02, 0.02, 0.02]), tuple(points), matching.MatchSearch()
    )
    assert found.pose == pytest.approx([0.3, 0.0, 0.0], abs=1e-4)
    assert found.ratio < 1e-3
    assert found.information[0, 0] == pytest.approx(0.0, abs=1e-6 * found.information[1, 1])


def test_the_centre_of_a_circle_leaves_the_heading_to_the_prior():
    rng = np.random.default_rng(4)
    angles = np.linspace(-np.pi, np.pi, 240, endpoint=False)
    ring = -np.column_stack([np.cos(angles), np.sin(angles)])
    surfels = SurfelMap()
    surfels.insert(np.zeros(3), -1.2 * ring, ring, np.zeros(240))
    noisy = angles + rng.normal(0, 0.05, 240)
    normals = -np.column_stack([np.cos(noisy), np.sin(noisy)])
    found = matching.Matcher().match_points(
        surfels,
        np.array([0.02, 0.0, 0.1]),
        np.full(3, 0.05),
        (-1.2 * ring, normals, np.zeros(240)),
        matching.MatchSearch(),
    )
    assert found.pose[:2] == pytest.approx(0.0, abs=1e-3)
    assert found.pose[2] == pytest.approx(0.1, abs=2e-3)


def test_eigenvectors():
    rng = np.random.default_rng(2)
    for _ in range(20):
        half = rng.normal(size=(3, 3))
        matrix = half @ half.T
        diagonal, vectors = matrix.copy(), np.zeros((3, 3))
        compiled(matching.diagonalise)(diagonal, vectors)
        assert vectors @ np.diag(np.diag(diagonal)) @ vectors.T == pytest.approx(matrix)
        assert np.sort(np.diag(diagonal)) == pytest.approx(np.linalg.eigvalsh(matrix))


def test_the_solver():
    rng = np.random.default_rng(3)
    half, right = rng.normal(size=(4, 4)), rng.normal(size=4)
    matrix = half @ half.T
    solution = np.linalg.solve(matrix, right)
    compiled(matching.solve)(matrix, right)
    assert right == pytest.approx(solution)
