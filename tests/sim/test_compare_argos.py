"""The comparison with the original as a command: what it accepts, what it finds wrong, and files of all kinds."""

import gzip
import itertools
import json
import math
import os
from pathlib import Path

import pytest
import yaml

from benchmarks import compare_argos
from benchmarks.argos.recordings import read, walls
from mercator_design.fsm import parse
from mercator_design.missions.mission import load_mission
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.simulate import Simulator

pytestmark = [pytest.mark.together("kernels"), pytest.mark.usefixtures("experiments_once")]  # compiled once

DATA = Path(__file__).parents[1] / "data"
REFERENCE = os.environ.get("MERCATOR_REFERENCE")
SCORES = read(DATA / "argos_scores.json.gz")
FEWER = ("--runs", "40")
"""Experiments of ours for each controller: not five times as many as were recorded."""
TRACES = {run["name"]: run for run in read(DATA / "argos_traces.json.gz")["runs"]}


@pytest.fixture
def run(tmp_path, capsys):
    """Writes a recording, compares with it, and returns the exit code and what was printed."""

    def compared(runs, *options, meta=SCORES["meta"]):
        file = tmp_path / "recording.json.gz"
        file.write_bytes(gzip.compress(json.dumps({"meta": meta, "runs": runs}).encode()))
        code = compare_argos.main([str(file), "--jobs", "1", *options])
        output = capsys.readouterr()
        return code, output.out + output.err

    return compared


def cut(mission, n=20):
    """The first runs of each controller of a mission."""
    return [
        {
            **one,
            "seeds": one["seeds"][:n],
            "scores": one["scores"][:n],
            "stats": {name: column and column[:n] for name, column in one["stats"].items()},
        }
        for one in SCORES["runs"]
        if one["mission"] == mission
    ]


def shortened(name, cycles=None):
    """The first cycles of a recorded run."""
    robots = TRACES[name]["robots"]
    return {
        **TRACES[name],
        "robots": {robot: {key: column[:cycles] for key, column in robots[robot].items()} for robot in robots},
    }


# The tool accepts what is right ...


def test_a_cut_of_the_recorded_scores(run):
    code, text = run(cut("aggregation"), *FEWER)
    assert code == 0
    assert "scores: 0 of 5 tests reject, 0 are excused" in text
    assert "statistics: 0 of 130 tests reject" in text
    assert "could have told, with probability 0.9, if one controller's mean alone is away by so many sd:" in text
    assert "a simulator whose true means correlate with these at" in text


def test_a_cut_of_the_recorded_traces(run):
    names = {"explore_rwm20_n1": 7, "four_state_n5": 120, "stop_n5": 1, "shipped_color_fsm_n5": 9}
    code, text = run([shortened(name, cycles) for name, cycles in names.items()])
    assert code == 0
    assert "NOT" not in text
    assert text.count("\nreached: ") == 9
    assert "not recorded, so not compared: blobs of run 0, 'explore_rwm20_n1'; blobs of run 1, 'four_state_n5'" in text


def test_a_trace_whose_robots_are_listed_in_another_order(run):
    found = shortened("shipped_color_fsm_n5", 20)
    found["robots"] = dict(reversed(found["robots"].items()))
    code, text = run([found])
    assert code == 0
    assert "| 100/100 | 100/100 |\n" in text


def test_a_trace_without_its_seed(run):
    """The colours of tiles are then those that were read on them."""
    found = shortened("shipped_color_fsm_n5")
    del found["seed"]
    code, text = run([found])
    assert code == 0
    assert "reached: ground: 1000 of 1000" in text


# ... and finds what is wrong.


def test_a_scaled_score_column(run):
    runs = cut("coverage_v30_n3_r0.4")[:2]
    runs[0]["scores"] = [1.1 * score for score in runs[0]["scores"]]
    code, text = run(runs, *FEWER)
    assert code == 1
    assert f"rejected: coverage_v30_n3_r0.4, {runs[0]['name']}: score" in text


