"""The engine: one compiled call, its referee, plain Python; determinism; parity of each kernel's outcome."""

import hashlib
import os
import resource
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from mercator_design.fsm import Readings, parse
from mercator_design.missions.mission import load_mission
from mercator_design.sim.kernels.chipmunk import Space
from mercator_design.sim.simulate import Simulator
from mercator_design.software import Controller
from tests.tiers import some

pytestmark = pytest.mark.together("kernels")  # compiled once

FOUR_STATES = (
    "--nstates 4 --s0 0 --rwm0 20 --n0 2 --n0x0 0 --c0x0 0 --p0x0 0.5 --n0x1 1 --c0x1 3 --p0x1 2 --w0x1 5 --s1 1 "
    "--n1 1 --n1x0 0 --c1x0 5 --p1x0 0.05 --s2 2 --att2 4 --n2 2 --n2x0 0 --c2x0 5 --p2x0 0.1 --n2x1 2 --c2x1 4 "
    "--p2x1 1 --w2x1 3 --s3 3 --rep3 5 --n3 1 --n3x0 1 --c3x0 1 --p3x0 0.1"
)
CROWDED = ("robots=10", "duration=30")


def digest(outcome):
    return outcome.score, hashlib.sha256(outcome.trace.poses.tobytes()).hexdigest()


@pytest.fixture(scope="module")
def simulator():
    return Simulator(load_mission("aggregation", CROWDED))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_compiled_engine_and_referee_agree_to_the_last_bit(simulator, seed):
    pfsm = parse(FOUR_STATES)
    compiled = simulator.run(pfsm, seed, record=True)
    referee = simulator.run(pfsm, seed, record=True, referee=True)
    assert digest(compiled) == digest(referee)
    for name in compiled.history._fields:
        assert np.array_equal(getattr(compiled.history, name), getattr(referee.history, name)), name


def test_recording_changes_nothing(simulator):
    pfsm = parse(FOUR_STATES)
    assert digest(simulator.run(pfsm, 5)) == digest(simulator.run(pfsm, 5, record=True))


@pytest.mark.parametrize("size", ["[1.0e-17, 0.8]", "[1.0e-17, 1.0e-17]"])
def test_a_box_whose_corners_are_equal_after_rounding(size):
    box = f"arena.obstacles=[{{center: [0.5, 0.5], size: {size}}}]"
    world = Simulator(load_mission("aggregation", (box, "robots=6", "duration=30")))
    pfsm = parse("--nstates 1 --s0 0 --rwm0 20")
    assert digest(world.run(pfsm, 2)) == digest(world.run(pfsm, 2, referee=True))


def test_what_is_kept_for_other_experiments_does_not_change():
    """The colours change during an experiment; the next one of the same seed begins with the first ones."""
    changing = Simulator(load_mission("changing_decision", ("duration=30",)))
    pfsm = parse(FOUR_STATES)
    once = digest(changing.run(pfsm, 5))
    assert [digest(changing.run(pfsm, 5)), digest(changing.run(pfsm, 5, referee=True))] == [once, once]
    assert digest(Simulator(changing.mission).run(pfsm, 5)) == once


def test_spaces_are_freed():
    """Those of 4000 experiments would be 100 MB."""
    physics = Simulator(load_mission("aggregation_20")).instance(1).scene.physics
    used = []
    for spaces in (200, 4000):
        for _ in range(spaces):
            Space(physics, 20)
        used.append(int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize())
    assert used[1] - used[0] < 10 * 2**20


def test_seeds_give_different_experiments(alone):
    assert len({*alone}) == 8


@pytest.fixture(scope="module")
def alone(simulator):
    """The outcomes of eight seeds, one after the other."""
    return [digest(simulator.run(parse(FOUR_STATES), seed)) for seed in range(8)]


@pytest.mark.swept
@pytest.mark.parametrize("threads", some([1, 2, 3, 4], 2))
def test_same_outcome_in_any_number_of_threads(simulator, alone, threads):
    pfsm = parse(FOUR_STATES)
    with ThreadPoolExecutor(threads) as pool:
        assert list(pool.map(lambda seed: digest(simulator.run(pfsm, seed)), range(8))) == alone


SCRIPT = f"""
import hashlib
from mercator_design.fsm import parse
from mercator_design.missions.mission import load_mission
from mercator_design.sim.kernels.chipmunk import Space
from mercator_design.sim.simulate import Simulator
o = Simulator(load_mission("aggregation", {{overrides!r}})).run(parse("{FOUR_STATES}"), 3)
print(o.score, hashlib.sha256(o.trace.poses.tobytes()).hexdigest())
"""


@pytest.mark.thorough
@pytest.mark.parametrize("plain", [False, True], ids=["compiled", "plain Python"])
def test_same_outcome_in_a_fresh_process(plain):
    overrides = ("robots=5", "duration=8")
    here = digest(Simulator(load_mission("aggregation", overrides)).run(parse(FOUR_STATES), 3))
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1" if plain else "0"}
    command = [sys.executable, "-c", SCRIPT.format(overrides=overrides)]
    output = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
    assert output.split() == [str(here[0]), here[1]]


@pytest.mark.parametrize("seed", [1, 2])
def test_replay(simulator, seed):
    """The robot's plain controller, fed with recorded readings and draws, decides as the simulation did."""
    pfsm = parse(FOUR_STATES)
    history = simulator.run(pfsm, seed, record=True).history
    cycles, robots, _ = history.readings.shape
    assert len(np.unique(history.states)) == 4
    for robot in range(robots):
        controller = Controller(pfsm, simulator.robot_model.reference_model)
        for cycle in range(cycles):
            wheels = controller.step(
                Readings(*history.readings[cycle, robot].tolist()), history.draws[cycle, robot].tolist()
            )
            assert tuple(wheels[:2]) == tuple(history.wheels[cycle, robot])
            assert controller.state == history.states[cycle, robot]
