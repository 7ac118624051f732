"""Maps of buildings that share a part: the right frame, or none."""

from dataclasses import replace

import numpy as np
import pytest

from mercator_design.mapping.frames.fragment import fragments, keyframes_of
from mercator_design.mapping.frames.map_matching import match_maps
from mercator_design.mapping.frames.overlap import MIN_REACH, overlap, reach_of
from mercator_design.mapping.frames.walls import field_of, walls_of
from mercator_design.mapping.front.front_end import FrontEnd
from mercator_design.mapping.merit.trajectories import swarm_error
from mercator_design.mapping.poses import compose, inverse
from mercator_design.mapping.track import Keyframes
from tests.mapping import analytic, worlds
from tests.mapping.test_loops import CORNERS, corridor_log

pytestmark = pytest.mark.together

OUTER = worlds.room([[-7, -5], [7, -5], [7, 1], [10, 1], [10, 5], [2, 5], [2, 7], [-7, 7]])
INNER = worlds.room([[-5, -3], [5, -3], [5, 3], [0, 3], [0, 5], [-5, 5]])
WAY = np.array([[-6, -4], [6, -4], [6, 3], [8, 3], [8, 4], [1, 4], [1, 6], [-6, 6]])
SYMMETRIC = [analytic.box(-7, -5, 7, 5), analytic.box(-5, -3, 5, 3)]


def keyframes_in(log, low, high):
    """The keyframes of a part of a log, in a frame of their own, and their true poses."""
    n = len(log.turns)
    rows = slice(round(low * n), round(high * n))
    odometry = compose(inverse(log.odometry[rows][0]), log.odometry[rows])
    track = FrontEnd(
        replace(log, turns=log.turns[rows], odometry_times=log.odometry_times[rows], odometry=odometry)
    ).run()
    (part,) = fragments(track)
    return part, log.truth[rows][track.keyframes.turns]


def matched(log, *cuts):
    """What is found of two parts of a log, and their true poses."""
    (first, one), (second, other) = (keyframes_in(log, *cut) for cut in cuts)
    nowhere = np.zeros((1, 3))
    walls = [walls_of([part], nowhere) for part in (first, second)]
    match = match_maps(walls[1], field_of(walls[0]), walls[0])
    found = overlap(keyframes_of([first], nowhere), keyframes_of([second], nowhere), match.peaks)
    return found, [one, other]


def test_a_part_that_two_maps_share_gives_the_frame():
    found, true = matched(corridor_log(1, 1, walls=[OUTER, INNER], corners=WAY), (0.0, 0.8), (0.2, 1.0))
    assert found.refusal == ""
    assert found.scans > 40
    n = len(true[0])
    assert swarm_error([found.poses[:n], found.poses[n:]], true).rmse < 0.1
    begin, end = found.poses[n], compose(found.frame, np.zeros(3))  # the second map begins at its first scan
    assert np.hypot(*(begin - end)[:2]) < 0.5


@pytest.mark.parametrize("walls", [SYMMETRIC, [OUTER, INNER]])
def test_halves_that_share_nothing_stay_apart(walls):
    """Of the symmetric ring, all of one half fits the other one; so do its corners."""
    corners = CORNERS if walls is SYMMETRIC else WAY
    found, _ = matched(corridor_log(1, 1, walls=walls, corners=corners), (0.0, 0.5), (0.5, 1.0))
    assert found is None or found.refusal


def test_small_maps_are_not_searched():
    places = np.column_stack([np.linspace(0.0, MIN_REACH - 0.1, 9), np.zeros((9, 2))])
    nothing = np.zeros((0, 2), np.float32)
    small = Keyframes(np.arange(9), places, np.zeros(9, int), np.zeros(10, int), nothing, nothing)
    assert overlap(small, small, [np.zeros(3)]) is None


def test_the_reach_is_along_the_longest_axis():
    places = np.array([[0.0, 0.0, 1.0], [3.0, 4.0, 2.0], [1.5, 2.0, 0.0]])
    assert reach_of(places) == pytest.approx(5.0)
    assert reach_of(places[:1]) == 0.0