@pytest.mark.thorough
def test_statistics_that_are_a_little_off(run):
    """6 mm/s slower."""
    runs = cut("coverage_v30_n3_r0.4", 40)[:2]
    runs[1]["stats"]["speed_mps"] = [speed - 0.006 for speed in runs[1]["stats"]["speed_mps"]]
    code, text = run(runs, "--runs", "80")
    assert code == 1
    assert f"rejected: coverage_v30_n3_r0.4, {runs[1]['name']}: speed_mps" in text


@pytest.mark.thorough
def test_scores_of_another_mission(run):
    runs = cut("color_aggregation")[:2]
    for one in runs:
        one["mission"] = "aggregation"
        del one["stats"]
    code, text = run(runs, *FEWER)
    assert code == 1
    assert "rejected: aggregation" in text


@pytest.mark.thorough
def test_controllers_that_are_mixed_up(run):
    runs = cut("aggregation")
    columns = [one["scores"] for one in runs]
    for one, column in zip(runs, columns[1:] + columns[:1], strict=True):
        one["scores"] = column
        del one["stats"]
    code, text = run(runs, *FEWER)
    assert code == 1
    assert "NOT reached: aggregation: Spearman" in text


@pytest.mark.thorough
def test_another_world(run):
    """Shuffling explains nothing: controllers that are run again with the original's random numbers still differ."""
    runs = [one for one in cut("aggregation") if one["name"] in {"four_state", "explore_rwm20"}]
    code, text = run(runs, *FEWER, meta={"missions": {"aggregation": {"n_robots": 3, "prox_range": 0.25}}})
    assert code == 1
    assert "rejected: aggregation, four_state" in text
    assert "0 are excused" in text


@pytest.mark.parametrize(("column", "shift"), [("x", 0.001), ("vl", 1.0), ("yaw", 0.002)])
def test_a_shifted_trace(run, column, shift):
    found = shortened("attract5_n1", 100)
    for robot in found["robots"].values():
        robot[column][50:] = [value + shift for value in robot[column][50:]]
    code, text = run([found])
    assert code == 1
    assert "NOT reached: until robots touch each other" in text


def test_readings_of_another_robot(run):
    found = shortened("explore_rwm20_n1", 100)
    for robot in found["robots"].values():
        robot["prox"] = [row[1:] + row[:1] for row in robot["prox"]]
    code, text = run([found])
    assert code == 1
    assert "NOT reached: proximity" in text


@pytest.mark.parametrize(
    ("column", "alter", "verdict"),
    [
        ("pv", lambda length: 0.0, "vector"),
        ("pv", lambda length: 0.998 * length, "vector"),
        ("pa", lambda angle: angle + 0.002, "vector"),
        ("blobs", lambda seen: seen[:-1], "blobs"),
        ("blobs", lambda seen: [*seen, [50.0, 0.0]], "blobs"),
        ("blobs", lambda seen: [*seen[:-1], seen[0]], "blobs"),
        ("blobs", lambda seen: [[distance + 0.05, bearing] for distance, bearing in seen], "blobs"),
        ("blobs", lambda seen: [[distance, bearing + 0.001] for distance, bearing in seen], "blobs"),
    ],
)
def test_readings_that_are_a_little_off(run, column, alter, verdict):
    found = shortened("shipped_color_fsm_n5", 20)
    for robot in found["robots"].values():
        robot[column][10:] = [alter(value) for value in robot[column][10:]]
    code, text = run([found])
    assert code == 1
    assert f"NOT reached: {verdict}" in text
    assert text.count("NOT") == 1


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [15, None])
def test_a_floor_that_was_read_wrong(run, seed):
    """Whether or not its tiles follow from the seed, and whatever the order of robots."""
    found = shortened("shipped_color_fsm_n5")
    found["robots"] = dict(reversed(found["robots"].items()))
    found["seed"] = seed
    for robot in found["robots"].values():
        robot["ground"] = [[1, 2, 3] for _ in robot["ground"]]
    code, text = run([found])
    assert code == 1
    assert ("NOT reached: ground: 0 of 1000" if seed else "left out: run 0, 'shipped_color_fsm_n5': ground: ") in text


def test_a_tile_of_two_colours(run):
    found = shortened("shipped_color_fsm_n5")
    del found["seed"]
    colours = itertools.cycle([[255, 0, 0], [0, 255, 0]])
    for robot in found["robots"].values():
        robot["ground"] = [value if value == [127, 127, 127] else next(colours) for value in robot["ground"]]
    code, text = run([found])
    assert code == 1
    assert "ground: 2 colours were read on the tile at" in text
    assert "NOT reached: all runs compared, of 1" in text


