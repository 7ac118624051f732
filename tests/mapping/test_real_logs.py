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


@pytest.mark.parametrize(("name", "place"), [("intel", 0.033), ("csail", 0.032)])
@pytest.mark.parametrize("seed", [1, 2])
def test_places_that_are_seen_again_are_where_they_were(name, place, seed):
    """Relative poses of scans nearer than 2 m, far apart in the log; the corrected poses err by 2 to 3 cm, too."""
    (log,) = carmen_robots(name, seed, 1)
    (track,) = map_swarm([log]).tracks
    assert track.n_segments == 1
    true = poses.interpolate(log.truth_times, log.truth, track.times)
    error = relative_error(track.poses, true, near_pairs(true, np.random.default_rng(1), lambda i, j: j - i >= 30))
    assert error.pairs > 400
    assert error.translation < place
    assert error.rotation < np.radians(0.55)
