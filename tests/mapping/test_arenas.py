"""The front end on logs of the simulator: skewed turns, odometry that drifts, heads of other robots."""

import numpy as np
import pytest

from mercator_design.fsm import parse
from mercator_design.mapping import poses
from mercator_design.mapping.front.front_end import FrontEnd
from mercator_design.mapping.merit.trajectories import relative_error, robot_error
from mercator_design.mapping.readers.simulation import simulated_logs
from mercator_design.missions.mission import load_mission

ARENAS = ("map_corridor", "map_dodecagon", "map_empty_dodecagon", "map_hall", "map_rooms")

pytestmark = pytest.mark.together("kernels")  # the simulator's are compiled once


def log_of(arena, seconds, seed):
    mission = load_mission(arena, (f"duration={seconds}", "robot_model=mercator-drifting"))
    return simulated_logs(mission, parse("--nstates 1 --s0 0 --rwm0 20"), seed)[0]


def truth_of(track):
    return poses.interpolate(track.log.truth_times, track.log.truth, track.times)


def check(log):
    track = FrontEnd(log).run()
    true = truth_of(track)
    assert robot_error(track.poses, true).rmse < 0.005
    assert track.shares[1:].min() > 0.85
    assert track.n_segments == 1
    steps = poses.between(
        poses.between(true[:-1], true[1:]), poses.between(track.poses[:-1], track.poses[1:])
    )  # no bad one
    assert np.hypot(steps[:, 0], steps[:, 1]).max() < 0.05
    assert np.abs(steps[:, 2]).max() < np.radians(3.0)


def without_beam_times(log):
    turns = [one._replace(times=one.middle + 1e-9 * np.arange(len(one.times))) for one in log.turns]
    return type(log)(
        *(log.name, turns, log.odometry_times, log.odometry, log.lidar_pose),
        truth_times=log.truth_times,
        truth=log.truth,
    )


def test_an_arena():
    log = log_of("map_dodecagon", 15, 1)
    check(log)
    skewed = FrontEnd(without_beam_times(log)).run()
    assert robot_error(skewed.poses, truth_of(skewed)).rmse > 0.02


@pytest.mark.thorough
@pytest.mark.parametrize("arena", ARENAS)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_all_arenas(arena, seed):
    log = log_of(arena, 30, seed)
    check(log)
    skewed = FrontEnd(without_beam_times(log)).run()
    pairs = np.column_stack([np.arange(len(log.turns) - 1), np.arange(1, len(log.turns))])
    wrong = relative_error(skewed.poses, truth_of(skewed), pairs)
    right = relative_error(FrontEnd(log).run().poses, truth_of(skewed), pairs)
    assert wrong.translation > 3 * right.translation
