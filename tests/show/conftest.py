import json
import zipfile
from pathlib import Path

import pytest

import mercator_design as md
from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.sim.simulate import Simulator

DATA = Path(__file__).parents[1] / "data"
FSM = "--nstates 2 --s0 0 --rwm0 5 --n0 1 --n0x0 0 --c0x0 0 --p0x0 0.9 --s1 1 --n1 1 --n1x0 0 --c1x0 5 --p1x0 0.2"


@pytest.fixture(scope="session")
def simulator():
    """Three robots on a floor with a named zone."""
    return Simulator(md.load_mission("aggregation", ["duration=6"]))


@pytest.fixture(scope="session")
def shown(simulator):
    return ShownExperiment.simulated(simulator, md.parse_fsm(FSM), seed=2)


@pytest.fixture(scope="session")
def cleaning():
    """An experiment in which the floor changes."""
    mission = md.load_mission("cleaning", ["duration=20"])
    return ShownExperiment.simulated(Simulator(mission), md.parse_fsm("--nstates 1 --s0 0 --rwm0 5"), seed=1)


@pytest.fixture(scope="session")
def logs(tmp_path_factory):
    """The logs of three robots, each with a PFSM of its own."""
    folder = tmp_path_factory.mktemp("logs")
    with zipfile.ZipFile(DATA / "twin_runs.zip") as archive:
        return [Path(archive.extract(f"run{robot}.jsonl", folder)) for robot in range(3)]


def events(log):
    return [json.loads(line) for line in log.read_text().splitlines()]
