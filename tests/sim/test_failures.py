"""Robots that stop working at drawn times: what they do, what others see, what traces and replays tell."""

import io
from dataclasses import replace

import numpy as np
import pytest

from mercator_design.config.loading import parse as parse_file
from mercator_design.config.writing import digest_of, dump
from mercator_design.errors import MissionError
from mercator_design.fsm import parse
from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.results.experiments.traces import read_trace
from mercator_design.show.replay import replay_of
from mercator_design.show.text.recording import write_recording
from mercator_design.sim.robot_model import RobotModel, load_robot_model
from mercator_design.sim.robot_parts import Failures
from mercator_design.sim.simulate import Simulator
from mercator_design.software.architectures import DARK
from mercator_design.software.files import parse_software
from tests.own_modules import BLINKS, blink, entered
from tests.sim.worlds import at, mission, simulator
from tests.twin.test_other_software import TREE

pytestmark = pytest.mark.together("kernels")  # compiled once

WALK = parse("--nstates 1 --s0 0 --rwm0 20")
MERCATOR = load_robot_model("mercator")
HALFWAY = Failures(share=1.0, between=(0.5, 0.5))


def failing(failures, **given):
    return simulator(robot_model=replace(MERCATOR, failures=failures), **given)


@pytest.mark.parametrize("referee", [False, True])
def test_a_robot_works_as_ever_until_it_stops(referee):
    whole = simulator(robots=3).run(WALK, 1).trace
    trace = failing(HALFWAY, robots=3).run(WALK, 1, referee=referee).trace
    assert trace.stops.tolist() == [50] * 3
    assert trace.failure_times.tolist() == pytest.approx([5.1] * 3)
    assert (trace.poses[:52] == whole.poses[:52]).all()  # a command moves the treads one cycle later
    assert np.abs(trace.poses[60:] - trace.poses[60]).max() < 1e-3  # it has braked
    assert np.abs(whole.poses[60:] - whole.poses[60]).max() > 0.1


def test_the_referee_agrees():
    failures = Failures(share=0.7)
    fast, slow = (failing(failures, robots=5).run(WALK, 3, referee=referee).trace for referee in (False, True))
    assert (fast.poses == slow.poses).all()
    assert (fast.states == slow.states).all()


def test_failures_that_never_happen_change_no_score():
    before, after = simulator(robots=3).run(WALK, 1), failing(Failures(), robots=3).run(WALK, 1)
    assert (before.trace.poses == after.trace.poses).all()
    assert before.score == after.score
    assert before.trace.stops is None
    assert not after.trace.failed.any()
    assert np.isinf(after.trace.failure_times).all()


def test_robot_models_without_failures_keep_their_digests():
    assert "failures" not in dump(MERCATOR)
    assert "failures" in dump(replace(MERCATOR, failures=HALFWAY))
    assert digest_of(replace(MERCATOR, failures=HALFWAY)) != digest_of(MERCATOR)


def test_a_failed_robot_is_seen_and_in_the_way():
    model = replace(MERCATOR, failures=Failures(share=1.0, between=(0.0, 0.0)))
    near = {"robots": 2, "placement": at((0.0, 0.0, 0.0), (0.4, 0.0, 0.0)), "duration": 1}
    recording = Simulator(mission(**near), model).run(WALK, 1, record=True).recording
    assert (recording.measure("neighbours")[:, :, 0] == 0.0).all()  # it perceives nothing itself ...
    assert (np.isfinite(recording.measure("proximity")).any(axis=2)).all()  # ... but stands where others see it


def test_lamps_that_show_the_state_are_off_too():
    shown = failing(HALFWAY, robots=2).run(WALK, 1, record=True).recording.measure("leds")
    assert (shown[:50] > 0.0).any()
    assert (shown[50:] == 0.0).all()


