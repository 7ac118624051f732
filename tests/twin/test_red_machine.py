"""A PFSM that stops on red, on a floor of black and gray: robots of the twin stop as often as simulated ones, never."""

import numpy as np
import pytest

from benchmarks.twin_agreement import Case, trace
from benchmarks.twin_stepped import stepped_run
from mercator_design.config.colours import COLOURS
from mercator_design.fsm import parse
from mercator_design.missions.mission import load_mission
from mercator_design.modules.conditions import COLOUR_LABELS, colour_label
from mercator_design.sim.simulate import Simulator
from mercator_design.studies.statistics.rank_tests import rank_sum
from mercator_design.twin.arena import TwinArena
from tests.sim.test_labels import SEEK_RED

pytestmark = pytest.mark.together("kernels")  # compiled once

FLOOR = {COLOURS["black"], COLOURS["gray"]}


def case(duration, pfsm=SEEK_RED):
    """The mission `aggregation`, and an fsm.txt of it as a race writes it."""
    overrides = (f"duration={duration}",)
    return Case("aggregation", overrides, parse(pfsm), Simulator(load_mission("aggregation", overrides)))


def on_twin(what, seed):
    mission, model = what.simulator.mission, what.simulator.robot_model
    return stepped_run(TwinArena(mission, model, seed), what.pfsm, what.header, cycles=mission.cycles, seed=seed)


def in_simulation(what, seed):
    """The states, what was perceived of the floor, and what the sensors measured (cycles, robots, ...)."""
    found = what.simulator.run(what.pfsm, seed, record=True)
    return found.trace.states, found.history.readings[..., 5:8], found.recording.measure("ground_sensors")[:, :, 0]


def colours(ground):
    return {tuple(colour) for colour in np.unique(ground.reshape(-1, 3), axis=0).tolist()}


def reds(what, raw):
    """How often the noise of what was measured is red, if it is taken as it is."""
    model, red = what.simulator.robot_model.reference_model, COLOUR_LABELS.index("red")
    return sum(colour_label(model, *measured) == red for measured in raw.reshape(-1, 3).tolist())


@pytest.mark.thorough
def test_it_stops_neither_in_simulation_nor_on_the_twin():
    """Though both drive over black, where the noise of the sensor is red in one cycle of six."""
    what, seed = case(8), 20  # with this one both soon come to black
    run = on_twin(what, seed)
    for states, ground, raw in (in_simulation(what, seed), (run.states, run.ground, run.raw)):
        assert not states.any()
        assert colours(ground) == FLOOR
        assert reds(what, raw) > 5


def test_one_that_seeks_black_stops_on_both():
    what = case(4, "--nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 0 --p0x0 1 --s1 1")
    assert in_simulation(what, 1)[0].any()
    assert on_twin(what, 1).states.any()


@pytest.mark.thorough
def test_it_scores_the_same_on_the_twin():
    """A whole mission; the seeds are fixed, so nothing is left to chance."""
    what = case(120)
    objective = what.simulator.mission.objective
    twin = []
    for seed in range(1, 7):
        run = on_twin(what, seed)
        assert not run.states.any()
        twin.append(objective(trace(what, seed, run.poses)))
    simulated = [what.simulator.run(what.pfsm, seed).score for seed in range(1, 101)]
    assert rank_sum(np.array(simulated), np.array(twin)) > 0.05
