"""Studies of missions with several objectives: each is a block of its own, from the runs to the page."""

import itertools
import json

import numpy as np
import pandas as pd
import pytest

from mercator_design.cli.study.texts import estimate_text
from mercator_design.config.checked_lines import from_line, to_line
from mercator_design.errors import StudyError
from mercator_design.missions.mission import load_mission
from mercator_design.scores import ScoreRange
from mercator_design.seeds import instance_seed
from mercator_design.sim.simulate import Simulator
from mercator_design.software.files import read_fsm
from mercator_design.studies.assessment import ASSESSMENT, read_assessment
from mercator_design.studies.estimate import StudyEstimate
from mercator_design.studies.folder import read_facts
from mercator_design.studies.race_folders import run_folders, table_of_races
from mercator_design.studies.reading import study_table
from mercator_design.studies.statistics.comparison import compared
from mercator_design.studies.statistics.fronts import HYPERVOLUME

pytestmark = pytest.mark.together

PLAN = """
methods: {walk: {files: [walk.txt, slow.txt]}, stop: {files: [stop.txt, stay.txt]}}
missions:
  - {mission: frugal_aggregation, set: [duration=2, robots=2], name: frugal}
  - {mission: aggregation, set: [duration=2, robots=2]}
assess: {runs: 3, realities: [mercator-pseudo-reality]}
"""
RACES = """
budgets: [60]
repetitions: 2
methods: {halving: {}, irace: {method: irace}, hand: {files: [walk.txt, stay.txt]}}
missions:
  - {mission: frugal_aggregation, set: [duration=2, robots=2], name: frugal}
  - {mission: aggregation, set: [duration=2, robots=2]}
assess: {runs: 3, realities: [mercator-pseudo-reality]}
"""
NAMES = ("robots_in_zone", "path_length")


def plan_file(folder, plan=PLAN):
    for name, text in {
        "walk": "--s0 0 --rwm0 50",
        "slow": "--s0 0 --rwm0 1",
        "stop": "--s0 1",
        "stay": "--s0 1",
    }.items():
        (folder / f"{name}.txt").write_text(f"--nstates 1 {text}\n")
    (folder / "several.yaml").write_text(plan)
    return folder / "several.yaml"


@pytest.fixture(scope="module")
def done(tmp_path_factory, mdesign_once):
    folder = tmp_path_factory.mktemp("several")
    mdesign_once("study", plan_file(folder), "-o", folder / "done", "--no-report")
    mdesign_once("study", "report", folder / "done")
    return folder / "done"


def test_runs_have_a_row_for_each_objective(done, mdesign):
    runs = pd.read_csv(done / "tables" / "runs.csv", keep_default_na=False)
    assert runs.groupby(["mission", "objective"]).size().to_dict() == {
        ("aggregation", ""): 4 * 2 * 3,
        **{("frugal", name): 4 * 2 * 3 for name in NAMES},
    }
    folder = done / "cells" / "frugal" / "walk" / "0" / "1"
    code, out, _ = mdesign(
        "evaluate", folder / "fsm.txt", "--mission", "frugal_aggregation", "--set", "duration=2", "--set", "robots=2",
        "-n", 3, "--json", "--quiet",
    )  # fmt: skip
    assert code == 0
    by_hand = {name: one["scores"] for name, one in json.loads(out)["objectives"].items()}
    own = runs[
        (runs.mission == "frugal") & (runs.method == "walk") & (runs.repetition == 1) & (runs.reality == "design")
    ]
    assert {name: group.score.tolist() for name, group in own.groupby("objective")} == by_hand


def test_each_has_a_direction_and_a_block(done):
    table = study_table(done)
    assert table.directions == {
        ("frugal", "robots_in_zone"): "maximise",
        ("frugal", "path_length"): "minimise",
        "aggregation": "maximise",
    }
    blocks = {block.name: block for block in table.blocks()}
    assert [*blocks] == ["frugal, robots_in_zone", "frugal, path_length", "aggregation"]
    lengths = blocks["frugal, path_length"]
    assert (lengths.scores["stop"] == 0.0).all()
    assert (lengths.scores["walk"] > 0.0).all()
    assert lengths.possible.low == 0.0


