"""Logs that no map can be made of are refused, with a reason."""

from dataclasses import replace

import numpy as np
import pytest

from mercator_design.errors import MercatorError
from mercator_design.mapping.logs import RobotLog
from mercator_design.mapping.readers.checking import checked
from tests.mapping import analytic


@pytest.fixture(scope="module")
def log():
    return analytic.log(seconds=1.0)


def changed(log, number, **arrays):
    turns = [*log.turns]
    turns[number] = turns[number]._replace(**arrays)
    return replace(log, turns=turns)


def test_a_good_log_is_as_it_was(log):
    assert checked(log, "file") is log


def test_turns_without_beams_are_left_out(log):
    nothing = np.zeros(0)
    found = checked(changed(log, 2, times=nothing, angles=nothing, ranges=nothing), "file")
    assert len(found.turns) == len(log.turns) - 1


def test_a_log_of_nothing(log):
    assert checked(RobotLog("robot", [], np.zeros(0), np.zeros((0, 3))), "file").turns == []


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda log: replace(log, odometry_times=log.odometry_times[:1], odometry=log.odometry[:1]), "2 or more"),
        (lambda log: replace(log, odometry=log.odometry[:-1]), "a pose for each time"),
        (lambda log: replace(log, odometry_times=log.odometry_times[::-1]), "odometry: expected times that rise"),
        (lambda log: replace(log, odometry_times=log.odometry_times * np.nan), "odometry: expected times in seconds"),
        (lambda log: replace(log, odometry=log.odometry * np.inf), "odometry: expected poses"),
        (lambda log: replace(log, turns=log.turns[::-1]), "turns: expected times that rise"),
        (lambda log: changed(log, 1, ranges=log.turns[1].ranges[:-1]), "turn 2: expected a time, an angle and a range"),
        (lambda log: changed(log, 1, times=log.turns[1].times[::-1]), "in the order of time"),
        (lambda log: changed(log, 1, angles=log.turns[1].angles + np.nan), "turn 2: expected angles"),
    ],
)
def test_what_is_refused(log, wrong, message):
    with np.errstate(invalid="ignore"), pytest.raises(MercatorError, match=f"file: robot: .*{message}"):
        checked(wrong(log), "file")


def test_readings_that_no_lidar_has_are_left_out_and_told(log):
    ranges = log.turns[1].ranges.copy()
    ranges[:3] = [-1.0, np.nan, 1e5]
    found = checked(changed(log, 1, ranges=ranges), "file")
    assert found.notes == ("3 readings below 0 or beyond 10000 m are left out.",)
    assert found.turns[1].ranges[:3].tolist() == [0.0, 0.0, 0.0]
    assert np.array_equal(found.turns[1].ranges[3:], ranges[3:])
    assert found.truth is log.truth


def test_the_second_of_two_turns_of_one_time_is_left_out_and_told(log):
    found = checked(replace(log, turns=[log.turns[0], *log.turns]), "file")
    assert len(found.turns) == len(log.turns)
    assert found.notes == ("1 turns of the same time as the one before are left out.",)