# Missions that are not the original's own.


@pytest.fixture
def mission(tmp_path):
    """Writes the original's aggregation, changed, as a mission file, and returns the option that names it."""

    def written(**changes):
        text = (Path(__file__).parents[2] / "scenarios" / "aggregation.yaml").read_text()
        content = {**yaml.safe_load(text), "robot_model": "mercator-argos", "robots": 3, **changes}
        content["arena"]["walls"]["apothem"] = 1.5
        content["arena"]["obstacles"] = json.loads(walls())
        file = tmp_path / "mine.yaml"
        file.write_text(json.dumps(content))
        return "--mission", f"mine={file}"

    return written


def of_mine(name, cycles, fsm):
    return {**shortened(name, cycles), "mission": "mine", "fsm": fsm}


def test_a_trace_of_chocolate_on_a_mission_of_its_own(run, mission):
    """Attraction has another number than in Watermelon."""
    trace = of_mine("attract5_n1", 100, "--nstates 1 --s0 4 --att0 5")
    code, text = run([trace], *mission(), "--flavour", "chocolate")
    assert code == 0
    assert "reached: wheels: 100 of 100" in text
    code, text = run([trace], *mission())
    assert code == 1
    assert "left out: run 0" in text
    code, text = run([{**trace, "fsm": "--nstates 1 --s0 1"}], *mission(), "--flavour", "chocolate")
    assert code == 1
    assert "NOT reached: wheels" in text


def test_a_trace_on_another_floor_than_its_mission_has(run, mission):
    trace = of_mine("stop_n5", 20, "--nstates 1 --s0 1")
    assert run([trace], *mission())[0] == 0
    spot = {"name": "spot", "shape": "disc", "center": [0, 0], "radius": 0.5, "color": "black"}
    code, text = run([trace], *mission(floor={"background": "white", "zones": [spot]}))
    assert code == 1
    assert "NOT reached: ground" in text


def test_a_trace_cannot_be_replayed_by_chance(run, mission):
    trace = of_mine("stop_n5", 5, "--nstates 1 --s0 1")
    code, text = run([trace], *mission(robot_model="epuck"))
    assert code == 1
    assert "robot model epuck: drive.noise, proximity.weight_noise, " in text


def scored(name, count, **settings):
    """A recording of scores that our own simulator makes on a shipped mission, with Chocolate's phototaxis and stop."""
    model, task = load_robot_model("epuck"), load_mission(name, [f"{k}={v}" for k, v in settings.items()])
    simulator = Simulator(task, model)
    runs = []
    for label, fsm in (("light", "--nstates 1 --s0 2"), ("stop", "--nstates 1 --s0 1")):
        scores = [simulator.run(parse(fsm, "chocolate"), seed).score for seed in range(5000, 5000 + count)]
        runs.append({"mission": name, "name": label, "fsm": fsm, "scores": scores, "seeds": [7] * count})
    return runs


@pytest.mark.thorough
def test_scores_of_chocolate_on_a_shipped_mission(run):
    """And on another that is given for it, where the robots start on the black spot."""
    runs = scored("chocolate_aac", 20, duration=5)
    meta = {"missions": {"chocolate_aac": {"length": 5}}}
    options = ("--flavour", "chocolate", "--runs", "60")
    code, text = run(runs, *options, meta=meta)
    assert code == 0
    assert "not repeated from the recorded seeds: chocolate_aac, here chocolate_aac, robot model epuck" in text
    assert "Repeated from" not in text
    code, text = run(runs, *options, "--mission", "chocolate_aac=scenarios/chocolate_cfa.yaml", meta=meta)
    assert code == 1
    assert "rejected: chocolate_aac, stop: score" in text
    code, text = run(runs, *options, meta={"missions": {"chocolate_aac": {"scale": 2}}})
    assert code == 1
    assert "left out: chocolate_aac: 2 controllers: mission 'chocolate_aac': what its 'scale' means" in text


