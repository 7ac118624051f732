"""mdesign runs list and mdesign runs compare."""

import json
import re
import shutil
from xml.etree import ElementTree as ET

import pytest

from mercator_design.api import evaluate, fresh_instances
from mercator_design.missions.mission import load_mission
from mercator_design.show.text.runs import runs_table
from mercator_design.software.files import read_fsm

pytestmark = pytest.mark.together

RACE = ["race", "aggregation", "--budget", "20", "--method", "random", "-j", "1", "--test-runs", "0", "--no-report"]
QUICK = ["--set", "robots=2", "--set", "duration=3", "--set", "robot_model=mercator-chocolate"]


@pytest.fixture(scope="module")
def races(tmp_path_factory, mdesign_once):
    """Two races for one mission, one of them tested, and a race for another one."""
    folder = tmp_path_factory.mktemp("races")
    mdesign_once(*RACE, *QUICK, "-o", folder / "a", "--test-runs", 3)
    mdesign_once(*RACE, *QUICK, "-o", folder / "b", "--seed", 2, "--flavour", "chocolate")
    mdesign_once(*RACE, "--set", "robots=2", "--set", "duration=4", "-o", folder / "other")
    return folder


class TestList:
    def test_flavour_method_and_tested_mean(self, mdesign, races):
        code, out, _ = mdesign("runs", "list", races)
        assert code == 0
        header, *rows = [re.split(r" {2,}", line) for line in out.splitlines()]
        found = {row[0].rpartition("/")[2]: dict(zip(header, row, strict=False)) for row in rows}
        assert {name: row["flavour"] for name, row in found.items()} == {
            "a": "watermelon",
            "b": "chocolate",
            "other": "watermelon",
        }
        listed = {run["run"]: run for run in json.loads(mdesign("runs", "list", races, "--json")[1])}
        page = mdesign("runs", "show", races / "a")[1]
        one, other = (listed[str(races / name)] for name in "ab")
        assert f"score {one['score']:.4g} of at most 2 on 3 fresh instances" in page
        assert (found["a"]["score"], found["a"]["measured"]) == (f"{one['score']:.4g}", "on 3 fresh instances")
        assert (one["score"], one["fresh_runs"], one["low"], one["high"]) == (one["fresh_score"], 3, 0.0, 2.0)
        assert (other["score"], other["fresh_runs"]) == (other["race_score"], None)
        assert found["b"]["measured"] == other["measured"] == f"in the race, {other['race_runs']} runs"

    def test_it_fits_a_terminal(self, races, monkeypatch):
        monkeypatch.chdir(races.parent)
        lines = runs_table(races.relative_to(races.parent), 80)[0].splitlines()
        assert max(map(len, lines)) <= 80
        assert lines[0].split()[1:3] == ["flavour", "method"] or lines[0].split()[1:4] == ["name", "flavour", "method"]
        assert lines[0].split()[-2:] == ["score", "measured"]


class TestCompare:
    def test_side_by_side(self, mdesign, races):
        code, out, err = mdesign("runs", "compare", races / "a", races / "b")
        assert (code, err) == (0, "")
        rows = dict(re.split(r" {2,}", line, maxsplit=1) for line in out.splitlines()[1:])
        assert re.split(r" {2,}", rows["flavour"]) == ["watermelon", "chocolate"]
        assert re.split(r" {2,}", rows["seed"]) == ["1", "2"]
        assert rows["fresh runs"] == "3"
        assert rows["Note"].startswith("this shows how 2 designs differ, the winners of these races. It does not show")
        assert "mdesign study compare" in rows["Note"]
        assert "Note" not in mdesign("runs", "compare", races / "a")[1]

    def test_winners_on_the_same_instances(self, mdesign, races):
        code, out, _ = mdesign("runs", "compare", races / "a", races / "b", "-n", 4, "--json")
        found = json.loads(out)
        assert code == 0
        assert [race["flavour"] for race in found["races"]] == ["watermelon", "chocolate"]
        assert "pseudo-replication" in found["note"]
        mission = load_mission("aggregation", QUICK[1::2])
        for one, name in zip(found["evaluation"]["fsms"], "ab", strict=True):
            pfsm = read_fsm(races / name / "fsm.txt").pfsm
            scores = evaluate(mission, pfsm, seeds=fresh_instances(1, 4)).scores.values
            assert (one["name"], tuple(one["scores"])) == (str(races / name), scores)
        text = mdesign("runs", "compare", races / "a", races / "b", "-n", 4)[1]
        assert "against the best" in text
        assert "Best: " in text

    def test_other_missions_are_refused(self, mdesign, races):
        assert mdesign("runs", "compare", races / "a", races / "other")[0] == 0
        code, _, err = mdesign("runs", "compare", races / "a", races / "other", "-n", 2)
        assert code == 1
        assert f"{races / 'other'}: expected the mission and robot model of {races / 'a'}" in err

    def test_no_race(self, mdesign, races, tmp_path):
        code, _, err = mdesign("runs", "compare", races / "a", tmp_path)
        assert (code, str(tmp_path) in err) == (1, True)

    def test_a_picture(self, mdesign, races, tmp_path):
        strange = tmp_path / "<script>&\u202e"
        shutil.copytree(races / "b", strange)
        code, _, _ = mdesign("runs", "compare", races / "a", strange, "--plot", tmp_path / "races.svg")
        assert code == 0
        comments = re.findall(r"<!--(.*?)-->", (tmp_path / "races.svg").read_text())  # matplotlib writes texts there
        ET.parse(tmp_path / "races.svg")  # noqa: S314 - we made it
        texts = " ".join(comments)
        for words in ("aggregation", "budget used [experiments]", "mean score", "mdesign runs compare", "script"):
            assert words in texts
        assert "\u202e" not in texts
        assert "<script" not in re.sub(r"<!--.*?-->", "", (tmp_path / "races.svg").read_text(), flags=re.DOTALL)
