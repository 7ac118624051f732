"""What goes wrong with real robots: the map is right without it, or separate, and a sentence says so."""

import math
from dataclasses import replace

import numpy as np
import pytest

from mercator_design.mapping.merit.trajectories import swarm_error
from mercator_design.mapping.plan.plans import plans_of
from mercator_design.mapping.poses import interpolate
from mercator_design.mapping.swarm import map_swarm
from tests.mapping import worlds

pytestmark = [pytest.mark.together, pytest.mark.thorough]

DODECAGON = worlds.polygon(12, 1.226)
SCALES = (1.04, 0.965, 1.03)


def curves(n, seed=3, size=(0.8, 0.7)):
    generator = np.random.default_rng(seed)
    return [worlds.Curve(generator, size=size, speed=0.25) for _ in range(n)]


def logs_of(ways, walls=DODECAGON, duration=30.0, **options):
    return [worlds.drifting_log(ways, k, walls, duration, 1, scale=SCALES[k % 3], **options) for k in range(len(ways))]


def error_of(found, number=0):
    """The error of all turns of one map, after the last pass over them."""
    ways = plans_of(found)[number].ways
    true = [interpolate(way.log.truth_times, way.log.truth, way.times) for way in ways]
    return swarm_error([way.poses for way in ways], true)


def parts_of(found, number=0):
    return {found.tracks[track].log.name for track, _ in found.turns_of(number)}


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_missing_turns_change_nothing(share):
    found = map_swarm(logs_of(curves(2), duration=60.0, missing=share), clock_search=0.0)
    assert found.n_maps == 1
    assert error_of(found).rmse < 0.004


def test_a_gap_of_15_seconds_is_bridged():
    logs = logs_of(curves(2), duration=60.0)
    gap = [turn for turn in logs[0].turns if not 20.0 < turn.middle < 35.0]
    found = map_swarm([replace(logs[0], turns=gap), logs[1]], clock_search=0.0)
    assert found.n_maps == 1
    assert found.tracks[0].n_segments == 1
    assert error_of(found).rmse < 0.004


def test_noise_of_3_centimetres():
    found = map_swarm(logs_of(curves(2), noise=0.03), clock_search=0.0)
    assert found.n_maps == 1
    assert error_of(found).rmse < 0.006


@pytest.mark.parametrize("offset", [2.0, -1.37, 0.42])
def test_clocks_that_differ(offset):
    ways = curves(2)
    logs = [worlds.drifting_log(ways, k, DODECAGON, 40.0, 1, clock=(0.0, offset)[k]) for k in range(2)]
    found = map_swarm(logs)
    assert found.n_maps == 1
    assert found.offsets[1][0] == pytest.approx(offset, abs=0.006)  # in which the robots drive 1.5 mm
    assert error_of(found).rmse < 0.004


def test_a_carried_robot_continues_in_the_same_map_by_sightings():
    ways = curves(2, size=(0.5, 0.5))
    ways[0] = worlds.Carried(ways[0], 25.03, (0.3, 0.1, math.radians(168.0)))
    found = map_swarm(logs_of(ways, duration=60.0), clock_search=0.0)
    assert found.tracks[0].n_segments == 2
    assert found.n_maps == 1
    assert sorted(found.maps[0]) == [0, 0]
    assert error_of(found).rmse < 0.005


def test_a_carried_robot_without_others_in_a_symmetric_arena_has_two_maps():
    ways = [worlds.Carried(curves(1, size=(0.5, 0.5))[0], 15.03, (0.3, 0.1, math.radians(168.0)))]
    found = map_swarm(logs_of(ways))
    assert found.tracks[0].n_segments == 2
    assert found.n_maps == 2
    assert any(message.startswith("2 separate maps: robot 0 (part") for message in found.messages)
    assert all(error_of(found, number).rmse < 0.004 for number in range(2))


def test_a_robot_that_stands_all_the_time_is_in_the_map():
    ways = [*curves(2), worlds.Still((0.5, -0.6, 2.0))]
    found = map_swarm(logs_of(ways), clock_search=0.0)
    assert found.n_maps == 1
    assert len(found.tracks[2].keyframes.turns) == 1
    assert error_of(found).rmse < 0.004


def test_robots_that_all_stand_have_maps_of_one_turn():
    ways = [worlds.Still((0.5, -0.6, 2.0)), worlds.Still((-0.4, 0.2, -1.0))]
    found = map_swarm(logs_of(ways, duration=10.0), clock_search=0.0)
    assert found.n_maps == 2
    assert [len(track.keyframes.turns) for track in found.tracks] == [1, 1]
    assert len(plans_of(found)[0].pieces) > 0


def test_robots_that_never_meet_have_separate_maps_where_the_arena_is_symmetric():
    # Each sees no other: they drive at different times.
    ways = curves(2)
    logs = [worlds.drifting_log([way], 0, DODECAGON, 25.0, k) for k, way in enumerate(ways)]
    found = map_swarm([logs[0], replace(logs[1], name="robot 1")])
    assert found.n_maps == 2
    assert any("not joined: a second frame of the maps" in message for message in found.messages)


def test_a_round_arena_is_held_by_sightings():
    found = map_swarm(logs_of(curves(3, size=(0.7, 0.7)), worlds.polygon(64, 1.25), duration=60.0), clock_search=0.0)
    assert found.n_maps == 1
    error = error_of(found)
    assert error.rmse < 0.03
    assert math.degrees(error.yaw_rms) < 2.5  # that all turn together nobody can see


def test_odometry_that_is_silent_for_seconds_leaves_the_rest_right():
    logs = logs_of(curves(2), duration=60.0)
    rows = (logs[0].odometry_times < 20.0) | (logs[0].odometry_times > 23.0)
    silent = replace(logs[0], odometry_times=logs[0].odometry_times[rows], odometry=logs[0].odometry[rows])
    found = map_swarm([silent, logs[1]], clock_search=0.0)
    assert found.n_maps == 1
    ways = plans_of(found)[0].ways
    kept = [(way.times < 19.5) | (way.times > 24.0) for way in ways]
    true = [
        interpolate(way.log.truth_times, way.log.truth, way.times[rows]) for way, rows in zip(ways, kept, strict=True)
    ]
    error = swarm_error([way.poses[rows] for way, rows in zip(ways, kept, strict=True)], true)
    assert error.rmse < 0.005


def test_ranges_that_are_noise_do_not_disturb_the_others():
    generator = np.random.default_rng(1)
    logs = logs_of(curves(2), duration=10.0)
    garbage = [turn._replace(ranges=generator.uniform(0.0, 5.0, len(turn.ranges))) for turn in logs[1].turns]
    found = map_swarm([logs[0], replace(logs[1], turns=garbage)], clock_search=1.0)
    assert parts_of(found) == {"robot 0"}
    assert error_of(found).rmse < 0.004


def test_a_robot_whose_lidar_sees_nothing_is_where_the_other_one_sees_it():
    logs = logs_of(curves(2), duration=10.0)
    blind = [turn._replace(ranges=np.zeros(len(turn.ranges))) for turn in logs[1].turns]
    found = map_swarm([logs[0], replace(logs[1], turns=blind)], clock_search=0.0)
    assert parts_of(found) == {"robot 0", "robot 1"}
    assert error_of(found).rmse < 0.03  # its odometry drifts
