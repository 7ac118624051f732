"""Elites whose experiments are mapped: figures of one experiment, the table, and the command."""

import json
import math

import pytest
from click.testing import CliRunner

from mercator_design.cli import cli
from mercator_design.errors import MercatorError
from mercator_design.fsm import parse
from mercator_design.mapping.trial import MapTrial, map_trial
from mercator_design.missions.mission import load_mission
from mercator_design.results.analysis.winners import elites
from mercator_design.show.maps.elites import MappedElites
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.simulate import Simulator

pytestmark = pytest.mark.together("kernels")  # compiled once

EXPLORATION, STANDING = parse("--nstates 1 --s0 0 --rwm0 20"), parse("--nstates 1 --s0 1")


def simulator(duration=6):
    return Simulator(
        load_mission("map_dodecagon", ["robots=2", f"duration={duration}"]), load_robot_model("mercator-drifting")
    )


def test_an_experiment_and_what_its_map_is_worth():
    found = map_trial(simulator(), EXPLORATION, 3, known_starts=True)
    assert found == map_trial(simulator(), EXPLORATION, 3, known_starts=True)
    assert found.score == Simulator(load_mission("map_dodecagon", ["robots=2", "duration=6"])).run(EXPLORATION, 3).score
    assert found.maps == 1
    assert found.error < 0.01
    assert 0.5 < found.fine_f1 <= 1.0
    assert 0.5 < found.coverage <= 1.0
    assert found.f1 > 0.6


def test_robots_without_a_turn_have_no_map():
    found = map_trial(simulator(0.2), STANDING, 3)
    assert found[1:] == (0.0, 0.0, 0.0, None, None, 0)


def compared(f1s):
    """Elites 7, 3, ... with these F1."""
    trials = {
        number: [MapTrial(0.5, value, value - 0.1, 0.9, 0.002, math.radians(0.25), 1) for value in values]
        for number, values in zip((7, 3, 12), f1s, strict=False)
    }
    mission, model = load_mission("map_dodecagon"), load_robot_model("mercator-drifting")
    seeds = range(1, len(f1s[0]) + 1)
    return MappedElites(dict.fromkeys(trials, EXPLORATION), trials, seeds, mission, model)


def test_the_best_maps_are_told():
    found = compared([(0.80, 0.82, 0.81), (0.93, 0.95, 0.97), (0.95, 0.93, 0.97)])
    assert found.best == 3
    assert found.p_values[7] < 0.05 < found.p_values[12]
    head, _, *rows = found.table(seed=4).splitlines()
    assert head == "map_dodecagon, mercator-drifting: maps of 3 fresh instances of master seed 4"
    assert " ".join(rows[1].split()) == "3 0.5 0.950 ± 0.020 0.850 90.0 % 2.0 0.25 1 best map"
    data = json.loads(json.dumps(found.data(seed=4), allow_nan=False))
    assert data["best"] == 3
    assert [one["configuration"] for one in data["elites"]] == [7, 3, 12]
    assert data["elites"][0]["f1"] == pytest.approx(0.81)
    assert data["elites"][0]["fsm"] == "--nstates 1 --s0 0 --rwm0 20"
    assert len(data["elites"][0]["runs"]) == 3


def test_one_instance_and_no_map():
    trials = {1: [MapTrial(0.0, 0.0, 0.0, 0.0, None, None, 0)]}
    mission, model = load_mission("map_dodecagon"), load_robot_model("mercator-drifting")
    found = MappedElites({1: EXPLORATION}, trials, [9], mission, model)
    assert found.table(seed=1).splitlines()[-1].split() == ["1", "0", "0.000", "0.000", "0.0", "%", "0", "best", "map"]
    assert found.data(seed=1)["elites"][0]["error"] is None


@pytest.mark.thorough
def test_the_command(mdesign_once, tmp_path, capsys):
    folder = tmp_path / "run"
    quick = ["--budget", "40", "--test-runs", "0", "--set", "duration=6", "--set", "robots=2", "--no-report", "-q"]
    mdesign_once("race", "map_dodecagon", "-o", folder, *quick)
    software, _ = elites(folder, 2)
    assert len(software) == 2
    capsys.readouterr()
    mdesign_once("runs", "map", folder, "--elites", "2", "-n", "2", "--json", "-q", "--known-starts")
    found = json.loads(capsys.readouterr().out)
    assert [one["configuration"] for one in found["elites"]] == list(software)
    assert found["best"] in software
    assert all(len(one["runs"]) == 2 for one in found["elites"])


@pytest.mark.thorough
def test_a_race_without_walls_to_see(mdesign_once, tmp_path):
    folder = tmp_path / "run"
    quick = ["--budget", "40", "--test-runs", "0", "--set", "duration=3", "--set", "robots=2", "--no-report", "-q"]
    mdesign_once("race", "aggregation", "-o", folder, *quick)
    with pytest.raises(MercatorError, match="expected walls that are higher than the robots' lidars"):
        CliRunner().invoke(cli, ["runs", "map", str(folder)], catch_exceptions=False)