def test_page_tables_and_figures_show_them_apart(done):
    page = (done / "report.html").read_text()
    for name in NAMES:
        assert f"frugal, {name}: score" in page
        assert f"{name}: relative rank (0: best)" in page
    assert "missions with one objective: relative rank (0: best)" in page
    compared = pd.read_csv(done / "tables" / "comparisons.csv", keep_default_na=False)
    model = compared[compared.reality == "design"]
    assert model[["mission", "objective"]].to_numpy().tolist() == [
        *(["frugal", name] for name in NAMES),
        ["aggregation", ""],
    ]
    assert "frugal, path\\_length" in (done / "tables" / "scores.tex").read_text()
    verdicts = [one["verdict"] for one in json.loads((done / "tables" / "study.json").read_text())["pairs"]]
    assert verdicts[1].startswith("frugal, path_length: ")


def test_an_assessment_by_one_of_them_is_refused(done, mdesign, tmp_path):
    file = done / "cells" / "frugal" / "walk" / "0" / "1" / ASSESSMENT
    whole = file.read_text()
    assert [len(row) for row in read_assessment(file.parent).by_objective["design"]] == [2, 2, 2]
    try:
        file.write_text(to_line({**from_line(whole.encode()), "by_objective": {}}))
        code, _, err = mdesign("study", plan_file(tmp_path), "-o", done)
        assert code == 2
        assert f"{file}: expected scores of design by each of 2 objectives" in err
        with pytest.raises(StudyError, match="delete it to assess the design again"):
            study_table(done)
    finally:
        file.write_text(whole)


@pytest.fixture(scope="module")
def raced(tmp_path_factory, mdesign_once):
    folder = tmp_path_factory.mktemp("raced")
    mdesign_once("study", plan_file(folder, RACES), "-o", folder / "done", "--no-report", "-j", "1")
    mdesign_once("study", "report", folder / "done")
    return folder / "done"


def test_fronts_of_races_are_compared_by_their_hypervolume(raced):
    table = study_table(raced)
    blocks = {block.name: block for block in table.blocks()}
    assert [*blocks] == [*(f"frugal, {name}" for name in (*NAMES, HYPERVOLUME)), "aggregation"]
    block = blocks[f"frugal, {HYPERVOLUME}"]
    assert {level: len(scores) for level, scores in block.scores.items()} == {"halving": 2, "irace": 2}
    assert block.possible == ScoreRange(0.0, 1.0, maximise=True)
    assert {*table.fronts["mission"]} == {"frugal"}
    (box,) = table.boxes.values()
    for (method, repetition), front in table.fronts.query("reality == 'design'").groupby(["method", "repetition"]):
        folder = raced / "cells" / "frugal" / method / "60" / str(repetition)
        for (file, objective), rows in front.groupby(["file", "objective"]):
            assert (folder / file).exists()
            simulator = Simulator(load_mission(folder / "mission.yaml"))
            software = read_fsm(folder / file).software
            seeds = [instance_seed(1, "evaluation", k) for k in range(3)]
            found = [simulator.run(software, seed).scored.by_objective[NAMES.index(objective)] for seed in seeds]
            assert rows["score"].item() == pytest.approx(np.mean(found), abs=1e-12)
        points = front.pivot_table(index="file", columns="objective", values="score")[[*NAMES]]
        low, high = (np.array([one[name] for name in NAMES]) for one in box)
        shares = ((points - high) / (low - high)).to_numpy()  # of the way from the reference point to the best
        assert (shares > 0).all()
        corners = [0.0, *sorted(shares[:, 0])]
        area = sum((x - before) * shares[shares[:, 0] >= x][:, 1].max() for before, x in itertools.pairwise(corners))
        assert block.scores[method].loc[repetition].item() == pytest.approx(area)


