"""The front end against true poses, on a room of straight walls; the simulator's arenas are in test_arenas.py."""

from dataclasses import replace

import numpy as np
import pytest

from mercator_design.mapping import poses
from mercator_design.mapping.front.front_end import FrontEnd
from tests.mapping import analytic


def errors(track, turns=slice(None)):
    """Distances [m] to the true places and errors of headings [rad], after a rigid alignment of one segment."""
    true = poses.interpolate(track.log.truth_times, track.log.truth, track.times)[turns]
    found = track.poses[turns]
    a, b = found[:, :2] - found[:, :2].mean(axis=0), true[:, :2] - true[:, :2].mean(axis=0)
    turned = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    return np.hypot(*(poses.rotate(turned, a) - b).T), poses.wrap(found[:, 2] + turned - true[:, 2])


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.fixture(scope="module")
def log():
    return analytic.log(seconds=20.0)


@pytest.fixture(scope="module")
def track(log):
    return FrontEnd(log).run()


def test_it_finds_the_way(log, track):
    far, turned = errors(track)
    assert rms(far) < 0.003
    assert far.max() < 0.01
    assert rms(turned) < np.radians(0.3)
    assert track.n_segments == 1
    assert track.shares[1:].min() > 0.85
    drift = FrontEnd(replace(log, turns=[one._replace(ranges=0 * one.ranges) for one in log.turns])).run()
    assert rms(errors(drift)[0]) > 3 * rms(far)  # the odometry alone
    assert len(drift.keyframes.turns) == 0


def test_keyframes_have_their_points_and_lie_on_the_walls(track):
    keyframes = track.keyframes
    assert len(keyframes.turns) == len(keyframes.first) - 1 > 10
    assert keyframes.first[-1] == len(keyframes.points) == len(keyframes.normals)
    assert keyframes.points.dtype == np.float32
    assert np.hypot(*keyframes.normals.T) == pytest.approx(1.0, abs=1e-5)
    one, normals = keyframes.of(3)
    assert len(one) == len(normals) == keyframes.first[4] - keyframes.first[3]


def test_without_the_times_of_beams_it_fails(log):
    """All beams at the middle of their turn: so the data have the skew that the front end removes."""
    still = [one._replace(times=np.linspace(one.middle - 1e-6, one.middle + 1e-6, len(one.times))) for one in log.turns]
    found = FrontEnd(replace(log, turns=still)).run()
    assert rms(errors(found)[0]) > 0.015


def test_the_origin_of_odometry_does_not_matter(log, track):
    moved = poses.compose(np.array([3.0, -2.0, 1.0]), log.odometry)
    found = FrontEnd(replace(log, odometry=moved)).run()
    assert found.poses == pytest.approx(track.poses, abs=1e-3)


def test_the_same_log_gives_the_same_bytes(log, track):
    found = FrontEnd(log).run()
    for one, other in zip((found.poses, *found.keyframes), (track.poses, *track.keyframes), strict=True):
        assert one.tobytes() == other.tobytes()


@pytest.mark.parametrize("missing", [0.3, 0.7])
def test_turns_that_are_missing_are_bridged(log, missing):
    rng = np.random.default_rng(5)
    turns = [one for k, one in enumerate(log.turns) if k == 0 or rng.random() >= missing]
    far, _ = errors(FrontEnd(replace(log, turns=turns)).run())
    assert rms(far) < 0.004


def carried(log, at, motion):
    """The log of a robot that is put elsewhere at a time, which its odometry does not notice."""
    rng = np.random.default_rng(6)
    after = lambda times: np.where(  # noqa: E731
        np.asarray(times)[:, np.newaxis] < at, analytic.wander(times), poses.compose(motion, analytic.wander(times))
    )
    turns = [analytic.turn(analytic.ROOM, after, one.times[0], rng, 0.01, 0.02) for one in log.turns]
    return replace(log, turns=turns, truth=after(log.truth_times))


@pytest.mark.parametrize("motion", [(0.25, 0.1, 2.9), (0.3, 0.2, 0.5), (0.0, 0.0, 0.5), (0.4, 0.0, 0.0)])
def test_a_carried_robot_begins_a_new_segment(log, motion):
    """Also where the room looks much the same as from its old place."""
    found = FrontEnd(carried(log, 10.0, np.array(motion))).run()
    assert found.n_segments == 2
    (change,) = np.nonzero(np.diff(found.segments))[0]
    assert abs(found.times[change + 1] - 10.0) < 0.4
    for number in (0, 1):
        assert rms(errors(found, (found.segments == number) & (np.abs(found.times - 10) > 0.2))[0]) < 0.004
    assert np.unique(found.keyframes.segments).tolist() == [0, 1]


def test_a_gap_of_odometry_while_turning_makes_no_keyframes(log):
    known = (log.odometry_times < 8.0) | (log.odometry_times > 10.0)
    gap = replace(log, odometry_times=log.odometry_times[known], odometry=log.odometry[known])
    found = FrontEnd(gap).run()
    assert not np.any((found.times[found.keyframes.turns] > 8.1) & (found.times[found.keyframes.turns] < 9.9))
    far, _ = errors(found)
    assert rms(far[found.times > 10.2]) < 0.02


def test_a_robot_that_stands_still_has_one_keyframe():
    still = lambda times: np.tile([0.1, 0.2, 0.3], (len(times), 1))  # noqa: E731
    found = FrontEnd(analytic.log(pose_at=still, seconds=2.0)).run()
    assert len(found.keyframes.turns) == 1
    assert np.abs(found.poses[:, :2]).max() < 0.005


def test_a_log_without_turns(log):
    found = FrontEnd(replace(log, turns=[])).run()
    assert len(found.poses) == len(found.keyframes.turns) == found.n_segments == 0
