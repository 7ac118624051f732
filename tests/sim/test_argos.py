"""Agreement with the original: recorded runs of ARGoS3 beta48, argos3-rvr and AutoMoDe-Watermelon, replayed."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.argos.recordings import mission_and_robot, read
from benchmarks.argos.repeat import Original
from benchmarks.argos.traces import READINGS, Trace, agreements, apart, copies_apart, drive
from mercator_design.sim.simulate import Simulator
from tests.tiers import some

pytestmark = pytest.mark.together("kernels")  # compiled once

RUNS = {run["name"]: run for run in read(Path(__file__).parents[1] / "data" / "argos_traces.json.gz")["runs"]}
FREE = ["explore_rwm20_n1", "attract5_n1", "stop_n5", "attract5_n5", "free_run_no_walls_n1"]
WALLS = ["blind_push_wall_n1_s17", "blind_push_wall_n1_s18", "blind_push_wall_n1_s19"]


@pytest.mark.parametrize("name", [*FREE, *WALLS])
def test_motion_where_robots_touch_at_most_walls(name):
    trace = Trace(RUNS[name])
    ours, first = drive(trace)
    position, heading = apart(ours, trace.poses)
    assert position.max() < 1e-4  # [m] after up to 60 s
    assert heading.max() < 1e-4  # [rad]
    assert (first[0] < trace.cycles) >= (name in WALLS)
    assert first[1] == trace.cycles


# Mean and largest distance [m] allowed over the whole run.
ROBOTS_TOUCH = {"four_state_n5": (0.001, 0.005), "blind_push_n8": (1e-4, 3e-4)}


@pytest.mark.thorough
@pytest.mark.parametrize("name", ROBOTS_TOUCH)
def test_motion_where_robots_touch_each_other(name):
    trace = Trace(RUNS[name])
    ours, first = drive(trace)
    position, heading = apart(ours, trace.poses)
    mean, most = ROBOTS_TOUCH[name]
    assert position.mean() < mean
    assert position.max() < most
    assert position[: first[1]].max() < 1e-4
    assert heading[: first[1]].max() < 1e-4
    assert position.mean() < copies_apart(trace, 5e-4, copies=4).mean(axis=(1, 2)).max()


@pytest.mark.thorough
def test_perception_and_wheel_commands():
    """On 99.9 % of the recorded robot-cycles; the rest is rounding of the recorded poses and readings."""
    counts = {}
    for run in RUNS.values():
        for kind, agreed_of_total in agreements(Trace(run)).items():
            counts[kind] = np.add(counts.get(kind, (0, 0)), agreed_of_total)
    assert set(counts) == set(READINGS)
    for kind, (agreed, total) in counts.items():
        assert total >= 1000, kind
        assert agreed / total >= 0.999, kind


@pytest.mark.swept
@pytest.mark.parametrize(
    "name", some([name for name in RUNS if name not in {"free_run_no_walls_n1", "attract5_n5", "blind_push_n8"}], 1)
)
def test_whole_run_from_its_seed(name):
    """Starts, draws, perception, control, motion: all from the seed, until robots touch each other."""
    run, trace = RUNS[name], Trace(RUNS[name])
    _, first = drive(trace)
    settings = {"n": trace.robots, "velocity": 30.0, **run["settings"], "n_robots": trace.robots}
    simulator = Simulator(*mission_and_robot(run["mission"], settings))
    _, history = Original(simulator).run(trace.fsm, run["seed"])
    position, heading = apart(history.poses[1 : trace.cycles + 1], trace.poses)
    assert position[: first[1]].max() < 2e-5  # [m] recorded to 1e-5
    assert heading[: first[1]].max() < 2e-5
    states = np.column_stack([robot["s1"] for robot in run["robots"].values()])
    assert (history.states[: trace.cycles] == states)[: first[1]].all()