def test_missions_that_cannot_be_given(run, mission, tmp_path):
    trace = of_mine("stop_n5", 2, "--nstates 1 --s0 1")
    code, text = run([trace], "--mission", f"mine={tmp_path / 'none.yaml'}")
    assert code == 3
    assert "none.yaml" in text
    code, text = run([trace], *mission(robots="many"))
    assert code == 3
    assert "robots" in text
    code, text = run([trace], *mission(), "--mission", "yours=aggregation")
    assert code == 2
    assert "--mission yours: no recording has a mission of that name" in text
    with pytest.raises(SystemExit, match="2"):
        run([trace], "--mission", "mine")


# Files of all kinds: clear words, and no traceback.


def test_one_run_of_each_controller(run):
    """Nothing is called reached that no data could have made fail."""
    code, text = run(cut("aggregation", 1), *FEWER)
    assert code == 1
    assert "cannot tell: aggregation: Spearman" in text
    assert "cannot tell: scores: with so few runs, none of 5 tests can reject" in text
    assert "cannot tell: statistics: with so few runs" in text
    assert "NOT reached: a verdict: there are too few runs to tell anything" in text


@pytest.mark.thorough
def test_two_runs_of_each_controller(run):
    code, text = run(cut("aggregation", 2), "--runs", "20", "--seed", "2")
    assert code == 0
    assert "reached: scores: 0 of 5 tests reject" in text
    assert "aggregation: none, by a single controller" in text


@pytest.mark.thorough
def test_few_runs_of_one_controller_beside_others(run):
    code, text = run([*cut("aggregation")[:4], *cut("aggregation", 2)[4:]], "--runs", "30")
    assert code == 0
    assert "| aggregation | 5 | 20, 30 |" in text


def test_equal_scores_in_all_runs(run):
    """The shipped coverage sets no speed."""
    stays = {"mission": "coverage", "fsm": "--nstates 1 --s0 0 --rwm0 9", "scores": [683430.0] * 20}
    code, text = run([{**stays, "name": name} for name in "abc"], "--runs", "20", meta={})
    assert code == 0
    assert "cannot tell: coverage: Spearman -" in text
    assert "cannot tell: statistics: none are recorded" in text
    code, text = run([{**stays, "name": "a", "scores": [683431.0] * 20}], "--runs", "20", meta={})
    assert code == 1
    assert "rejected: coverage, a: score" in text


def test_a_mission_that_is_not_known(run):
    code, text = run([*cut("aggregation")[:1], {**cut("aggregation")[1], "mission": "beyond"}], "--runs", "20")
    assert code == 1
    assert "left out: beyond: 1 controllers: mission 'beyond': made from 'beyond', which is not shipped" in text
    assert "NOT reached: all controllers compared, of 2" in text


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"fsm": "--nstates 9"}, "left out"),
        ({"scores": [], "stats": None}, "no run has a score"),
        ({"scores": [None, None], "stats": None}, "no run has a score"),
        ({"scores": ["much", 1]}, "scores: expected 2 numbers"),
        ({"scores": [10**400, 1]}, "scores: expected 2 numbers"),
        ({"scores": 5}, "scores: expected a list"),
        ({"stats": 7}, "stats: expected an object"),
        ({"stats": {"prox": [0.5]}}, "prox: expected 20 numbers"),
        ({"stats": {"occ": 3}}, "occ: expected 20 x 4 numbers"),
        ({"stats": {"occ": [[1, 0]] * 20}}, "occ: expected 20 x 4 numbers"),
    ],
)
def test_controllers_that_cannot_be_compared(run, wrong, words):
    good, bad = cut("aggregation")[:2]
    code, text = run([good, {**bad, **wrong}], "--runs", "20")
    assert code == 1
    assert words in text
    assert "| aggregation | 1 |" in text


def test_statistics_that_are_not_there(run):
    """Columns, rows and values; and scores that are no numbers."""
    good, some = cut("aggregation")[:2]
    some["scores"][3] = math.nan
    some["stats"] = {
        "prox": [None] * 20,
        "nn": [None, *some["stats"]["nn"][1:]],
        "occ": [None, *some["stats"]["occ"][1:]],
    }
    code, text = run([good, {**some, "seeds": [0] * 20}], "--runs", "20")
    assert code == 0
    assert f"failed when it was recorded: aggregation: {some['name']}: 1 of 20 runs" in text
    assert "statistics: 0 of 31 tests" in text


