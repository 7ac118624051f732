"""`import mercator_design as md`: what it gives, that it is lazy, and that its types are those of the stub."""

import ast
import doctest
import gc
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import mercator_design as md
from mercator_design.cli.evaluate import fresh_instances
from mercator_design.config import shipped
from mercator_design.errors import RaceError, SimulationError
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.race.session.runner import RaceRun
from mercator_design.results.files import read_journal

EXPLORE = "--nstates 1 --s0 0 --rwm0 20"


@pytest.fixture(scope="module")
def mission():
    return md.load_mission("aggregation", ["duration=2"])


def test_importing_it_imports_nothing_else():
    code = "import sys, mercator_design; print(*sys.modules)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert {name for name in out if name.startswith("mercator_design")} == {"mercator_design"}
    assert not {"numpy", "pymunk", "numba", "click", "yaml"} & set(out)


def test_the_stub_has_the_same_names_from_the_same_places():
    stub = ast.parse(Path(md.__file__).with_suffix(".pyi").read_text())
    found = {}
    for node in stub.body:
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                whole = f"{node.module}:{alias.name}" if alias.name != "race" else "mercator_design.race"
                found[alias.asname or alias.name] = whole.removeprefix("mercator_design.")
        elif isinstance(node, ast.Assign):
            assert sorted(ast.literal_eval(node.value)) == sorted(md.__all__)
    assert found == md._PLACES


def test_the_example_of_the_docstring():
    assert doctest.testmod(md) == (0, 4)


def test_every_name_is_there():
    assert set(md.__all__) <= set(dir(md))
    for name in md.__all__:
        assert getattr(md, name) is not None
    assert md.race.IteratedRace.__module__.startswith("mercator_design.race.")


def test_what_is_not_there():
    with pytest.raises(AttributeError, match="module 'mercator_design' has no attribute 'simulat'"):
        md.simulat  # noqa: B018
    assert not hasattr(md, "__wrapped__")


def test_simulate_gives_the_trace_that_the_objective_scores(mission):
    pfsm = md.parse_fsm(EXPLORE)
    seeds = md.fresh_instances(runs=3)
    traces = [md.simulate(mission, pfsm, seed=seed) for seed in seeds]
    assert traces[0].poses.shape == (21, 3, 3)
    assert not np.array_equal(traces[0].poses, traces[1].poses)
    evaluation = md.evaluate(mission, pfsm, seeds=seeds, jobs=2)
    assert evaluation.seeds == tuple(seeds)
    assert evaluation.scores.values == tuple(mission.objective(trace) for trace in traces)


def test_a_trace_as_a_table(mission):
    trace = md.simulate(mission, md.parse_fsm(EXPLORE), record=True)
    table = trace.to_frame(["wheels"], every=8)
    assert list(table) == [
        "time",
        "robot",
        "x",
        "y",
        "heading",
        "state",
        "led_colour",
        "signal",
        "wheels_0",
        "wheels_1",
    ]
    assert table.time.unique().tolist() == [0.8, 1.6, 2.0]
    assert np.array_equal(table[["x", "y", "heading"]], trace.poses[[8, 16, 20]].reshape(-1, 3))
    assert np.array_equal(table[["wheels_0", "wheels_1"]], trace.measure("wheels", 8).reshape(-1, 2))
    assert len(trace.to_frame()) == 60
    with pytest.raises(SimulationError, match="every"):
        trace.to_frame(every=0)


def test_other_robots_than_the_mission_s(mission):
    usual, other = md.load_robot_model("mercator"), md.load_robot_model("epuck")
    traces = [md.simulate(mission, md.parse_fsm(EXPLORE), robot_model=model).poses for model in (None, usual, other)]
    assert np.array_equal(traces[0], traces[1])
    assert not np.array_equal(traces[0], traces[2])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seeds": []}, "number of seeds: expected at least 1, found 0"),
        ({"seeds": [1, -1]}, "seed: expected at least 0, found -1"),
        ({"jobs": -1}, "jobs: expected at least 1, found -1"),
        ({"jobs": 0}, "jobs: expected at least 1, found 0"),
    ],
)
def test_what_cannot_be_evaluated(mission, options, message):
    with pytest.raises(md.MercatorError, match=message):
        md.evaluate(mission, md.parse_fsm(EXPLORE), **options)


def test_seeds_may_come_one_by_one(mission):
    assert md.evaluate(mission, md.parse_fsm(EXPLORE), seeds=iter([1, 2])).seeds == (1, 2)


def test_evaluate_has_the_instances_of_the_command_line_by_default():
    assert md.fresh_instances() == fresh_instances(1, 100)
    assert md.evaluate(md.load_mission("aggregation", ["duration=0.2"]), md.parse_fsm(EXPLORE)).seeds == tuple(
        md.fresh_instances()
    )


