"""Poses: rows and arrays agree, and inverses undo."""

import numpy as np
import pytest

from mercator_design.jit import compiled
from mercator_design.mapping import poses


def some_poses(n, seed):
    return np.random.default_rng(seed).uniform(-4.0, 4.0, (n, 3))


def test_between_undoes_compose():
    a, b = some_poses(50, 1), some_poses(50, 2)
    found = poses.between(a, poses.compose(a, b))
    assert found[:, :2] == pytest.approx(b[:, :2])
    assert poses.wrap(found[:, 2] - b[:, 2]) == pytest.approx(0.0, abs=1e-12)
    assert np.abs(found[:, 2]).max() <= np.pi


def test_the_inverse():
    a = some_poses(50, 3)
    assert poses.compose(a, poses.inverse(a)) == pytest.approx(0.0, abs=1e-12)
    assert poses.compose(poses.inverse(a), a) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("kernel", "array_form"), [(poses.product, poses.compose), (poses.relative, poses.between)])
def test_kernels_do_what_the_arrays_do(kernel, array_form):
    for a, b in zip(some_poses(10, 4), some_poses(10, 5), strict=True):
        assert kernel(a, b) == pytest.approx(array_form(a, b))
    assert compiled(kernel)(a, b) == pytest.approx(array_form(a, b))


def test_a_point_moves_as_a_pose_does():
    a, points = some_poses(1, 6)[0], some_poses(9, 7)[:, :2]
    placed = poses.compose(a, np.column_stack([points, np.zeros(9)]))
    assert poses.transform(a, points) == pytest.approx(placed[:, :2])


def test_interpolation_is_linear_and_ends_at_the_ends():
    times, track = np.array([1.0, 3.0]), np.array([[0.0, 1.0, 3.0], [2.0, 1.0, 4.0]])
    found = poses.interpolate(times, track, np.array([0.0, 1.5, 9.0]))
    assert found == pytest.approx(np.array([[0.0, 1.0, 3.0], [0.5, 1.0, 3.25], [2.0, 1.0, 4.0]]))