@pytest.mark.parametrize(
    "settings",
    [
        [],
        {"base": []},
        {"base": "beyond"},
        {"n_robots": 900},
        {"n_robots": "3"},
        {"length": 0},
        {"scale": 0},
        {"up": 1},
    ],
)
def test_settings_that_cannot_be_run(run, settings):
    code, text = run(cut("aggregation")[:1], "--runs", "2", meta={"missions": {"aggregation": settings}})
    assert code == 1
    assert "left out: aggregation: 1 controllers: " in text


@pytest.mark.thorough
@pytest.mark.parametrize("fsm", ["--nstates 2 --s0 0 --rwm0 5 --s1 1", "--nstates 1 --s0 1"])
def test_states_without_transitions(run, fsm):
    code, _ = run([{"mission": "aggregation", "name": "x", "fsm": fsm, "scores": [0, 1, 0, 2, 0], "seeds": [7] * 5}])
    assert code == 0


def without(name, key):
    found = shortened(name, 20)
    for robot in found["robots"].values():
        del robot[key]
    return found


def changed(name, key, value):
    found = shortened(name, 20)
    for robot in found["robots"].values():
        robot[key] = value(robot[key])
    return found


@pytest.mark.parametrize(
    ("trace", "words"),
    [
        (without("stop_n5", "x"), "'x'"),
        (changed("stop_n5", "prox", lambda rows: [row[:7] for row in rows]), "prox: expected"),
        (changed("stop_n5", "prox", lambda rows: rows[:9]), "prox: expected"),
        (changed("stop_n5", "ground", lambda rows: [row[:1] for row in rows]), "ground: expected"),
        (changed("stop_n5", "s0", lambda column: [7] * len(column)), "s0: expected states"),
        (changed("stop_n5", "nn", lambda column: column[:3]), "nn: expected"),
        (changed("stop_n5", "vl", lambda column: column[:3]), "robots: no table"),
        (changed("stop_n5", "x", lambda column: [math.nan] * len(column)), "finite"),
        (changed("stop_n5", "pv", lambda column: [None] * len(column)), "finite"),
        (without("shipped_color_fsm_n5", "pa"), "'pa'"),
        (changed("shipped_color_fsm_n5", "blobs", lambda rows: rows[:9]), "blobs: expected"),
        (changed("shipped_color_fsm_n5", "blobs", lambda rows: [[1.0]] * len(rows)), "robots: no table"),
        (changed("shipped_color_fsm_n5", "blobs", lambda rows: [[[None, 1.0]]] * len(rows)), "finite"),
        (shortened("stop_n5", 0), "expected"),
        ({**TRACES["stop_n5"], "robots": {}}, "robots: no table"),
        ({**TRACES["stop_n5"], "robots": 5}, "robots: no table"),
        ({**TRACES["stop_n5"], "fsm": "--nstates 2"}, "stop_n5"),
        ({**TRACES["stop_n5"], "mission": "beyond"}, "made from 'beyond'"),
    ],
)
def test_traces_that_cannot_be_replayed(run, trace, words):
    code, text = run([shortened("explore_rwm20_n1", 5), trace])
    assert code == 1
    assert words in text
    assert "NOT reached: all runs compared, of 2" in text
    assert "\nreached: until robots touch" in text


def test_a_file_that_is_not_there(capsys, tmp_path):
    assert compare_argos.main([str(tmp_path / "none.json.gz")]) == 2
    assert "cannot be read" in capsys.readouterr().err


@pytest.mark.thorough
def test_the_recordings_that_are_here():
    assert compare_argos.main([str(DATA / f"argos_{kind}.json.gz") for kind in ("traces", "scores")]) == 0


@pytest.mark.thorough
@pytest.mark.skipif(REFERENCE is None, reason="MERCATOR_REFERENCE names no folder of whole recordings")
def test_whole_recordings():
    files = sorted(Path(REFERENCE).glob("argos_*.json.gz"))
    assert files
    assert compare_argos.main([str(file) for file in files]) == 0
