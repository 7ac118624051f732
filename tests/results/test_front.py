"""The front in a run folder: its files, the summary, and the report; of any number of jobs and after a resume."""

import csv
import io
import json
import re
import shutil
from contextlib import redirect_stdout

import numpy as np
import pytest

from mercator_design.race.elimination.fronts import nondominated
from mercator_design.race.session.journal import read
from mercator_design.results.analysis.front import front_of, growth_of_front
from mercator_design.results.facts import Facts
from mercator_design.results.folder import RunFolder
from mercator_design.software.files import read_fsm

MISSION = """
schema: 1
robots: 2
duration: 4
arena: {walls: {shape: regular_polygon, sides: 12, apothem: 1.226}}
floor: {zones: [{name: spot, shape: disc, center: [0, 0], radius: 0.5, color: black}]}
placement: {shape: disc, radius: 1.2}
objectives:
- {name: robots_in_zone, zones: [spot], when: always, direction: maximise}
- {name: path_length, direction: minimise}
"""
BUDGET = 200


@pytest.fixture(scope="module")
def raced(mdesign_once, tmp_path_factory):
    """A folder, and what the race printed."""
    folder = tmp_path_factory.mktemp("fronts")
    (folder / "two.yaml").write_text(MISSION)
    options = ("--budget", BUDGET, "--seed", 3, "--test-runs", 5, "--progress", "none")
    with redirect_stdout(io.StringIO()) as out:
        mdesign_once("race", folder / "two.yaml", *options, "-j", 2, "-o", folder / "run")
    return folder, out.getvalue()


def rows(folder):
    with (folder / "front.csv").open() as file:
        return list(csv.DictReader(file))


pytestmark = pytest.mark.together


def test_the_front_is_measured_on_fresh_instances(raced):
    folder = raced[0] / "run"
    found, tests = rows(folder), read(folder / "journal.jsonl").record.tests
    assert [row["winner"] for row in found].count("True") == 1
    for row in found:
        own = [one.scores for where, one in tests.items() if where.configuration == int(row["configuration"])]
        assert (len(own), row["runs"], row["fresh"]) == (5, "5", "True")
        for k, name in enumerate(("robots_in_zone", "path_length")):
            values = [scores[k] for scores in own]
            assert float(row[f"{name} mean"]) == pytest.approx(np.mean(values))
            assert float(row[f"{name} standard error"]) == pytest.approx(np.std(values, ddof=1) / np.sqrt(5))
    costs = np.array([[-float(row["robots_in_zone mean"]), float(row["path_length mean"])] for row in found])
    assert [row["on_front"] == "True" for row in found] == nondominated(costs).tolist()
    assert costs[:, 0].tolist() == sorted(costs[:, 0])


def test_designs_of_the_front_have_files(raced, mdesign):
    folder = raced[0] / "run"
    found = {row["file"]: row["fsm"] for row in rows(folder) if row["on_front"] == "True"}
    assert {file.name for file in folder.glob("front-*.txt")} == found.keys()
    for name in found:
        assert read_fsm(folder / name).header["mission"] == "two"
    out = mdesign("evaluate", *(folder / name for name in found), "-n", 5, "-j", 1)[1]
    assert out.count("on the front") > len(found) or len(found) == 1


def test_the_summary_lists_it(raced):
    folder, out = raced
    assert "robots_in_zone (maximise)" in out
    assert "front.csv" in out
    for row in rows(folder / "run"):
        if row["on_front"] == "True":
            assert re.search(rf"^ +{row['configuration']} +", out, flags=re.MULTILINE)


def test_other_verbs_say_what_their_figure_is(raced, mdesign):
    named = "Objectives maximise robots_in_zone and minimise path_length; a single figure is by the first"
    assert named in mdesign("runs", "show", raced[0] / "run")[1]


def test_runs_show_and_compare_say_what_each_objective_gave(raced, mdesign, tmp_path):
    shown = mdesign("runs", "show", raced[0] / "run")[1]
    tested = shown.partition("Tested     on 5 fresh instances, beyond the budget, mean ± standard error:")[2]
    assert "maximise robots_in_zone  minimise path_length" in tested
    lines = {line.split()[0]: line for line in tested.splitlines() if line.split()}
    for row in rows(raced[0] / "run"):
        line = lines[row["configuration"]]
        assert f"{float(row['path_length mean']):.4g} ± {float(row['path_length standard error']):.2g}" in line
        assert ("on the front" in line) == (row["on_front"] == "True")
    compared = mdesign("runs", "compare", raced[0] / "run")[1]
    assert "maximise robots_in_zone and minimise path_length" in compared
    assert "by the first of these" in compared
    assert "objectives: maximise robots_in_zone" in (raced[0] / "run" / "fsm.txt").read_text()


def test_runs_show_says_why_tests_by_each_objective_are_not_shown(raced, mdesign, tmp_path):
    shutil.copytree(raced[0] / "run", tmp_path / "run")
    (tmp_path / "run/mission.yaml").unlink()
    code, out, err = mdesign("runs", "show", tmp_path / "run")
    assert code == 0, err
    assert "Winner     configuration " in out
    assert re.search(r"^Not shown: .*mission\.yaml", out, flags=re.MULTILINE)


def test_verbs_of_machines_take_a_run_folder_for_its_winner(raced, mdesign):
    folder = raced[0] / "run"
    for verb in ("explain", "lint", "show"):
        of_folder, of_file = (mdesign("fsm", verb, path) for path in (folder, folder / "fsm.txt"))
        assert of_folder[0] == 0
        assert of_folder[1].splitlines()[:1] == of_file[1].splitlines()[:1]
    assert json.loads(mdesign("runs", "list", folder, "--json")[1])[0]["run"] == str(folder)