class TestDesign:
    def test_events_then_a_result(self, mission):
        run = md.design(mission, budget=60, method="irace", jobs=2, test_runs=3)
        with pytest.raises(RaceError, match="expected a race that has ended"):
            run.result  # noqa: B018
        events = list(run)
        ended = next(event for event in events if isinstance(event, md.race.RaceEnded))
        assert ended.winner == run.result.configuration
        assert sum(isinstance(event, md.race.ExperimentDone) for event in events) == ended.experiments <= 60
        tests = {event.seed: event.score for event in events if isinstance(event, md.race.TestDone)}
        evaluation = md.evaluate(mission, run.pfsm, seeds=md.fresh_instances(runs=3))
        assert dict(zip(evaluation.seeds, evaluation.scores.values, strict=True)) == tests

    def test_it_is_the_race_of_a_designer(self, mission):
        run = md.design(mission, budget=60, method="irace", jobs=2, test_runs=0)
        with ThreadExecutor(1) as executor:
            other = RaceRun(md.design(mission, budget=60, method="irace").designer, executor).finish()
        assert run.finish() == other

    def test_its_winner_is_that_of_the_command_line(self, mission, mdesign, tmp_path):
        options = ["--budget", 60, "--method", "irace", "--set", "duration=2", "-o", tmp_path]
        assert mdesign("race", "aggregation", *options)[0] == 0
        run = md.design(mission, budget=60, method="irace")
        run.finish()
        assert md.read_fsm(tmp_path / "fsm.txt").pfsm == run.pfsm

    def test_its_folder_is_that_of_the_command_line(self, mission, mdesign, tmp_path):
        options = ["--budget", 60, "--method", "irace", "--set", "duration=2", "--test-runs", 2, "-o", tmp_path / "a"]
        assert mdesign("race", "aggregation", *options)[0] == 0
        run = md.design(mission, budget=60, method="irace", test_runs=2, folder=tmp_path / "b")
        run.finish()
        names = [sorted(file.name for file in (tmp_path / folder).iterdir()) for folder in "ab"]
        assert names[0] == names[1]
        assert (tmp_path / "a/results.csv").read_bytes() == (tmp_path / "b/results.csv").read_bytes()
        ends = [read_journal(tmp_path / folder).record.ends for folder in "ab"]
        assert ends[0] == ends[1] != []
        with pytest.raises(RaceError, match="expected a new or empty folder"):
            md.design(mission, budget=60, folder=tmp_path / "b")

    @pytest.mark.parametrize("n_events", [0, 5])
    def test_a_closed_race_can_be_resumed(self, mission, mdesign, tmp_path, n_events):
        run = md.design(mission, budget=60, method="irace", jobs=2, folder=tmp_path)
        for _ in range(n_events):
            next(run)
        threads = list(run._executor._threads)
        run.close()
        run.close()
        assert next(run, None) is None
        for thread in threads:
            thread.join(60)
            assert not thread.is_alive()
        code, out, _ = mdesign("race", "--resume", tmp_path)
        assert (code, f"{run.designer.WINNER}, results.csv" in out) == (0, True)
        whole = md.design(mission, budget=60, method="irace")
        whole.finish()
        assert md.read_fsm(tmp_path / "fsm.txt").pfsm == whole.pfsm

    def test_a_race_that_is_left_lets_go_of_its_threads(self, mission):
        run = md.design(mission, budget=60, method="irace", jobs=2)
        next(run)
        threads = run._executor._threads
        assert len(threads) == 2
        del run
        gc.collect()
        for thread in threads:
            thread.join(60)
            assert not thread.is_alive()

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"flavour": "nope"}, "flavour: expected one of watermelon, chocolate, .*, found nope"),
            ({"method": "nope"}, "method: expected one of halving, irace, .*, found nope"),
            ({"on_failure": "nope"}, "on_failure: expected one of stop, reject, found nope"),
            ({"test_runs": -3}, "test runs: expected at least 1, found -3"),
            ({"jobs": -1}, "jobs: expected at least 1, found -1"),
            ({"jobs": 0}, "jobs: expected at least 1, found 0"),
            ({"seed": -1}, "seed: expected at least 0, found -1"),
        ],
    )
    def test_mistakes_are_refused_before_anything_is_written(self, mission, tmp_path, options, message):
        with pytest.raises(md.MercatorError, match=message):
            md.design(mission, budget=60, folder=tmp_path / "race", **options)
        assert not (tmp_path / "race").exists()

    def test_too_small_a_budget(self, mission):
        with pytest.raises(RaceError, match="budget"):
            md.design(mission, budget=3)


@pytest.mark.parametrize("arguments", [(-1, 2), (1, -2)])
def test_fresh_instances_of_a_negative_number(arguments):
    with pytest.raises(md.MercatorError, match="expected at least 0, found -"):
        md.fresh_instances(*arguments)


@pytest.mark.parametrize("kind", [str, Path])
def test_files_may_be_texts_or_paths(kind, tmp_path):
    (tmp_path / "fsm.txt").write_text("--nstates 1 --s0 0 --rwm0 20\n")
    assert md.read_fsm(kind(tmp_path / "fsm.txt")).pfsm == md.parse_fsm("--nstates 1 --s0 0 --rwm0 20")
    assert md.load_mission(kind(shipped.missions()["aggregation"])) == md.load_mission("aggregation")
    assert md.load_robot_model(kind(shipped.robot_models()["epuck"])).name == "epuck"
