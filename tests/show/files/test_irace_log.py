"""Races as irace's log. What R makes of it: docs/how-to/exchange-with-irace.md."""

import math
import sys

import numpy as np
import pytest
import rdata
from rdata.conversion import DEFAULT_CLASS_MAP, dataframe_constructor

from mercator_design.designer import Designer
from mercator_design.errors import RaceError
from mercator_design.missions.mission import load_mission
from mercator_design.race.executors.executor import Rejected
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.irace.scenario import read_scenario
from mercator_design.race.irace.tuner import Tuner
from mercator_design.race.session import evaluation, events
from mercator_design.race.session.events import (
    ConfigurationAdded,
    ExperimentDone,
    IterationEnded,
    Measurement,
    RaceEnded,
)
from mercator_design.race.session.record import Record
from mercator_design.race.session.runner import RaceRun
from mercator_design.show.files.irace_log import irace_results, write_irace_log
from mercator_design.sim.simulate import Simulator
from tests.test_tune import SPACE, written

SCENARIO = """
instances = c("a", "b")
testInstances = c("t", "tt", "ttt")
maxExperiments = 110
seed = 4
confidence = 0.9
"""


def measured(call):
    """As a target runner, but at once."""
    x = int(call.arguments.split()[1])
    if x > 27:
        raise Rejected("too large")
    return Measurement((x - 7) ** 2 + call.seed % 3, "")


@pytest.fixture(scope="module")
def race(tmp_path_factory):
    """A task and its record."""
    folder = written(tmp_path_factory.mktemp("log"), scenario=SCENARIO)
    (folder / "parameters.txt").write_text(SPACE + 'z "--z=" i (0, "x")\n[forbidden]\nx == 3\n')
    tuner = Tuner(read_scenario(folder / "scenario.txt"))
    tuner.function = measured
    record = Record()
    record.begin(tuner.start())
    with ThreadExecutor(1) as executor:
        RaceRun(tuner, executor, record, testing=evaluation.Testing(runs=3, elites=2)).finish()
    return tuner, record


@pytest.fixture(scope="module")
def log(race, tmp_path_factory):
    """What is in the file."""
    file = tmp_path_factory.mktemp("log") / "irace.Rdata"
    write_irace_log(file, *race)
    classes = {**DEFAULT_CLASS_MAP, "data.table": dataframe_constructor}
    return rdata.read_rda(file, constructor_dict=classes)["iraceResults"]


def test_configurations(race, log):
    record = race[1]
    table = log["allConfigurations"]
    assert list(table.columns) == [".ID.", "x", "rule", "y", "z", ".PARENT."]
    assert list(table[".ID."]) == list(range(1, len(record.configurations) + 1))
    for number, row in enumerate(table.itertuples(index=False)):
        values = record.configurations[number]
        assert (row.x, row.rule, row.z) == (values["x"], values["rule"], values["z"])
        assert row.y == values["y"] if "y" in values else math.isnan(row.y)
        parent = record.parents[number]
        assert math.isnan(row[-1]) if parent is None else row[-1] == parent + 1
    assert log["parameters"]["conditions"]["y"] == ['rule == "fast"']
    assert list(log["parameters"]["domain"]["z"]) == ["0", "x"]
    assert log["scenario"]["parameters"]["nbVariable"] == [4]
    assert list(log["parameters"]["forbidden"]) == ["x == 3"]


def test_experiments(race, log):
    record = race[1]
    table = log["experiments"]
    assert list(table.dim_1.to_numpy()) == [str(number + 1) for number in range(len(record.configurations))]
    known = {(one.instance, one.configuration): one for one in record.experiments.values()}
    assert any(one.score is None for one in known.values())
    for (row, column), cost in np.ndenumerate(table.to_numpy()):
        one = known.get((row, column))
        if one is None:
            assert cost.view(np.uint64) & np.uint64(0xFFFFFFFF) == 1954  # R's NA, and no NaN
        else:
            assert cost == (math.inf if one.score is None else one.score)
    rejected = sorted(one.configuration + 1 for one in known.values() if one.score is None)
    assert list(log["state"]["rejected_ids"]) == rejected
    first = log["state"]["experiment_log"]
    assert list(first["configuration"]) == [record.experiments[n].configuration + 1 for n in range(len(first))]
    seeds = log["state"]["instances_log"]["seed"]
    assert all(seeds.iloc[one.instance] == one.seed for one in record.experiments.values())
    assert set(log["state"]["instances_log"]["instanceID"]) == {1, 2}
    assert log["experimentLog"].shape == (len(record.experiments), 5)


