"""Figures of merit against cases computed by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.mapping.merit import occupancy, trajectories
from mercator_design.mapping.poses import transform, wrap
from mercator_design.mapping.rigid import fit

SQUARE = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.5], [2.0, 2.0, 1.0], [0.0, 2.0, 1.5]])
poses = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(np.array)


def turned(pose, trajectory):
    """A trajectory of a frame that stands at a pose."""
    return np.column_stack([transform(pose, trajectory[:, :2]), trajectory[:, 2] + pose[2]])


class TestRigidFit:
    @given(poses)
    def test_a_moved_set_of_points_comes_back(self, pose):
        found = fit(SQUARE[:, :2], transform(pose, SQUARE[:, :2]))
        assert found[:2] == pytest.approx(pose[:2], abs=1e-9)
        assert wrap(found[2] - pose[2]) == pytest.approx(0.0, abs=1e-9)

    def test_a_point_without_weight_does_not_matter(self):
        target = SQUARE[:, :2] + (1.0, 0.0)
        target[3] = 9.0
        assert fit(SQUARE[:, :2], target, np.array([1.0, 1.0, 1.0, 0.0])) == pytest.approx([1.0, 0.0, 0.0])

    def test_one_point_is_moved_without_rotation(self):
        assert fit(np.array([[1.0, 2.0]]), np.array([[4.0, 6.0]])) == pytest.approx([3.0, 4.0, 0.0])

    def test_no_point_is_refused(self):
        with pytest.raises(ValueError, match="at least one point"):
            fit(np.empty((0, 2)), np.empty((0, 2)))


class TestSwarmError:
    @given(poses)
    def test_a_common_frame_does_not_matter(self, pose):
        error = trajectories.swarm_error([turned(pose, SQUARE), turned(pose, SQUARE[::-1])], [SQUARE, SQUARE[::-1]])
        assert error.rmse == pytest.approx(0.0, abs=1e-9)
        assert error.yaw_rms == pytest.approx(0.0, abs=1e-9)

    def test_an_error_that_alternates(self):
        # 1 cm outwards along x at opposite corners: the mean error and the mean turn are 0.
        estimated = SQUARE + np.array([[-0.01, 0, 0], [0.01, 0, 0.02], [0.01, 0, -0.02], [-0.01, 0, 0]])
        error = trajectories.swarm_error([estimated], [SQUARE])
        assert (error.rmse, error.median, error.largest) == pytest.approx((0.01, 0.01, 0.01))
        assert error.yaw_rms == pytest.approx(math.sqrt(2 * 0.02**2 / 4))

    def test_a_wrong_frame_between_robots_counts(self):
        shifted = SQUARE + np.array([0.2, 0.0, 0.0])
        together = trajectories.swarm_error([SQUARE, shifted], [SQUARE, SQUARE])
        assert together.rmse == pytest.approx(0.1)  # the alignment takes half of it
        assert together.of_robots == pytest.approx((0.1, 0.1))
        assert trajectories.robot_error(shifted, SQUARE).rmse == pytest.approx(0.0, abs=1e-12)

    def test_other_numbers_of_poses_are_refused(self):
        with pytest.raises(ValueError, match="found 3 and 4"):
            trajectories.swarm_error([SQUARE[:3]], [SQUARE])


class TestRelativeError:
    @given(poses)
    def test_the_frame_does_not_matter(self, pose):
        error = trajectories.relative_error(turned(pose, SQUARE), SQUARE, trajectories.pairs_apart(4))
        assert error.translation == pytest.approx(0.0, abs=1e-9)

    def test_odometry_that_is_4_per_cent_long_and_turns_a_degree_a_step(self):
        line = np.column_stack([np.arange(5.0), np.zeros(5), np.zeros(5)])
        long = np.column_stack([1.04 * np.arange(5.0), np.zeros(5), np.radians(np.arange(5.0))])
        error = trajectories.relative_error(long[:2], line[:2], trajectories.pairs_apart(2))
        assert error.translation == pytest.approx(0.04)
        every = trajectories.relative_error(long, line, trajectories.pairs_apart(5))
        assert (every.rotation, every.rotation_sd) == pytest.approx((math.radians(1.0), 0.0), abs=1e-9)
        assert every.pairs == 4

    def test_pairs_as_evo_takes_them(self):
        assert trajectories.pairs_apart(6, 2).tolist() == [[0, 2], [1, 3], [2, 4], [3, 5]]
        assert trajectories.pairs_apart(7, 2, overlapping=False).tolist() == [[0, 2], [2, 4], [4, 6]]

    def test_pairs_a_second_apart(self):
        assert trajectories.pairs_after(np.array([0.0, 0.4, 1.0, 1.3, 2.1]), 1.0).tolist() == [[0, 2], [1, 4], [2, 4]]

    def test_near_pairs_are_near_far_in_the_log_and_the_same_for_a_seed(self):
        walk = np.cumsum(np.random.default_rng(1).normal(0.0, 0.3, (300, 3)), axis=0)
        far_apart = lambda i, j: j - i >= 30  # noqa: E731
        pairs = trajectories.near_pairs(walk, np.random.default_rng(5), far_apart, nearer=1.5, limit=50)
        assert len(pairs) == 50
        assert (pairs[:, 1] - pairs[:, 0] >= 30).all()
        assert (np.linalg.norm(walk[pairs[:, 0], :2] - walk[pairs[:, 1], :2], axis=1) < 1.5).all()
        again = trajectories.near_pairs(walk, np.random.default_rng(5), far_apart, nearer=1.5, limit=50)
        assert np.array_equal(pairs, again)

    def test_near_pairs_of_a_long_log_are_drawn(self):
        """Of 200 million pairs; they need no more memory than those of a short one."""
        line = np.column_stack([np.linspace(0.0, 100.0, 20_000), np.zeros((20_000, 2))])
        pairs = trajectories.near_pairs(line, np.random.default_rng(5), lambda i, j: j - i >= 30, limit=1000)
        assert len(pairs) == 1000
        assert (np.ptp(pairs, axis=1) >= 30).all()
        assert (np.ptp(pairs, axis=1) <= 400).all()

    def test_pairs_along_a_way(self):
        """As evo pairs them: a pair begins where the one before it ends."""
        places = np.column_stack([0.4 * np.arange(12), np.zeros(12)])
        assert trajectories.pairs_along(places, 1.0).tolist() == [[0, 3], [3, 6], [6, 9]]
        assert trajectories.pairs_along(places[:3], 1.0).shape == (0, 2)

    def test_no_pair_is_refused(self):
        with pytest.raises(ValueError, match="at least one pair"):
            trajectories.relative_error(SQUARE, SQUARE, np.empty((0, 2), dtype=np.int64))


class TestOccupancy:
    WALLS = np.array([[0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 1.0, 1.0]])

    def test_cells_on_the_walls_are_all_right(self):
        along = np.arange(0.0, 1.01, 0.05)
        centres = np.concatenate([np.column_stack([along, np.zeros(21)]), np.column_stack([np.ones(21), along])])
        assert occupancy.agreement(centres, self.WALLS, 0.05)[:3] == pytest.approx((1.0, 1.0, 1.0))

    def test_half_of_the_walls_and_a_third_of_the_cells(self):
        centres = np.array([[x, y] for x in np.arange(0.0, 1.01, 0.05) for y in (0.0, 0.5, 0.6)])
        centres = centres[centres[:, 0] < 0.9]  # 18 columns, two thirds of them away from walls
        found = occupancy.agreement(centres, self.WALLS[:1], 0.05)
        assert found.precision == pytest.approx(1 / 3)
        assert found.recall == pytest.approx(0.9, abs=0.003)  # 5 cm beyond the last cell at 0.85 m
        both = occupancy.agreement(centres[::3], self.WALLS, 0.05)
        assert both.recall == pytest.approx(0.45, abs=0.003)
        assert both.f1 == pytest.approx(2 * 0.45 / 1.45, abs=0.003)

    def test_only_seen_places_count(self):
        places = occupancy.places_of(self.WALLS)
        centres = np.column_stack([np.arange(0.0, 1.01, 0.05), np.zeros(21)])
        assert occupancy.agreement(centres, self.WALLS, 0.05, seen=places[:, 1] == 0.0).recall == 1.0

    def test_a_distance_of_the_tolerance_is_near(self):
        assert occupancy.agreement(np.array([[0.5, 0.05]]), self.WALLS[:1], 0.05).precision == 1.0
        assert occupancy.agreement(np.array([[0.5, 0.051]]), self.WALLS[:1], 0.05).precision == 0.0

    def test_no_cells(self):
        assert occupancy.agreement(np.empty((0, 2)), self.WALLS, 0.05)[:3] == (1.0, 0.0, 0.0)

    def test_coverage_grows_with_time(self):
        points = np.array([[0.0, 0.0], [0.5, 0.0], [1.0, 0.5]])
        found = occupancy.coverage(points, self.WALLS, 0.1, np.array([1.0, 2.0, 3.0]), np.array([0.5, 1.0, 2.0, 9.0]))
        assert found == pytest.approx([0.0, 0.05, 0.15, 0.25], abs=0.003)

    def test_distance_to_the_nearest_wall(self):
        points = np.array([[0.5, 0.2], [2.0, 0.5], [2.0, 2.0], [-3.0, -4.0]])
        assert occupancy.distances_to(self.WALLS, points) == pytest.approx([0.2, 1.0, math.sqrt(2.0), 5.0])
