"""Frames of robots by their sightings of each other, in analytic worlds."""

import math

import numpy as np
import pytest

from mercator_design.mapping.frames.evidence import evidence
from mercator_design.mapping.frames.fragment import fragments
from mercator_design.mapping.frames.links import link_by_sightings
from mercator_design.mapping.frames.persistence import furniture
from mercator_design.mapping.frames.voting import candidates, pairs_of, refined
from mercator_design.mapping.merit.trajectories import robot_error
from mercator_design.mapping.poses import inverse, transform, wrap
from tests.mapping import worlds

pytestmark = pytest.mark.together

CLOCKS = (0.0, 0.42, -1.37)


@pytest.fixture(scope="module")
def tracks():
    """Three robots with different clocks in an empty dodecagon, in which maps have 12 equal answers."""
    generator = np.random.default_rng(3)
    ways = [worlds.Curve(generator, size=(0.8, 0.7), speed=0.25) for _ in range(3)]
    walls = worlds.polygon(12, 1.226)
    return [worlds.perfect_track(ways, k, walls, 40.0, 1, clock=CLOCKS[k]) for k in range(3)]


@pytest.fixture(scope="module")
def parts(tracks):
    return [fragments(track)[0] for track in tracks]


def test_a_fragment_follows_the_robot_between_turns(tracks, parts):
    log = tracks[1].log
    at = np.linspace(parts[1].start, parts[1].end, 999)
    found = parts[1].at(at)
    truth = np.column_stack([np.interp(at, log.truth_times, log.truth[:, k]) for k in range(3)])
    error = robot_error(found, truth)
    assert error.largest < 0.006  # the track's poses err by 1 mm
    assert error.yaw_rms < 0.003


def test_a_fragment_ends_with_its_turns(parts):
    times = np.array([parts[0].start - 0.01, parts[0].start, parts[0].end, parts[0].end + 0.01])
    assert np.isnan(parts[0].at(times)).any(axis=1).tolist() == [True, False, False, True]


@pytest.mark.parametrize(("a", "b"), [(0, 1), (0, 2), (1, 2)])
def test_sightings_give_the_frame_and_the_clock(tracks, parts, a, b):
    link = link_by_sightings(a, b, parts, clock_search=3.0)
    assert link.refusal == ""
    error = link.frame - worlds.true_frame(tracks, a, b)
    assert np.abs(error[:2]).max() < 0.005
    assert abs(wrap(error[2])) < math.radians(0.15)
    assert link.offset == pytest.approx(CLOCKS[b] - CLOCKS[a], abs=0.004)


def test_a_wrong_frame_is_contradicted(tracks, parts):
    true = worlds.true_frame(tracks, 0, 1)
    right = evidence(parts[0], parts[1], true, CLOCKS[1])
    assert right.share > 0.98
    assert right.hits > 200
    assert evidence(parts[0], parts[1], true + np.array([0.0, 0.0, math.pi / 6.0]), CLOCKS[1]).share < 0.6
    assert evidence(parts[0], parts[1], true + np.array([0.3, 0.0, 0.0]), CLOCKS[1]).share < 0.7


def test_the_frame_with_the_most_votes_is_near_the_true_one(tracks, parts):
    pairs = pairs_of(parts[0], parts[1], CLOCKS[1])
    (best, votes), *others = candidates(pairs)
    true = worlds.true_frame(tracks, 0, 1)
    assert np.hypot(*(best - true)[:2]) < 0.15
    assert abs(wrap(best[2] - true[2])) < math.radians(10.0)  # the refinement's first gate is 0.4 m
    assert votes > 200
    assert len(others) == 4
    assert all(votes > other for _, other in others)
    far = [other for frame, other in others if np.hypot(*(frame - true)[:2]) > 0.4]  # the others lean on the same peak
    assert far
    assert all(votes > 2 * other for other in far)


def test_a_clock_that_is_wrong_by_a_quarter_of_a_second_is_corrected(tracks, parts):
    true = worlds.true_frame(tracks, 0, 1)
    fit = refined(parts[0], parts[1], true + np.array([0.05, -0.05, 0.03]), CLOCKS[1] + 0.25, with_clock=True)
    assert fit.offset == pytest.approx(CLOCKS[1], abs=0.004)
    kept = refined(parts[0], parts[1], true, CLOCKS[1] + 0.25, with_clock=False)
    assert kept.offset == CLOCKS[1] + 0.25
    assert kept.residual > 2.0 * fit.residual


def test_logs_of_different_times_have_no_link(tracks, parts):
    later = fragments(worlds.perfect_track([worlds.Still((0, 0, 0))], 0, worlds.polygon(12, 1.2), 3.0, 1, begin=900.0))
    assert link_by_sightings(0, 1, [parts[0], *later], clock_search=3.0) is None


def test_robots_that_never_see_each_other_have_no_frame():
    generator = np.random.default_rng(5)
    ways = [worlds.Curve(generator, centre=(x, 0.0), size=(0.6, 0.6)) for x in (0.0, 9.0)]
    walls = np.concatenate([worlds.polygon(12, 1.2), worlds.polygon(12, 1.2) + np.array([9.0, 0.0, 9.0, 0.0])])
    parts = [fragments(worlds.perfect_track(ways, k, walls, 10.0, 1))[0] for k in range(2)]
    link = link_by_sightings(0, 1, parts, clock_search=1.0)
    assert link is None or link.refusal


def test_a_robot_that_stands_is_linked_by_what_it_sees():
    generator = np.random.default_rng(7)
    ways = [worlds.Curve(generator, size=(0.8, 0.7)), worlds.Still((0.5, -0.6, 2.0))]
    tracks = [worlds.perfect_track(ways, k, worlds.polygon(12, 1.226), 30.0, 1) for k in range(2)]
    parts = [fragments(track)[0] for track in tracks]
    parts = [part.with_sightings(~furniture(part)) for part in parts]
    link = link_by_sightings(0, 1, parts, clock_search=0.0)
    assert link.refusal == ""
    assert np.abs(link.frame - worlds.true_frame(tracks, 0, 1)).max() < 0.006


def test_two_robots_that_stand_have_no_frame_by_sightings():
    ways = [worlds.Still((0.4, 0.0, 0.0)), worlds.Still((-0.4, 0.3, 2.0))]
    parts = [fragments(worlds.perfect_track(ways, k, worlds.polygon(12, 1.226), 10.0, 1))[0] for k in range(2)]
    link = link_by_sightings(0, 1, parts, clock_search=0.0)
    assert link.refusal


def test_thin_legs_are_furniture_and_robots_are_not():
    generator = np.random.default_rng(9)
    leg = worlds.Still((0.3, 0.2, 0.0))  # as thin as a head
    ways = [worlds.Curve(generator, size=(0.8, 0.7)), worlds.Curve(generator, size=(0.8, 0.7)), leg]
    track = worlds.perfect_track(ways, 0, worlds.polygon(12, 1.226), 40.0, 1)
    (part,) = fragments(track)
    start = np.array([np.interp(track.times[0], track.log.truth_times, track.log.truth[:, k]) for k in range(3)])
    place = transform(inverse(start), np.array([[0.3, 0.2]]))
    at_leg = np.linalg.norm(part.sightings.points - place, axis=1) < 0.03
    found = furniture(part)
    assert np.count_nonzero(at_leg) > 100
    assert found[at_leg].mean() > 0.99
    far = np.linalg.norm(part.sightings.points - place, axis=1) > 0.15
    assert found[far].mean() < 0.05
