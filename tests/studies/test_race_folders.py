"""Studies of races that exist."""

import json
import shutil

import pandas as pd
import pytest

from mercator_design.errors import StudyError
from mercator_design.studies.race_folders import run_folders, table_of_races
from mercator_design.studies.statistics.comparison import compared

pytestmark = pytest.mark.together

RACE = ["race", "aggregation", "-j", "1", "--no-report", "--test-runs", "3", "--set", "duration=3"]


@pytest.fixture(scope="module")
def races(tmp_path_factory, mdesign_once):
    """Two races by each of two methods; with another seed, another budget, for another mission; one without tests."""
    folder = tmp_path_factory.mktemp("races")
    for method in ("random", "halving"):
        for seed in (1, 2):
            options = ["--budget", "20", "--method", method, "--seed", seed]
            mdesign_once(*RACE, *options, "-o", folder / "all" / f"{method}-{seed}")
    mdesign_once(*RACE, "--budget", "20", "--method", "random", "--seed", 0, "-o", folder / "earlier")
    mdesign_once(*RACE, "--budget", "30", "--method", "random", "-o", folder / "longer")
    mdesign_once(*RACE, "--budget", "20", "--method", "random", "--set", "robots=2", "-o", folder / "other")
    mdesign_once(*RACE, "--budget", "20", "--method", "random", "--test-runs", "0", "-o", folder / "untested")
    return folder


def test_the_winner_with_its_fresh_scores_is_a_design(mdesign, races):
    table = table_of_races("x", run_folders([races / "all"]), "method")
    assert table.levels == ["halving", "random"]
    (block,) = table.blocks()
    assert [len(scores) for scores in block.scores.values()] == [2, 2]
    listed = {run["run"]: run for run in json.loads(mdesign("runs", "list", races / "all", "--json")[1])}
    expected = [listed[str(races / "all" / f"halving-{seed}")]["fresh_score"] for seed in (1, 2)]
    assert block.scores["halving"].tolist() == pytest.approx(expected)
    assert table.possible("aggregation")[:2] == (0.0, 3.0)
    assert table.possible("aggregation").maximise
    assert set(table.designs.runs) == {3}


def test_the_command_writes_page_tables_and_figures(mdesign, races, tmp_path):
    code, out, err = mdesign("study", "compare", races / "all", "-o", tmp_path / "found")
    assert (code, err) == (0, "")
    text = " ".join(out.split())
    assert "aggregation: halving is not distinguishable from random (A = " in text
    assert "2 designs of each are too few: no difference, however large, can be significant at 5%" in text
    assert "The unit is the design: each is one point, the mean score of 3 runs" in text
    assert len(pd.read_csv(tmp_path / "found" / "tables" / "runs.csv")) == 12
    page = (tmp_path / "found" / "report.html").read_text()
    assert "mdesign study compare" in page
    data = json.loads(mdesign("study", "compare", races / "all", "--json")[1])
    assert data["levels"] == ["halving", "random"]
    assert [one["shift"] for one in data["power"]] == [None]
    for folder in (races / "all" / "random-1",):
        code, _, err = mdesign("study", "compare", races / "all", "-o", folder)
        assert (code, "expected another folder than that of a study or a race" in err) == (2, True)


def test_budgets_are_compared_among_races_of_one_method(races):
    table = table_of_races("x", [*run_folders([races / "all"]), races / "longer"], "budget")
    blocks = {block.setting: block for block in table.blocks()}
    assert [*blocks["random"].scores] == ["20", "30"]
    assert [*blocks["halving"].scores] == ["20"]


def test_designs_of_equal_seeds_are_pairs_if_a_method_has_other_seeds_too(races):
    table = table_of_races("x", [*run_folders([races / "all"]), races / "earlier"], "method")
    (block,) = table.blocks()
    paired = (block.scores["halving"] - block.scores["random"]).dropna()
    assert [seed for _, seed in paired.index] == [1, 2]
    assert compared(table).pairs[0].p_paired is not None


def test_missions_of_one_name_are_told_apart(races):
    table = table_of_races("x", [*run_folders([races / "all"]), races / "other"], "method")
    assert len(table.missions) == 2
    assert all(name.startswith("aggregation ") for name in table.missions)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (["all/random-1", "untested"], "expected a winner that was tested on fresh instances"),
        (["all/random-1", "all/random-2"], "method is random"),
        (["all/random-1", "copy"], "expected a race that differs from that in"),
        (["all/random-1", "unfinished"], "expected a race that has ended"),
        (
            ["all", "nothing"],
            "expected a run folder, or a folder of run folders, found no journal.jsonl in it or below",
        ),
    ],
)
def test_races_that_make_no_study(mdesign, races, tmp_path, wrong, words):
    for name in ("all", "untested"):
        (tmp_path / name).symlink_to(races / name)
    shutil.copytree(races / "all" / "random-1", tmp_path / "copy")
    shutil.copytree(races / "all" / "halving-1", tmp_path / "unfinished")
    journal = tmp_path / "unfinished" / "journal.jsonl"
    journal.write_text("".join(journal.read_text().splitlines(keepends=True)[:3]))
    (tmp_path / "nothing").mkdir()
    code, _, err = mdesign("study", "compare", *(tmp_path / name for name in wrong))
    assert (code, words in err) == (2, True), err
    assert "Traceback" not in err


def test_a_file_that_is_no_folder(tmp_path):
    with pytest.raises(StudyError, match="found no such folder"):
        run_folders([tmp_path / "missing"])
