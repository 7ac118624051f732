"""Scores of robots on twins against simulated ones: what benchmarks/twin_agreement.py computes."""

import json

import numpy as np
import pytest

from benchmarks import twin_agreement
from benchmarks.twin_agreement import (
    MISSIONS,
    Comparison,
    Result,
    case,
    compare,
    found,
    place,
    run_all,
    score,
    step,
    table,
    trace,
)
from benchmarks.twin_runs import Track, twin_was_late
from benchmarks.twin_stepped import stepped_run
from mercator_design.modules.flavour import flavour_of
from mercator_design.twin.arena import TwinArena
from tests.robot.ways import made_in_time

pytestmark = pytest.mark.together("kernels")  # compiled once


@pytest.fixture(scope="module")
def short():
    return case("aggregation", 3.0)


def test_the_fsms_have_all_modules():
    cases = [case(name) for name in MISSIONS]
    assert len(cases) >= 10
    used = {one.module.name for each in cases for _, one in each.pfsm.nodes}
    assert used == {module.name for module in flavour_of("watermelon").modules}


@pytest.mark.parametrize("name", ["aggregation", "foraging", "mapping", "cleaning"])
def test_the_simulators_poses_have_the_simulators_score(name):
    """The trace that is made of a twin's poses is the one that the simulator makes of the same."""
    what = case(name, 4.0)
    outcome = what.simulator.run(what.pfsm, 5)
    ours = trace(what, 5, outcome.trace.poses)
    assert what.simulator.mission.objective(ours) == outcome.score


def test_another_duration_takes_the_place_of_a_missions():
    """`aggregation_20` is shortened already; a setting that is given twice would be refused."""
    assert case("aggregation_20", 3.0).simulator.mission.duration == 3.0


def test_poses_of_another_seed_are_refused(short):
    poses = short.simulator.run(short.pfsm, 5).trace.poses
    with pytest.raises(SystemExit, match="did not start where the simulator's do"):
        trace(short, 6, poses)


def test_robots_at_the_twins_own_time(short):
    """They begin where those of the simulator do, stand in the first cycle, then drive; the same each time."""
    arenas = [TwinArena(short.simulator.mission, short.simulator.robot_model, 2) for _ in range(2)]
    one, same = (stepped_run(arena, short.pfsm, short.header, cycles=20, seed=2).poses for arena in arenas)
    assert one.shape == (21, 3, 3)
    assert np.array_equal(one, same)
    assert np.allclose(one[:2], short.simulator.instance(2).swarm.poses[:, :3], atol=1e-9)
    assert (np.hypot(*np.diff(one[5:, :, :2], axis=0).T).sum(axis=1) > 0.1).all()


@pytest.mark.thorough
def test_a_stepped_run_is_found_again(short, tmp_path):
    step("aggregation", 3.0, 2, tmp_path)
    result = found(short.plan(2), tmp_path)
    assert result.why_left_out == ""
    assert 0.0 <= score(short, 2, result, tmp_path) <= 3.0
    with pytest.raises(SystemExit, match="has another run"):
        found(short.plan(3), tmp_path)
    assert found(short.plan(2), tmp_path / "elsewhere") is None


def test_runs_that_were_late_or_failed_are_left_out_and_counted(short, tmp_path):
    results = [("", 0.0, 0.01), ("", 0.02, 0.01), ("", 0.0, 0.3), ("robot 0 failed: why", np.nan, np.nan)]
    poses = short.simulator.run(short.pfsm, 1).trace.poses
    for seed, (failure, late, twin_late) in enumerate(results, start=1):
        folder = tmp_path / place(short, seed)
        folder.mkdir(parents=True)
        result = Result(repr(short.plan(seed)), failure, (0.0,) * 3, late, twin_late)
        (folder / "run.json").write_text(json.dumps(result.__dict__))
        np.save(folder / "poses.npy", poses)
    (comparison,) = compare([short], range(1, 5), 3, tmp_path)
    assert comparison.left_out == {"failed": 1, "late": 2}
    assert (len(comparison.twin), len(comparison.simulated)) == (1, 3)


@pytest.mark.parametrize(("shift", "agrees"), [(0.0, True), (2.0, False)])
def test_the_table_says_what_differs(short, capsys, shift, agrees):
    """Two normal samples; a shift of two standard deviations with 20 and 200 values has p below 1e-8."""
    random = np.random.default_rng(1)
    simulated, twin = random.normal(size=200), random.normal(size=20) + shift
    same = Comparison(short, simulated, random.normal(size=20), {})
    assert table([same, Comparison(short, simulated, twin, {"late": 2})]) == agrees
    said = capsys.readouterr().out
    assert ("differs" in said) != agrees
    assert "| 2 late |" in said


def test_nothing_known_is_not_agreement(short, capsys):
    assert not table([Comparison(short, np.arange(9.0), np.empty(0), {"late": 20})])
    assert "nothing is known of aggregation" in capsys.readouterr().out


def test_how_late_a_twin_was():
    assert twin_was_late("12.0 s, 0.13 s of a core for each second; at most 31 ms late; 0 bytes that ...") == 0.031
    assert twin_was_late("Terminated") == np.inf


def test_the_nearest_poses(tmp_path):
    log = tmp_path / "twin.jsonl"
    events = [{"time": 0.0, "event": "clock", "start": 1.0, "at": "2026-11-22T10:00:00+00:00"}]
    events += [{"time": k / 10, "event": "poses", "poses": [[float(k), 0.0, 0.0]]} for k in range(5)]
    log.write_text("".join(json.dumps(event) + "\n" for event in events))
    assert Track(log).at(np.array([-0.2, 0.04, 0.06, 0.31, 9.0]))[:, 0, 0].tolist() == [0.0, 0.0, 1.0, 3.0, 4.0]


@pytest.mark.thorough
@made_in_time
def test_a_run_in_real_time(short, tmp_path):
    """Three robots begin at the same heartbeat; late they may be, as this machine may be busy."""
    run_all([(short, 2)], tmp_path, at_once=3, keep=False)
    result = found(short.plan(2), tmp_path / place(short, 2))
    assert result.failure == ""
    assert max(result.began) - min(result.began) < 1.0
    assert 0.0 <= score(short, 2, result, tmp_path / place(short, 2)) <= 3.0
    assert not list((tmp_path / place(short, 2)).glob("run*.jsonl"))


def test_the_time_that_all_takes_is_reported(tmp_path, capsys):
    assert twin_agreement.main([str(tmp_path), "--list", "--missions", "aggregation", "--runs", "8"]) == 0
    assert capsys.readouterr().out == "aggregation\nabout 3 minutes\n"
