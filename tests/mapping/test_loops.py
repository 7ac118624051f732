"""Loop closures: the bound of the search, the graph's slopes, wrong edges, and a ring that closes."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.jit import compiled
from mercator_design.mapping import poses
from mercator_design.mapping.front.front_end import FrontEnd
from mercator_design.mapping.logs import RobotLog
from mercator_design.mapping.loops import closures, correlation, graph
from mercator_design.mapping.merit.trajectories import robot_error
from tests.mapping import analytic


def some_field(seed, n=80):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.5, 1.5, (n, 2))
    return correlation.likelihood_of(points), points


@given(seed=st.integers(0, 1000), row=st.integers(-40, 90), column=st.integers(-40, 90))
def test_the_coarse_field_bounds_the_fine_one(seed, row, column):
    """For a scan anywhere, also partly beside the field, and all 64 places of a block."""
    field, _ = some_field(seed % 7)
    cells = np.random.default_rng(seed).integers(-20, 20, (30, 2))
    bound = compiled(correlation.total)(field.coarse, cells, 30, row, column)
    for i, j in itertools.product(range(correlation.BLOCK), repeat=2):
        assert compiled(correlation.total)(field.fine, cells, 30, row + i, column + j) <= bound


def test_the_search_finds_what_an_exhaustive_one_does():
    field, points = some_field(3)
    scan = poses.transform(poses.inverse(np.array([0.31, -0.22, 0.04])), points[:40])
    found = correlation.best_pose(field, scan, np.zeros(3), correlation.Window(0.6, 0.1), 0.3)
    assert found is not None
    assert found[0] == pytest.approx([0.31, -0.22, 0.04], abs=0.03)
    best = 0
    for turn, row, column in itertools.product(range(-5, 6), range(-12, 13), range(-12, 13)):
        cells = np.floor((poses.rotate(0.02 * turn, scan) - field.corner)[:, ::-1] / correlation.CELL).astype(int)
        best = max(best, compiled(correlation.total)(field.fine, cells, 40, row, column))
    assert round(found[1] * 255 * 40) == best


def test_a_scan_of_elsewhere_is_not_found():
    field, _ = some_field(3)
    scan = np.random.default_rng(9).uniform(-1.5, 1.5, (60, 2))
    assert correlation.best_pose(field, scan, np.zeros(3), correlation.Window(0.6, 0.1), 0.7) is None


def ring(n=40, seed=1):
    """Poses around a circle twice, the same with drift, and right edges between the rounds."""
    rng = np.random.default_rng(seed)
    angles = np.linspace(0, 4 * np.pi, n)
    true = np.column_stack([5 * np.cos(angles), 5 * np.sin(angles), angles + np.pi / 2])
    motions = poses.between(true[:-1], true[1:]) + rng.normal(0, 1, (n - 1, 3)) * (0.02, 0.02, 0.01)
    drifted = [true[0]]
    for one in motions:
        drifted.append(poses.compose(drifted[-1], one))
    drifted = np.array(drifted)
    starts = np.arange(n // 2)
    ends = starts + (n - 1) // 2
    loops = graph.Edges(
        starts,
        ends,
        poses.between(true[starts], true[ends]) + rng.normal(0, 1, (len(starts), 3)) * (0.02, 0.02, 0.01),
        np.tile(np.diag([1100.0, 1100.0, 7000.0]), (len(starts), 1, 1)),
        np.ones(len(starts), bool),
    )
    return true, drifted, loops


def test_the_graphs_jacobians_are_slopes():
    _, drifted, loops = ring()
    by_start, by_end = graph.jacobians(drifted, loops)
    for sides, found in ((loops.starts, by_start), (loops.ends, by_end)):
        for axis in range(3):
            step = np.zeros(3)
            step[axis] = 1e-6
            up, down = drifted.copy(), drifted.copy()
            for edge in range(len(sides)):
                up[:], down[:] = drifted, drifted
                up[sides[edge]] += step
                down[sides[edge]] -= step
                slope = (graph.errors(up, loops)[edge] - graph.errors(down, loops)[edge]) / 2e-6
                assert found[edge][:, axis] == pytest.approx(slope, abs=1e-6)


def test_loops_undo_drift():
    true, drifted, loops = ring()
    found, weights = graph.optimise(drifted, graph.chain(drifted) + loops)
    assert robot_error(found, true).rmse < 0.4 * robot_error(drifted, true).rmse
    assert weights.min() > 0.3


@pytest.mark.parametrize("share", [0.3, 0.6])
def test_wrong_loops_change_nothing(share):
    """They point anywhere within 8 m: by chance, one is right to 0.3 m with a probability of 1 in 200."""
    _, drifted, loops = ring()
    rng = np.random.default_rng(3)
    n = round(share * len(loops.starts) / (1 - share))
    starts, ends = rng.integers(0, 18, n), rng.integers(22, 40, n)
    motions = rng.uniform((-8, -8, -np.pi), (8, 8, np.pi), (n, 3))
    wrong = graph.Edges(starts, ends, motions, loops.information[rng.integers(0, 20, n)], np.ones(n, bool))
    right, _ = graph.optimise(drifted, graph.chain(drifted) + loops)
    found, weights = graph.optimise(drifted, graph.chain(drifted) + loops + wrong)
    assert np.hypot(*(found - right)[:, :2].T).max() < 0.001
    assert weights[-n:].max() < 0.01


RING = [
    *(analytic.box(-7, -5, 7, 5), analytic.box(-5, -3, 5, 3)),
    *(analytic.box(x, -5, x + 0.5, -4.7) for x in (-5.2, -2.0, 0.5, 4.0)),
    *(analytic.box(x, 4.6, x + 0.7, 5) for x in (-4.4, -1.1, 2.2, 3.9)),
    *(analytic.box(6.6, y, 7, y + 0.4) for y in (-3.0, 0.2, 1.7)),
    analytic.box(-7, -0.6, -6.5, 0.3),
]
CORNERS = np.array([[-6, -4], [6, -4], [6, 4], [-6, 4]])


def corridor_log(seed=1, rounds=2, lidar_step=0.5, walls=RING, corners=CORNERS):
    """A few scans of half a turn in a ring of corridors, 14 x 10 m, with doors; odometry that drifts by metres."""
    way = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        n = round(np.hypot(*(end - start)) / lidar_step)
        heading = np.arctan2(*(end - start)[::-1])
        way += [(*(start + (end - start) * k / n), heading - np.pi / 4 * (k == 0)) for k in range(n)]
    true = np.array(way * rounds)
    true[:, 2] = np.unwrap(true[:, 2])
    times = np.arange(len(true), dtype=float)
    at = lambda t: poses.interpolate(times, true, np.asarray(t))  # noqa: E731
    rng = np.random.default_rng(seed)
    turns = []
    for time, pose in zip(times, true, strict=True):
        still = lambda t, pose=pose: np.tile(pose, (len(t), 1))  # noqa: E731
        one = analytic.turn(np.vstack(walls), still, time, rng, 0.01, 0.0, beams=720, period=1e-3)
        ahead = np.abs(one.angles) < np.pi / 2
        turns.append(one._replace(times=np.full(ahead.sum(), time), angles=one.angles[ahead], ranges=one.ranges[ahead]))
    odometry = analytic.drifting(at, times, rng, yaw_walk=0.025)
    return RobotLog("robot", turns, times, odometry, truth_times=times, truth=true)


@pytest.mark.parametrize(
    ("seed", "step"), [(1, 1.0), *(pytest.param(seed, 0.5, marks=pytest.mark.thorough) for seed in (1, 2))]
)
def test_a_ring_closes(seed, step):
    """Two rounds by odometry alone, which ends metres away."""
    log = corridor_log(seed, lidar_step=step)
    track = FrontEnd(log).run()
    assert track.n_segments == 1
    drifted = track.with_keyframes(log.odometry[track.keyframes.turns])
    assert robot_error(drifted.poses, log.truth).largest > 0.5
    found = closures.close_loops(drifted)
    n = len(log.truth) // 2  # scans of one round; the shape of a round is that of the odometry, whose scale is off
    apart = poses.between(log.truth[:n], log.truth[n:])
    left = poses.between(apart, poses.between(found.poses[:n], found.poses[n:]))
    assert np.hypot(left[:, 0], left[:, 1]).mean() < 0.05
    assert np.abs(left[:, 2]).mean() < np.radians(1.5)


def test_refinement_follows_each_round():
    track = FrontEnd(corridor_log(1, rounds=1)).run()
    calls = []
    closures.close_loops(track, lambda one: calls.append(one) or one)
    assert len(calls) == len(closures.ROUNDS)


def test_turns_between_keyframes_follow_these():
    track = FrontEnd(analytic.log(seconds=6.0)).run()
    motion = np.array([1.0, -2.0, 0.7])
    found = track.with_keyframes(poses.compose(motion, track.keyframes.poses))
    expected = poses.compose(motion, track.poses)
    assert found.poses[:, :2] == pytest.approx(expected[:, :2])
    assert poses.wrap(found.poses[:, 2] - expected[:, 2]) == pytest.approx(0.0, abs=1e-9)
