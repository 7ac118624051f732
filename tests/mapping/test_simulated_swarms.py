"""Swarms of the simulator, whose lidars skew and whose odometries drift, are mapped from unknown starts."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.mapping import links_of, window_of
from benchmarks.mapping_logs import cut, explored, shifted
from benchmarks.mapping_truth import occupancy, pose_errors
from mercator_design.mapping.frames.fragment import fragments
from mercator_design.mapping.frames.map_matching import match_maps
from mercator_design.mapping.frames.walls import field_of, walls_of
from mercator_design.mapping.front.lag import track_of
from mercator_design.mapping.merit.merits import merit_of
from mercator_design.mapping.plan.plans import plans_of
from mercator_design.mapping.swarm import map_swarm

pytestmark = [pytest.mark.together("simulated swarms"), pytest.mark.thorough]

DURATION = 90.0
ROOMS, EMPTY, CORRIDOR = "map_rooms", "map_empty_dodecagon", "map_corridor"


@functools.cache
def logs_of(arena):
    return explored(arena, 1, DURATION)


@pytest.mark.parametrize("arena", [EMPTY, ROOMS, CORRIDOR, "map_hall", "map_dodecagon"])
def test_the_map_is_right(arena):
    found = map_swarm(logs_of(arena), clock_search=0.0)
    assert found.n_maps == 1
    pairs = links_of(found)
    assert len(pairs) == len(found.tracks) * (len(found.tracks) - 1) // 2
    for pair in pairs:
        assert pair["joined"]
        assert pair["distance"] < 0.005
        assert pair["degrees"] < 0.15
    merit = merit_of(plans_of(found)[0])
    keyframes, turns = pose_errors(merit.keyframes), pose_errors(merit.turns)
    assert keyframes["rmse"] < 2.0
    assert keyframes["largest"] < 25.0
    assert turns["rmse"] < 4.0
    assert turns["yaw"] < 0.4
    assert occupancy(merit)["0.05"]["precision"] > 0.98


def test_in_an_empty_dodecagon_sightings_join_and_maps_do_not():
    tracks = [track_of(log) for log in logs_of(EMPTY)[:2]]
    walls = [walls_of(fragments(track), [np.zeros(3)]) for track in tracks]
    match = match_maps(walls[1], field_of(walls[0]), walls[0])
    assert match.refusal
    assert match.second > 0.8


@pytest.mark.parametrize("arena", [ROOMS, EMPTY])
def test_no_window_is_joined_wrongly(arena):
    logs = logs_of(arena)
    generator = np.random.default_rng(4)
    joined = 0
    for number in range(20):
        a, b = generator.choice(len(logs), 2, replace=False)
        start, other = generator.uniform(0.0, 30.0), generator.uniform(40.0, DURATION - 20.0)
        second = shifted(cut(logs[b], other, 20.0), start - other) if number % 2 else cut(logs[b], start, 20.0)
        row = window_of([cut(logs[a], start, 20.0), second])
        joined += row["joined"]
        assert not row["joined"] or row["right"], row
    assert joined >= 2


@pytest.mark.parametrize("offset", [-1.37, 0.42, 2.0])
def test_clocks_come_back_to_2_ms(offset):
    logs = logs_of(EMPTY)
    found = map_swarm([logs[0], shifted(logs[1], offset), logs[2]])
    assert found.n_maps == 1
    assert [float(one[0]) for one in found.offsets] == pytest.approx([0.0, offset, 0.0], abs=0.002)


@pytest.mark.parametrize("seconds", [0.04, -0.03])
def test_a_lidar_whose_times_are_off_is_corrected(seconds):
    logs = [
        replace(log, turns=[turn._replace(times=turn.times + seconds) for turn in log.turns]) for log in logs_of(EMPTY)
    ]
    found = map_swarm(logs, clock_search=0.0)
    assert [track.lag for track in found.tracks] == pytest.approx([-seconds] * 3, abs=0.005)
    assert pose_errors(merit_of(plans_of(found)[0]).turns)["rmse"] < 4.0


def test_a_round_arena_turns_together_at_most():
    found = map_swarm(explored("circle", 1, DURATION), clock_search=0.0)
    assert found.n_maps == 1
    error = pose_errors(merit_of(plans_of(found)[0]).keyframes)
    assert error["rmse"] < 30.0
    assert error["yaw"] < 2.5


def test_the_order_of_robots_does_not_matter():
    logs = logs_of(EMPTY)
    errors = [pose_errors(merit_of(plans_of(map_swarm(one))[0]).keyframes) for one in (logs, logs[::-1])]
    assert errors[0]["rmse"] < 2.0
    assert errors[0]["rmse"] == pytest.approx(errors[1]["rmse"], abs=0.3)