def test_a_replay_says_what_its_score_is_by(raced, mdesign, tmp_path):
    code, out, err = mdesign("replay", raced[0] / "run", "--mission", raced[0] / "two.yaml", "-o", tmp_path / "x.html")
    assert code == 0
    assert " by robots_in_zone" in out + err


def test_a_race_that_has_ended_is_watched_as_it_was(raced, mdesign):
    _, _, err = mdesign("watch", raced[0] / "run", "--progress", "plain")
    (first,) = [line for line in err.splitlines() if "iteration 1 ended" in line]
    record = read(raced[0] / "run" / "journal.jsonl").record
    incumbent = record.view.incumbents[0]
    best = np.mean([*incumbent.scores.values()])
    assert f"best {best:.4g} in the race ({len(incumbent.scores)} run" in first
    assert f"testing, {len(record.tests)}/{len(record.tests)} experiments" in err


def test_the_report_shows_the_trade_off(raced, mdesign):
    assert mdesign("report", raced[0] / "run", "-j", 1)[0] == 0
    page = (raced[0] / "run" / "report.html").read_text()
    assert "mdesign runs ablation" not in page  # is refused
    found = rows(raced[0] / "run")
    section = page[page.index('<section id="front">') :]
    for row in found:
        x, y = (float(row[f"{name} mean"]) for name in ("robots_in_zone", "path_length"))
        assert f'data-name="{row["configuration"]}" data-x="{x:.6g}" data-y="{y:.6g}"' in section
    assert "The front at work" in page
    assert "hypervolume" in section
    assert "the first of 2 objectives" in page


def test_hypervolume_is_a_share(raced):
    facts = Facts.read(raced[0] / "run")
    found = growth_of_front(facts.designer, facts.record)
    assert found.experiments[-1] == len(facts.record.experiments)
    assert all(0.0 <= volume <= 1.0 + 1e-6 for volume in found.volumes)


def test_jobs_and_a_resume_give_the_same_front(raced, mdesign, tmp_path):
    folder = raced[0]
    one = tmp_path / "one"
    options = ("--budget", BUDGET, "--seed", 3, "--test-runs", 5, "--progress", "none", "--no-report")
    assert mdesign("race", folder / "two.yaml", *options, "-j", 1, "-o", one)[0] == 0
    cut = tmp_path / "cut"
    shutil.copytree(one, cut)
    lines = (cut / "journal.jsonl").read_bytes().splitlines(keepends=True)
    (cut / "journal.jsonl").write_bytes(b"".join(lines[: len(lines) // 2]))
    for file in cut.glob("front*"):
        file.unlink()
    assert mdesign("race", "--resume", cut, "-j", 2, "--progress", "none", "--no-report")[0] == 0
    for name in ("front.csv", "fsm.txt", *(row["file"] for row in rows(one) if row["file"])):
        text = (one / name).read_text()
        assert (folder / "run" / name).read_text() == text
        assert (cut / name).read_text() == text


def test_without_tests_the_results_of_the_race_count(raced, mdesign, tmp_path):
    options = ("--budget", 100, "--test-runs", 0, "--progress", "none", "--no-report", "-j", 1)
    code, out, _ = mdesign("race", raced[0] / "two.yaml", *options, "-o", tmp_path / "run")
    assert code == 0
    assert "in the race, optimistic" in out
    assert {row["fresh"] for row in rows(tmp_path / "run")} == {"False"}
    with RunFolder.reopen(tmp_path / "run") as folder:
        assert front_of(folder.task, folder.journal.record)


def test_methods_by_one_cost_refuse(raced, mdesign, tmp_path):
    code, _, err = mdesign("race", raced[0] / "two.yaml", "--budget", 100, "--method", "tpe", "-o", tmp_path / "run")
    assert code == 1
    assert "expected one of halving, irace, as two has several objectives without weights, found tpe" in err


def test_a_weighted_race_is_one_by_one_cost(raced, mdesign, tmp_path):
    (tmp_path / "w.yaml").write_text(MISSION + "weights: [{low: 0, high: 80}, {low: 0, high: 3}]\n")
    options = ("--budget", 100, "--test-runs", 3, "--progress", "none", "-j", 1, "--method", "random")
    code, out, err = mdesign("race", tmp_path / "w.yaml", *options, "-o", tmp_path / "run")
    assert code == 0, err
    assert "weighted" in out
    assert not (tmp_path / "run" / "front.csv").exists()
    record = read(tmp_path / "run" / "journal.jsonl").record
    one = record.experiments[0]
    assert len(one.scores) == 2
    assert one.score == pytest.approx(((80 - one.scores[0]) / 80 + one.scores[1] / 3) / 2)


def test_what_needs_one_cost_refuses(raced, mdesign, tmp_path):
    needs = "needs one cost, and two has several objectives: give them weights"
    assert f"an ablation {needs}" in mdesign("runs", "ablation", raced[0] / "run", "-j", 1)[2]
    storage = f"sqlite:///{tmp_path}/race.db"
    given = ("--budget", 100, "--optuna", storage, "-o", tmp_path / "run")
    assert f"--optuna {needs}" in mdesign("race", raced[0] / "two.yaml", *given)[2]


def test_an_edited_score_is_found(raced, mdesign, tmp_path):
    assert mdesign("runs", "verify", raced[0] / "run", "-j", 1)[0] == 0
    copy = tmp_path / "copy"
    shutil.copytree(raced[0] / "run", copy)
    text = (copy / "journal.jsonl").read_text()
    (copy / "journal.jsonl").write_text(re.sub(r'"scores":\[[^]]*\]', '"scores":[1.0,2.0]', text, count=1))
    code, _, err = mdesign("runs", "verify", copy, "-j", 1)
    assert (code, "journal.jsonl, line" in err) == (1, True)