def test_a_dry_run_counts_the_tests_of_fronts(raced):
    layout = read_facts(raced).layout
    text = estimate_text("x", layout, StudyEstimate(seconds={}, experiments={}, jobs=1), len(layout.cells))
    n_tests = len(compared(study_table(raced)).pairs)
    assert f"too few for {n_tests} tests" in text


def test_hypervolumes_are_in_the_tables_and_explained_on_the_page(raced):
    fronts = pd.read_csv(raced / "tables" / "fronts.csv")
    assert {*fronts["reality"]} == {"design", "mercator-pseudo-reality"}
    assert (fronts["runs"] == 3).all()
    page = (raced / "report.html").read_text()
    data = json.loads((raced / "tables" / "study.json").read_text())
    (pair,) = [one for one in data["pairs"] if one["objective"] == HYPERVOLUME]
    assert pair["verdict"].startswith(f"frugal, {HYPERVOLUME}: ")
    assert f"frugal, {HYPERVOLUME}: the share of a box" in page
    assert f"{data['front_boxes']['frugal']['reference']['path_length']:.4g}" in page
    assert "tables/fronts.csv" in page


def test_a_front_that_is_assessed_in_part_is_assessed_to_its_end(raced, mdesign, tmp_path):
    folder = next(file.parent for file in sorted((raced / "cells" / "frugal").glob("*/*/*/front-*.txt")))
    file, before = folder / ASSESSMENT, study_table(raced)
    whole = file.read_text()
    data = from_line(whole.encode())
    first, *_ = data["front"]
    data["front"][first]["by_objective"]["design"] = data["front"][first]["by_objective"]["design"][:1]
    try:
        file.write_text(to_line({**data, "front": {first: data["front"][first]}}))
        assert len(study_table(raced).designs) < len(before.designs)  # is not in the table until then
        _, out, _ = mdesign("study", "status", raced, "--json")
        assert json.loads(out)["counts"]["to assess"] == 1
        code, _, _ = mdesign("study", plan_file(tmp_path, RACES), "-o", raced, "--no-report", "-j", "1")
        assert code == 0
        assert file.read_text() == whole
        data["front"][first]["software"] += " --n0 0"
        file.write_text(to_line(data))
        code, _, err = mdesign("study", plan_file(tmp_path, RACES), "-o", raced, "--no-report", "-j", "1")
        assert code == 2
        assert "expected scores of the design beside it" in err
    finally:
        file.write_text(whole)


def test_cells_of_a_study_are_compared_by_what_was_assessed(raced):
    table, found = study_table(raced), table_of_races("x", run_folders([raced / "cells"]), "method")
    for one, other in (("frugal", "frugal_aggregation"), ("aggregation", "aggregation")):
        expected = {block.objective: block.scores for block in table.blocks() if block.mission == one}
        scores = {block.objective: block.scores for block in found.blocks() if block.mission == other}
        assert [*expected] == [*scores]
        for objective in set(expected) - {HYPERVOLUME}:  # whose reference point is that of all realities
            for level in scores[objective]:
                assert scores[objective][level].tolist() == expected[objective][level].tolist()
    assert found.possible("frugal_aggregation", "path_length") == table.possible("frugal", "path_length")


def test_races_with_several_objectives_are_compared_by_each(mdesign, tmp_path):
    for method, seed in (("halving", 1), ("halving", 2), ("irace", 1), ("irace", 2)):
        mdesign(
            "race", "frugal_aggregation", "--set", "duration=2", "--budget", "60", "--test-runs", "3", "--no-report",
            "-j", "1", "--method", method, "--seed", seed, "-o", tmp_path / f"{method}-{seed}",
        )  # fmt: skip
    table = table_of_races("x", run_folders([tmp_path]), "method")
    assert [block.objective for block in table.blocks()] == [*NAMES, HYPERVOLUME]
    assert [block.possible.maximise for block in table.blocks()] == [True, False, True]
    front = pd.read_csv(tmp_path / "irace-1" / "front.csv").query("on_front")
    own = table.fronts.query("method == 'irace' and seed == 1 and objective == 'path_length'")
    assert {*own["score"].round(12)} == {*front["path_length mean"].round(12)}
