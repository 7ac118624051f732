"""The lag of a lidar's clock comes back from how the robot turns."""

import numpy as np
import pytest

from mercator_design.mapping.front import lag
from mercator_design.mapping.front.lag import lag_of, track_of
from tests.mapping import analytic


@pytest.mark.parametrize("late", [-0.08, 0.0, 0.04])
def test_it_comes_back(late):
    assert track_of(analytic.log(seconds=15.0, late=late)).lag == pytest.approx(-late, abs=0.002)


def test_a_robot_that_turns_evenly_tells_nothing():
    even = lambda times: np.column_stack([0.2 * np.sin(times), 0.2 * np.cos(times), np.asarray(times)])  # noqa: E731
    assert lag_of(analytic.log(pose_at=even, seconds=8.0, late=0.03)) == 0.0


def test_a_log_without_turns_has_none():
    assert lag_of(analytic.log(seconds=0.0)) == 0.0


def test_what_was_found_stays_when_a_later_round_tells_nothing(monkeypatch):
    told = iter([0.03, None])
    monkeypatch.setattr(lag, "remaining_lag", lambda track: next(told))
    assert lag_of(analytic.log(seconds=2.0)) == 0.03


def test_a_lag_beyond_all_bounds_is_none(monkeypatch):
    monkeypatch.setattr(lag, "remaining_lag", lambda track: 0.3)
    assert lag_of(analytic.log(seconds=2.0)) == 0.0
