"""Studies of missions with several objectives: each is a block of its own, from the runs to the page."""

import json

import pandas as pd
import pytest

from mercator_design.config.checked_lines import from_line, to_line
from mercator_design.errors import StudyError
from mercator_design.studies.assessment import ASSESSMENT, read_assessment
from mercator_design.studies.reading import study_table

pytestmark = pytest.mark.together

PLAN = """
methods: {walk: {files: [walk.txt, slow.txt]}, stop: {files: [stop.txt, stay.txt]}}
missions:
  - {mission: frugal_aggregation, set: [duration=2, robots=2], name: frugal}
  - {mission: aggregation, set: [duration=2, robots=2]}
assess: {runs: 3, realities: [mercator-pseudo-reality]}
"""
NAMES = ("robots_in_zone", "path_length")


def plan_file(folder):
    for name, text in {
        "walk": "--s0 0 --rwm0 50",
        "slow": "--s0 0 --rwm0 1",
        "stop": "--s0 1",
        "stay": "--s0 1",
    }.items():
        (folder / f"{name}.txt").write_text(f"--nstates 1 {text}\n")
    (folder / "several.yaml").write_text(PLAN)
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
        assert f"{name}: relative rank among the designs of a mission" in page
    assert "missions with one objective: relative rank among the designs of a mission" in page
    compared = pd.read_csv(done / "tables" / "comparisons.csv", keep_default_na=False)
    assert compared[["mission", "objective"]].to_numpy().tolist() == [
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