def test_lamps_and_signals_of_a_failed_robot_are_off():
    with entered(blink, **BLINKS) as flavour:
        software = parse("--nstates 1 --s0 0 --led0 4 --call0 5", flavour.name)
        failures = Failures(share=1.0, between=(0.02, 0.02))
        outcome = failing(failures, robots=2).run(software, 1, record=True)
    assert outcome.history.led_colours[2:, 0].tolist() == [0] * 98
    assert outcome.history.signals[2:, 0].tolist() == [0] * 98
    assert (outcome.recording.measure("leds") == 0.0).all()
    assert (outcome.recording.measure("wheels")[2:] == 0.0).all()


def test_a_larger_share_stops_the_same_robots_and_others():
    draws = [Failures(share=share).times(np.random.default_rng(1), 1000, 100.0) for share in (0.2, 0.5)]
    stopped = [np.isfinite(times) for times in draws]
    assert (stopped[1] | ~stopped[0]).all()
    assert (draws[0][stopped[0]] == draws[1][stopped[0]]).all()
    assert (Failures(share=0.5).times(np.random.default_rng(1), 10, 100.0) == draws[1][:10]).all()


def test_the_times_have_their_distributions():
    """The Kolmogorov-Smirnov distance of 20 000 draws exceeds 0.02 with a chance of about 2 exp(-16), 2e-7."""
    by_rate = np.sort(Failures(rate=0.1).times(np.random.default_rng(1), 20_000, 100.0))
    expected = 1.0 - np.exp(-0.1 * by_rate)
    assert np.abs(expected - (np.arange(20_000) + 0.5) / 20_000).max() < 0.02
    by_share = Failures(share=1.0, between=(0.25, 0.75)).times(np.random.default_rng(1), 20_000, 100.0)
    expected = (np.sort(by_share) - 25.0) / 50.0
    assert np.abs(expected - (np.arange(20_000) + 0.5) / 20_000).max() < 0.02


def test_instances_draw_their_own_failures():
    stops = [failing(Failures(share=0.5), robots=5).instance(seed).start.stops.tolist() for seed in range(6)]
    assert len({tuple(one) for one in stops}) > 1
    assert stops[0] == failing(Failures(share=0.5), robots=5).instance(0).start.stops.tolist()


def test_a_trace_tells_and_a_file_keeps_it(tmp_path):
    sim = failing(HALFWAY, robots=2)
    outcome = sim.run(WALK, 1, record=True)
    frame = outcome.trace.to_frame()
    assert frame[frame["robot"] == 1]["failed"].tolist() == [0] * 50 + [1] * 50
    assert "failed" not in simulator(robots=2).run(WALK, 1).trace.to_frame()
    for suffix in (".csv", ".npz"):
        file, stream = tmp_path / f"trace{suffix}", io.BytesIO()
        write_recording(stream, outcome.trace, (), every=1, suffix=suffix, turns=None)
        file.write_bytes(stream.getvalue())
        assert read_trace(file, sim, 1, WALK).trace.stops.tolist() == [50, 50]


def test_replays_and_films_show_failed_robots():
    shown = ShownExperiment.simulated(failing(HALFWAY, robots=2), WALK, 1)
    assert replay_of(shown)["header"]["stops"] == [50, 50]
    assert shown.colours_at(50).tolist() != [DARK] * 2
    assert shown.colours_at(51).tolist() == [DARK] * 2
    assert replay_of(ShownExperiment.simulated(simulator(), WALK, 1))["header"]["stops"] is None


def test_trees_are_lit_up_to_the_failure():
    tree = parse_software(TREE, "maple-mercator")
    shown = ShownExperiment.simulated(failing(HALFWAY, robots=2), tree, 1)
    whole = ShownExperiment.simulated(simulator(robots=2), tree, 1)
    assert (shown.activity[:50] == whole.activity[:50]).all()
    assert (shown.activity[50:] == 0).all()


def test_bounds_are_in_order():
    with pytest.raises(MissionError, match="between: expected the smaller first"):
        parse_file("failures: {share: 0.5, between: [0.7, 0.2]}", RobotModel, error=MissionError)
