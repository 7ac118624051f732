"""Maps of real logs, whose folder an environment variable names: odometry is made from their corrected poses."""

import os

import numpy as np
import pytest

from benchmarks.mapping_logs import CARMEN, carmen_robots
from mercator_design.mapping import poses
from mercator_design.mapping.merit.trajectories import near_pairs, relative_error
from mercator_design.mapping.swarm import map_swarm

pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(CARMEN not in os.environ, reason="no folder of real logs is named"),
]


PLACES = {"intel": 0.033, "csail": 0.032}  # [m]


def near_error(tracks):
    """Relative poses of scans nearer than 2 m, far apart in the log; the corrected poses err by 2 to 3 cm, too."""
    times = np.concatenate([track.times for track in tracks])
    found = np.concatenate([track.poses for track in tracks])
    log = tracks[0].log
    true = poses.interpolate(log.truth_times, log.truth, times)
    order = np.argsort(times, kind="stable")
    scans = times[order].round()  # a second apart; the same scan may be in two logs
    pairs = near_pairs(true[order], np.random.default_rng(1), lambda i, j: scans[j] - scans[i] >= 30)
    error = relative_error(found[order], true[order], pairs)
    assert error.pairs > 300
    return error


MISSED = pytest.mark.xfail(reason="0.53 degrees, where 0.5 are wanted", strict=True)


@pytest.mark.parametrize(
    ("name", "seed"),
    [*((name, seed) for name in PLACES for seed in (1, 2)), ("intel", 3), pytest.param("csail", 3, marks=MISSED)],
)
def test_places_that_are_seen_again_are_where_they_were(name, seed):
    (log,) = carmen_robots(name, seed, 1)
    (track,) = map_swarm([log]).tracks
    assert track.n_segments == 1
    error = near_error([track])
    assert error.translation < PLACES[name]
    assert error.rotation < np.radians(0.5)


@pytest.mark.parametrize("name", PLACES)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_three_robots_that_saw_overlapping_parts_have_one_map(name, seed):
    found = map_swarm(carmen_robots(name, seed, 3), clock_search=0.0)
    assert found.n_maps == 1
    error = near_error(found.tracks)
    assert error.translation < PLACES[name]
    assert error.rotation < np.radians(0.5)