def test_elites_tests_and_scenario(race, log):
    record = race[1]
    ended = [record.iterations[number] for number in sorted(record.iterations)]
    assert [list(ids) for ids in log["allElites"]] == [[number + 1 for number in one.elites] for one in ended]
    assert list(log["iterationElites"]) == [one.elites[0] + 1 for one in ended]
    tests = log["testing"]["experiments"]
    assert list(tests.dim_0.to_numpy()) == ["1t", "2t", "3t"]
    for where, test in record.tests.items():
        assert tests.sel(dim_0=f"{where.instance + 1}t", dim_1=str(where.configuration + 1)) == test.score
    scenario = log["scenario"]
    assert (scenario["maxExperiments"], scenario["confidence"], scenario["testType"]) == ([110], [0.9], ["friedman"])
    assert list(scenario["instances"]) == ["a", "b"]
    assert log["state"]["completed"] == ["Ended"]


def test_of_a_mission_costs_are_minus_the_scores():
    designer = Designer(Simulator(load_mission("aggregation")), budget=2000, seed=1)
    record = Record()
    record.begin(designer.start())
    record.note(ConfigurationAdded(configuration=0, parent=None, values={"NumStates": "1"}))
    for instance, score in enumerate([3.0, None]):
        one = ExperimentDone(experiment=instance, iteration=1, configuration=0, instance=instance,
                       seed=designer.seed(instance), score=score, failure="" if score else "broken")  # fmt: skip
        record.note(one)
    record.note(IterationEnded(iteration=1, postselection=False, budget=9, used=2, configurations=1, instances=2,
                          alive=1, elites=(0,), stagnant=0, note=""))  # fmt: skip
    found = irace_results(designer, record)
    assert found["experiments"].value.tolist() == [-3.0, math.inf]
    assert found["experiments"].attributes["dim"].tolist() == [2, 1]
    assert found["state"]["completed"] == "Incomplete"
    record.note(record.with_digest(RaceEnded(budget=2000, experiments=2, winner=0)))
    record.note(events.TestDone(configuration=0, instance=0, seed=designer.test_seed(0), score=2.0))
    found = irace_results(designer, record)
    assert found["state"]["completed"] == "Ended"
    assert found["testing"]["experiments"].value.tolist() == [-2.0]


def test_a_race_without_experiments_is_refused(race, tmp_path):
    record = Record()
    record.begin(race[0].start())
    with pytest.raises(RaceError, match="expected a race with experiments, found none"):
        write_irace_log(tmp_path / "irace.Rdata", race[0], record)


def test_without_the_package(race, tmp_path, monkeypatch):
    """The extra is in the clone: no registry has this program."""
    monkeypatch.setitem(sys.modules, "rdata.unparser", None)
    with pytest.raises(RaceError, match=r"in the clone, pip install '\.\[r\]'"):
        write_irace_log(tmp_path / "irace.Rdata", *race)


def test_the_command(mdesign, tmp_path):
    folder = written(tmp_path / "s", scenario='instances = "i"\nmaxExperiments = 60\nnbIterations = 1\n')
    assert mdesign("tune", folder / "scenario.txt", "-o", tmp_path / "r")[0] == 0
    code, out, err = mdesign("export", "irace-log", tmp_path / "r")
    assert (code, out) == (0, "")
    assert err.startswith(f"{tmp_path / 'r' / 'irace.Rdata'}: ")
    assert mdesign("export", "irace-log", tmp_path / "r", "-o", tmp_path / "a.Rdata")[0] == 0
    assert (tmp_path / "a.Rdata").read_bytes() == (tmp_path / "r" / "irace.Rdata").read_bytes()
    assert mdesign("export", "irace-log", tmp_path)[0] == 1
