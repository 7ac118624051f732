"""What modules set beside the wheels: LED colours and signals, in experiments, recordings and replays."""

import io

import numpy as np
import pandas as pd
import pytest

from mercator_design.errors import SimulationError
from mercator_design.fsm import parse
from mercator_design.modules.reference import LED_COLOURS, led_colour_of, signal_of
from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.results.experiments.traces import read_trace
from mercator_design.show.replay import replay_of
from mercator_design.show.text.recording import write_recording
from tests.own_modules import BLINKS, blink, entered
from tests.show.test_replay import unpacked
from tests.sim.worlds import simulator

pytestmark = pytest.mark.together("kernels")  # compiled once

LATER = "--n0 1 --n0x0 0 --c0x0 0 --p0x0 1"
"""Another state follows at once."""


@pytest.fixture
def blinking():
    with entered(blink, **BLINKS) as flavour:
        yield lambda text: parse(text, flavour.name)


def levels(number):
    return [*LED_COLOURS.values()][number]


@pytest.mark.parametrize("referee", [False, True])
def test_an_experiment_has_what_modules_set(blinking, referee):
    history = simulator(robots=2).run(blinking("--nstates 1 --s0 0 --led0 4 --call0 5"), 1, referee=referee).history
    assert history.led_colours[:, 1].tolist() == [-1, -1] + [4] * 98
    assert history.signals[:, 1].tolist() == [0, 0, 5] + [0] * 97


def test_lamps_show_what_modules_set_and_not_the_state(blinking):
    recording = simulator(robots=2).run(blinking("--nstates 1 --s0 0 --led0 4 --call0 5"), 1).recording
    shown = recording.measure("leds")
    assert (shown[:2] == 0).all()
    assert (shown[2:] == (255, 255, 0)).all()


def test_it_depends_on_the_software_whether_lamps_show_the_state(blinking):
    off = simulator().run(blinking("--nstates 1 --s0 0 --led0 -1 --call0 0"), 1).recording.measure("leds")
    assert (off == 0).all()
    state = simulator().run(blinking("--nstates 1 --s0 1"), 1).recording.measure("leds")
    assert (state == (0, 114, 178)).all()
    later = f"--nstates 2 --s0 1 {LATER} --s1 0 --led1 1 --call1 0"
    other = simulator().run(blinking(later), 1).recording.measure("leds")
    assert (other[:3] == 0).all()
    assert (other[-1] == (0, 255, 0)).all()


@pytest.mark.parametrize("referee", [False, True])
@pytest.mark.parametrize(
    ("values", "named"),
    [
        ("--led0 7 --call0 0", "led_colour: expected a whole number from -1 to 6"),
        ("--led0 0.5 --call0 0", "led_colour: expected"),
        ("--led0 -2 --call0 0", "led_colour: expected"),
        ("--led0 0 --call0 8", "signal: expected a whole number from 0 to 7"),
        ("--led0 0 --call0 -1", "signal: expected"),
        ("--led0 0 --call0 2.25", "signal: expected"),
    ],
)
def test_wrong_numbers_are_errors(blinking, values, named, referee):
    with pytest.raises(SimulationError, match=named) as error:
        simulator().run(blinking(f"--nstates 1 --s0 0 {values}"), 1, referee=referee)
    assert "robot 0 in cycle 2" in str(error.value)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf"), 1e300])
def test_numbers_that_are_no_integers(value):
    assert (led_colour_of((0.0, 0.0, value, 0.0)), signal_of((0.0, 0.0, -1.0, value))) == (-2, -2)


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_recordings_have_them_and_are_read_again(blinking, suffix, tmp_path):
    software, world = blinking("--nstates 1 --s0 0 --led0 6 --call0 7"), simulator(robots=2)
    trace = world.run(software, 1, record=True).trace
    file = io.BytesIO()
    write_recording(file, trace, ["leds"], every=1, suffix=suffix)
    path = tmp_path / f"trace{suffix}"
    path.write_bytes(file.getvalue())
    if suffix == ".csv":
        table = pd.read_csv(path)
        assert [*table][5:9] == ["state", "led_colour", "signal", "leds_0"]
        assert table.signal.tolist() == trace.signals.ravel().tolist()
    found = read_trace(path, world, 1, software).trace
    assert np.array_equal(found.led_colours, trace.led_colours)
    assert np.array_equal(found.signals, trace.signals)


def test_a_replay_has_them_where_a_module_sets_them(blinking):
    software = blinking("--nstates 1 --s0 0 --led0 3 --call0 7")
    shown = ShownExperiment.simulated(simulator(robots=2), software, 1)
    replay = replay_of(shown)
    assert replay["header"]["machines"][0]["sets"] == ["led_colour", "signal", "wheels"]
    assert replay["header"]["ledColours"][3] == {"name": "red", "colour": "#ff0000"}
    assert unpacked(replay)["led_colour"][1].tolist() == [0, 0] + [3] * 98
    assert unpacked(replay)["signal"][0, :4].tolist() == [0, 0, 7, 0]
    usual = replay_of(ShownExperiment.simulated(simulator(), blinking("--nstates 1 --s0 1"), 1))
    assert not {"led_colour", "signal"} & unpacked(usual).keys()
