"""The command line: what a user types, sees and finds afterwards."""

import csv
import errno
import json
import os
import re
import resource
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pandas as pd
import pytest
import yaml
from jsonschema import Draft202012Validator

from mercator_design.cli import VERBS, cli
from mercator_design.cli import record as cli_record
from mercator_design.config import shipped
from mercator_design.fsm import parse
from mercator_design.missions.mission import load_mission, parse_mission
from mercator_design.race.session.journal import read
from mercator_design.results import folder as run_folder
from mercator_design.show.text.missions import missions_table
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.simulate import Simulator
from mercator_design.software import read_fsm

# Experiments of two robots for three seconds, so that a race of a hundred takes a moment.
QUICK = ["--set", "robots=2", "--set", "duration=3"]
OUTPUTS = ["--help", "fsm show large.txt", "fsm show large.txt --format text"]
"""Commands that start soon; what the second one prints is more than is kept."""
TRANSITIONS = "".join(f" --n{{0}}x{k} {k % 3} --c{{0}}x{k} {c} --p{{0}}x{k} 0.5" for k, c in enumerate((0, 1, 2, 5)))
LARGE = "--nstates 4" + "".join(f" --s{state} 1 --n{state} 4{TRANSITIONS.format(state)}" for state in range(4))
W1 = "--nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 0 --p0x0 0.5 --s1 1"


@pytest.fixture
def fsm(tmp_path):
    file = tmp_path / "w1.txt"
    file.write_text(f"# mission: aggregation\n{W1}\n")
    return file


def table_lines(summary):
    """The lines on iterations in a race's summary."""
    lines = summary.splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("iteration"))
    return lines[first + 1 : next(k for k, line in enumerate(lines) if line.startswith("Ended"))]


class TestRace:
    def test_from_mission_to_winner(self, mdesign, tmp_path):
        folder = tmp_path / "results"
        code, out, err = mdesign("race", "aggregation", "--budget", 200, "--seed", 7, "-j", 2, "-o", folder, *QUICK)
        assert code == 0
        assert all(line.startswith(("Compiling", "Note: iteration", "aggregation: ")) for line in err.splitlines())
        assert sorted(file.name for file in folder.iterdir()) == [
            "fsm.txt", "journal.jsonl", "mission.yaml", "provenance.json", "results.csv", "robot_model.yaml",
        ]  # fmt: skip
        file = read_fsm(folder / "fsm.txt")
        assert (file.header["mission"], file.header["budget"], file.header["seed"]) == ("aggregation", "200", "7")
        assert file.header["floor"] == "black, gray"
        mission = load_mission(folder / "mission.yaml")
        assert (mission.robots, mission.duration, mission.name) == (2, 3.0, "aggregation")
        assert load_robot_model(mission.robot_model) == load_robot_model("mercator")
        events = [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]
        journal = [event for event in events if event["event"] == "experiment"]
        assert {line["experiment"] for line in journal} == set(range(len(journal)))
        assert 150 < len(journal) <= 200
        provenance = json.loads((folder / "provenance.json").read_text())
        assert provenance["request"]["set"] == ["robots=2", "duration=3"]
        assert (provenance["race"]["budget"], provenance["race"]["seed"]) == (200, 7)
        table = list(csv.DictReader((folder / "results.csv").read_text().splitlines()))
        assert parse(table[0]["fsm"]) == file.pfsm
        assert table[0]["elite_rank"] == "1"
        assert sum(int(row["experiments"]) for row in table) == len(journal)
        own = [line["score"] for line in journal if line["configuration"] == int(table[0]["configuration"])]
        assert float(table[0]["mean"]) == pytest.approx(sum(own) / len(own))
        assert (folder / "fsm.txt").read_text().splitlines()[-1] in out.splitlines()
        assert f"{len(journal)} of 200 experiments, {sum('final' not in x for x in table_lines(out))} iteration" in out

    @pytest.mark.thorough
    def test_same_result_with_any_number_of_jobs(self, mdesign, tmp_path):
        contents = []
        for jobs in (1, 3):
            folder = tmp_path / str(jobs)
            assert mdesign("race", "foraging", "--budget", 150, "-j", jobs, "-o", folder, *QUICK)[0] == 0
            contents.append([(folder / name).read_bytes() for name in ("fsm.txt", "results.csv")])
            contents[-1].append(read(folder / "journal.jsonl").record.digest())
        assert contents[0] == contents[1]

    def test_another_seed_is_another_race(self, mdesign, tmp_path):
        raced = []
        for seed in (1, 2):
            mdesign("race", "foraging", "--budget", 60, "--seed", seed, "-o", tmp_path / str(seed), *QUICK)
            table = csv.DictReader((tmp_path / str(seed) / "results.csv").read_text().splitlines())
            raced.append({row["fsm"] for row in table})
        assert len(raced[0] & raced[1]) < 0.2 * len(raced[0])  # the smallest PFSMs may occur in both

    def test_chocolate_without_light_is_refused_by_name(self, mdesign, tmp_path):
        code, out, err = mdesign("race", "aac", "--budget", 300, "--flavour", "chocolate", "-o", tmp_path / "r", *QUICK)
        assert (code, out) == (3, "")
        assert "phototaxis" in err
        assert "needs light" in err

    def test_a_flavour_with_a_condition_that_the_robot_cannot_see_by(self, mdesign, tmp_path):
        folder = tmp_path / "r"
        code, _, err = mdesign("race", "vanilla_aggregation", "--budget", 60, "-o", folder, *QUICK)
        assert code == 0
        assert "Warning: watermelon: floor colour never fires: robot epuck sees only how bright the ground is\n" in err

    def test_the_least_budget(self, mdesign, tmp_path):
        _, out, _ = mdesign("race", "foraging", "--budget", 20, "-o", tmp_path / "r", *QUICK)
        assert "20 of 20 experiments, 3 iterations," in out
        assert len(table_lines(out)) == 4
        assert "-0" not in out.replace(str(tmp_path), "")  # which may have it

    def test_a_small_budget_works_and_says_what_was_lowered(self, mdesign, tmp_path):
        given = ("--budget", 200, "--method", "irace", *QUICK)
        code, out, _ = mdesign("race", "aggregation", *given, "-o", tmp_path / "r")
        assert code == 0
        assert "Note       a budget of 200 is planned for 2 instead of 9 iterations" in out

    def test_too_small_a_budget_names_one_that_would_do(self, mdesign, tmp_path):
        code, _, err = mdesign("race", "aggregation", "--budget", 10, "-o", tmp_path / "r", *QUICK)
        assert code == 1
        enough = int(re.search(r"at least (\d+)", err)[1])
        assert not (tmp_path / "r").exists()
        assert mdesign("race", "aggregation", "--budget", enough, "-o", tmp_path / "r", *QUICK)[0] == 0
        assert mdesign("race", "aggregation", "--budget", enough - 1, "-o", tmp_path / "q", *QUICK)[0] == 1

    def test_robots_that_do_not_fit(self, mdesign, tmp_path):
        for robots in (45, 200):
            code, _, err = mdesign(
                "race", "aggregation", "--budget", 2000, "--set", f"robots={robots}", "-o", tmp_path / "r"
            )
            assert code == 3
            assert "fit" in err or "need" in err
        assert not (tmp_path / "r").exists()

    def test_results_are_never_mixed(self, mdesign, tmp_path):
        (tmp_path / "precious.txt").write_text("mine")
        code, _, err = mdesign("race", "aggregation", "--budget", 200, "-o", tmp_path, *QUICK)
        assert code == 1
        assert "empty" in err
        assert [file.name for file in tmp_path.iterdir()] == ["precious.txt"]

    def test_two_races_do_not_share_a_folder(self, mdesign, tmp_path, monkeypatch):
        """The other one comes after this one has found the folder empty, and before it writes."""
        monkeypatch.setattr(Path, "iterdir", lambda self: iter(()))
        (tmp_path / "journal.jsonl").write_text("of the other")
        code, _, err = mdesign("race", "aggregation", "--budget", 200, "-o", tmp_path, *QUICK)
        assert code == 1
        assert str(tmp_path) in err
        monkeypatch.undo()
        assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("journal.jsonl", "of the other")]

    def test_a_full_disk_keeps_the_winner(self, mdesign, tmp_path, monkeypatch):
        def full(path, rows):
            raise OSError(errno.ENOSPC, "No space left on device")

        monkeypatch.setattr(run_folder, "write_csv", full)
        code, out, err = mdesign("race", "aggregation", "--budget", 60, "-o", tmp_path / "r", *QUICK)
        assert code == 1
        assert f"{tmp_path / 'r'}: results.csv, provenance.json cannot be written: No space left on device; " in err
        assert (
            "the race has ended and journal.jsonl, fsm.txt are complete; to write the rest when there is space: " in err
        )
        assert "Written" not in out
        assert (tmp_path / "r" / "fsm.txt").read_text().splitlines()[-1] in out.splitlines()
        monkeypatch.undo()
        (command,) = re.findall(r"is space: mdesign (.*)\n", err)
        code, out, _ = mdesign(*shlex.split(command), "--no-report")
        assert code == 0
        assert f"\n\nWritten    {tmp_path / 'r'}: fsm.txt, results.csv, " in out
        assert (tmp_path / "r" / "results.csv").exists()

    @pytest.mark.thorough
    @pytest.mark.skipif(sys.platform != "linux", reason="limits the size of files as Linux does")
    def test_a_journal_has_whole_lines_only(self, mdesign, tmp_path):
        assert mdesign("race", "aggregation", "--budget", 100, "-o", tmp_path / "q", *QUICK)[0] == 0  # and is compiled
        usual = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (5000, usual[1]))
        try:
            code, _, err = mdesign("race", "aggregation", "--budget", 100, "-o", tmp_path / "r", *QUICK)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, usual)
        assert code == 1
        assert f"{tmp_path / 'r'}: results cannot be written" in err
        lines = (tmp_path / "r" / "journal.jsonl").read_text().splitlines(keepends=True)
        assert lines
        assert all(line.endswith("}\n") for line in lines)
        assert mdesign("race", "--resume", tmp_path / "r")[0] == 0
        assert (tmp_path / "q" / "fsm.txt").read_bytes() == (tmp_path / "r" / "fsm.txt").read_bytes()

    def test_default_folder(self, mdesign, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        for number in (1, 2):
            assert mdesign("race", "foraging", "--budget", 60, *QUICK)[0] == 0
            assert (tmp_path / "runs" / f"foraging-{number}" / "fsm.txt").exists()

    @pytest.mark.parametrize(
        ("arguments", "code", "words"),
        [
            (["race", "agregation", "--budget", "200"], 3, "did you mean 'aggregation'"),
            (["race", "aggregation", "--budget", "200", "--set", "robbots=3"], 3, "did you mean 'robots'"),
            (["race", "aggregation", "--budget", "0"], 2, "budget"),
            (["race", "aggregation", "--budget", "many"], 2, "budget"),
            (["race", "aggregation"], 2, "budget"),
            (["race", "aggregation", "--budget", "200", "-j", "0"], 2, "jobs"),
            (["rice"], 2, "rice"),
        ],
    )
    def test_mistakes(self, mdesign, tmp_path, monkeypatch, arguments, code, words):
        monkeypatch.chdir(tmp_path)
        found, out, err = mdesign(*arguments)
        assert (found, out) == (code, "")
        assert words in err
        assert list(tmp_path.iterdir()) == []


class TestEvaluate:
    def test_json(self, mdesign, fsm):
        code, out, _ = mdesign("evaluate", fsm, "-n", 30, "--seed", 3, "--json", *QUICK)
        found = json.loads(out)
        assert code == 0
        assert len(found["scores"]) == len(set(found["seeds"])) == found["runs"] == 30
        mean = sum(found["scores"]) / 30
        assert found["mean"] == pytest.approx(mean)
        sd = (sum((score - mean) ** 2 for score in found["scores"]) / 29) ** 0.5
        assert found["standard_deviation"] == pytest.approx(sd)
        low, high = found["confidence_interval"]
        assert (high - low) / 2 == pytest.approx(2.04523 * sd / 30**0.5, rel=1e-5)  # t table, 29 degrees of freedom
        assert found["quartiles"] == sorted(found["quartiles"])
        assert found["direction"] == "maximise"

    def test_same_scores_with_any_number_of_jobs_and_a_longer_series_begins_alike(self, mdesign, fsm):
        scores = [
            json.loads(mdesign("evaluate", fsm, "-n", n, "-j", jobs, "--json", *QUICK)[1])["scores"]
            for n, jobs in ((25, 1), (25, 4), (40, 2))
        ]
        assert scores[0] == scores[1] == scores[2][:25]

    def test_one_run_has_no_spread(self, mdesign, fsm):
        found = json.loads(mdesign("evaluate", fsm, "-n", 1, "--json", *QUICK)[1])
        assert found["standard_deviation"] is None
        assert found["confidence_interval"] is None
        assert mdesign("evaluate", fsm, "-n", 1, *QUICK)[0] == 0

    def test_mission_of_the_folder_comes_before_the_header(self, mdesign, tmp_path):
        folder = tmp_path / "r"
        mdesign("race", "aggregation", "--budget", 60, "-o", folder, "--set", "robots=1", "--set", "duration=2")
        found = json.loads(mdesign("evaluate", folder / "fsm.txt", "-n", 20, "--json")[1])
        assert max(found["scores"]) <= 1  # of one robot, as raced

    def test_a_run_folder_stands_for_its_winner(self, mdesign, tmp_path, fsm, monkeypatch):
        folder = tmp_path / "r"
        folder.mkdir()
        (tmp_path / "r" / "fsm.txt").write_text(fsm.read_text())
        monkeypatch.chdir(tmp_path)
        found = [mdesign("evaluate", file, "-n", 10, "--json", *QUICK) for file in (folder, folder / "fsm.txt")]
        assert found[0] == found[1]
        assert mdesign("record", folder, *QUICK, "-o", "trace.csv")[0] == 0
        assert mdesign("replay", folder, *QUICK, "--compare", folder)[0] == 0
        code, _, err = mdesign("evaluate", tmp_path)
        assert code == 3
        assert str(tmp_path) in err

    def test_a_moved_file_is_measured_on_the_mission_that_was_raced(self, mdesign, tmp_path):
        folder = tmp_path / "r"
        mdesign("race", "aggregation", "--budget", 60, "-o", folder, "--set", "robots=4", "--set", "duration=4")
        here = json.loads(mdesign("evaluate", folder / "fsm.txt", "-n", 10, "--json")[1])
        moved = tmp_path / "fsm.txt"
        moved.write_bytes((folder / "fsm.txt").read_bytes())
        assert json.loads(mdesign("evaluate", moved, "-n", 10, "--json")[1]) == here
        moved.write_text(moved.read_text().replace("robots=4", "robots=2"))
        code, _, err = mdesign("evaluate", moved, "-n", 10)
        assert code == 3
        assert "has changed since" in err

    def test_a_moved_file_of_a_mission_of_ones_own_wants_that(self, mdesign, tmp_path):
        text = shipped.missions()["aggregation"].read_text().replace("duration: 120", "duration: 3")
        (tmp_path / "mine.yaml").write_text(text)
        mdesign("race", tmp_path / "mine.yaml", "--budget", 60, "-o", tmp_path / "r")
        assert json.loads(mdesign("evaluate", tmp_path / "r" / "fsm.txt", "-n", 2, "--json")[1])["mission"] == "mine"
        (tmp_path / "moved.txt").write_bytes((tmp_path / "r" / "fsm.txt").read_bytes())
        code, _, err = mdesign("evaluate", tmp_path / "moved.txt", "-n", 2)
        assert code == 3
        assert "mine" in err
        assert "--mission" in err
        assert mdesign("evaluate", tmp_path / "moved.txt", "--mission", tmp_path / "mine.yaml", "-n", 2)[0] == 0

    @pytest.mark.parametrize("text", ["[", "7", "[7]"])
    def test_a_header_that_was_edited(self, mdesign, tmp_path, text):
        (tmp_path / "fsm.txt").write_text(f"# mission: aggregation\n# set: {text}\n{W1}\n")
        code, _, err = mdesign("evaluate", tmp_path / "fsm.txt")
        assert code == 3
        assert "fsm.txt: set in the header" in err

    def test_mission_given(self, mdesign, fsm):
        found = json.loads(
            mdesign("evaluate", fsm, "--mission", "grid_exploration", "-n", 2, "--json", "--set", "duration=3")[1]
        )
        assert (found["mission"], found["direction"]) == ("grid_exploration", "minimise")

    def test_no_mission(self, mdesign, tmp_path):
        (tmp_path / "bare.txt").write_text(W1)
        code, _, err = mdesign("evaluate", tmp_path / "bare.txt")
        assert code == 2
        assert "--mission" in err

    def test_mission_of_the_header_is_gone(self, mdesign, tmp_path):
        (tmp_path / "old.txt").write_text(f"# mission: my_old_mission\n{W1}\n")
        code, _, err = mdesign("evaluate", tmp_path / "old.txt")
        assert code == 3
        assert "my_old_mission" in err
        assert "--mission" in err

    def test_a_robot_without_light_direction(self, mdesign, tmp_path):
        (tmp_path / "choco.txt").write_text("# flavour: chocolate\n--nstates 1 --s0 2\n")
        code, _, err = mdesign("evaluate", tmp_path / "choco.txt", "--mission", "aac", *QUICK)
        assert code == 3
        assert "phototaxis needs light" in err

    @pytest.mark.parametrize("command", [["evaluate", "-n", "1"], ["record", "-o", "trace.csv"]])
    def test_what_makes_no_difference_is_reported(self, mdesign, tmp_path, monkeypatch, command):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "fsm.txt").write_text(W1.replace("--c0x0 0 --p0x0 0.5", "--c0x0 6 --p0x0 0.5 --l0x0 2"))
        name, *options = command
        on = ["--mission", "color_aggregation", "--robot-model", "epuck", *QUICK]
        code, _, err = mdesign(name, "fsm.txt", *options, *on)
        assert code == 0
        file = shipped.missions()["color_aggregation"]
        line = file.read_text().splitlines().index("floor:") + 1
        assert [line for line in err.splitlines() if not line.startswith("Compiling")] == [
            "Warning: state 0, transition 0: floor colour never fires: robot epuck sees only how bright the ground is",
            f"Warning: {file}:{line}: floor: no condition of robot epuck distinguishes gray, green, red",
        ]

    def test_lenient(self, mdesign, tmp_path):
        (tmp_path / "loose.txt").write_text("--nstates 1 --s0 0 --rwm0 20.7")
        options = ["--mission", "aggregation", "-n", 2, *QUICK]
        assert mdesign("evaluate", tmp_path / "loose.txt", *options)[0] == 3
        code, _, err = mdesign("evaluate", tmp_path / "loose.txt", "--lenient", *options)
        assert code == 0
        assert "20.7 was read as 20" in err


class TestValidate:
    def test_each_file_has_its_line(self, mdesign, tmp_path, fsm):
        (tmp_path / "bad.yaml").write_text("schema: 1\nrobots: -3\n")
        (tmp_path / "bad.txt").write_text("--nstates 1 --s0 9")
        code, out, err = mdesign("validate", "aggregation", fsm, tmp_path / "bad.yaml", tmp_path / "bad.txt")
        assert code == 3
        assert "valid mission" in out.splitlines()[0]
        assert "valid watermelon FSM, 2 states, 1 transition" in out.splitlines()[1]
        assert "bad.yaml:2: robots" in err
        assert "bad.txt:1: --s0" in err

    @pytest.mark.thorough
    def test_all_that_is_shipped_is_valid(self, mdesign):
        code, _, err = mdesign("validate", *shipped.missions(), *shipped.robot_models().values())
        assert (code, err) == (0, "")

    def test_a_robot_model(self, mdesign, tmp_path):
        text = shipped.robot_models()["mercator"].read_text()
        (tmp_path / "good.yaml").write_text(text)
        (tmp_path / "bad.yaml").write_text(text.replace("mass: 2.0", "mass: -2.0"))
        code, out, err = mdesign("validate", tmp_path / "good.yaml", tmp_path / "bad.yaml")
        assert code == 3
        assert "valid robot model mercator" in out
        assert "body.mass" in err

    @pytest.mark.parametrize("key", ["body", "drive"])
    def test_a_robot_model_with_a_misspelt_key_is_one(self, mdesign, tmp_path, key):
        text = shipped.robot_models()["mercator"].read_text()
        (tmp_path / "bad.yaml").write_text(text.replace(f"\n{key}:", f"\n{key}x:"))
        code, _, err = mdesign("validate", tmp_path / "bad.yaml")
        assert code == 3
        assert f"{key}x: unknown key; did you mean '{key}'?" in err
        (tmp_path / "based.yaml").write_text("schema: 1\nbasis: epuck\nneighbours: {range: 0.3}\n")
        assert (
            "basis: unknown key; known: schema, name, description, body"
            in mdesign("validate", tmp_path / "based.yaml")[2]
        )

    def test_a_mission_with_a_key_of_robot_models_is_a_mission(self, mdesign, tmp_path):
        text = shipped.missions()["aggregation"].read_text()
        (tmp_path / "bad.yaml").write_text(f"{text}body: {{shape: disc}}\n")
        code, _, err = mdesign("validate", tmp_path / "bad.yaml")
        assert code == 3
        assert "body: unknown key; known: schema, name, description, source, robots" in err

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("schema: 1\nname: r1\nports: {rvr: /dev/serial0}\n", "robot.yaml: mercator-robot check --robot"),
            ("schema: 1\nrobots: [{name: r1, host: r1}]\n", "robots.yaml: mdesign deploy --robots"),
        ],
    )
    def test_what_is_of_the_robots_is_reported(self, mdesign, tmp_path, text, words):
        file = tmp_path / "mine.yaml"
        file.write_text(text)
        code, _, err = mdesign("validate", file)
        assert (code, f"{words} {file}" in err) == (3, True), err

    def test_what_makes_no_difference_is_reported(self, mdesign, tmp_path):
        robot, mission = tmp_path / "far.yaml", tmp_path / "colours.yaml"
        robot.write_text("schema: 1\nbase: epuck\nneighbours: {range: 2}\n")
        text = shipped.missions()["color_aggregation"].read_text()
        mission.write_text(text.replace("robot_model: mercator", "robot_model: ./far.yaml"))
        code, out, err = mdesign("validate", robot, mission)
        assert code == 0
        assert len(out.splitlines()) == 2
        far = f"Warning: {robot}:3: neighbours.range: 2 m changes nothing"
        line = mission.read_text().splitlines().index("floor:") + 1
        assert [line.partition(", as")[0] for line in err.splitlines()] == [
            far,
            far,
            f"Warning: {mission}:{line}: floor: no condition of robot far distinguishes gray, green, red",
        ]

    def test_all_mistakes_are_told_each_in_its_line(self, mdesign, tmp_path):
        text = shipped.missions()["aggregation"].read_text().replace("robots: 3", "robots: many")
        (tmp_path / "bad.yaml").write_text(text.replace("radius:", "raduis:"))
        code, _, err = mdesign("validate", tmp_path / "bad.yaml")
        assert code == 3
        assert [line.startswith(f"Error: {tmp_path}/bad.yaml:") for line in err.splitlines()] == [True] * 3
        assert err.count("did you mean 'radius'?") == 2

    def test_a_mission_in_the_other_spelling_is_one(self, mdesign, tmp_path):
        text = shipped.robot_models()["epuck"].read_text().replace("neighbours:", "neighbors:")
        (tmp_path / "model.yaml").write_text(text)
        assert mdesign("validate", tmp_path / "model.yaml") == (
            0,
            f"{tmp_path}/model.yaml: valid robot model epuck\n",
            "",
        )


BLOCKED = [
    "arena.obstacles=[{center: [0, 0], size: [0.02, 3]}]",
    "floor.zones[0].center=[0.7, 0]",
    "floor.zones[0].radius=0.2",
    "placement={shape: disc, center: [-0.6, 0], radius: 0.3}",
    "robots=1",
]


class TestWhatCannotBe:
    WHY = "floor.zones[0]: no robot can reach zone 'spot': "
    SO = "; so every score is the same, whatever the robots do"

    def test_it_is_refused(self, mdesign, tmp_path):
        _, text, _ = mdesign("missions", "show", "aggregation", *(word for each in BLOCKED for word in ("--set", each)))
        (tmp_path / "blocked.yaml").write_text(text)
        code, out, err = mdesign("validate", tmp_path / "blocked.yaml")
        assert (code, out) == (3, "")
        (error,) = err.splitlines()
        assert re.fullmatch(rf"Error: \S+blocked.yaml:\d+: {re.escape(self.WHY)}.*{self.SO}", error)
        code, _, err = mdesign("race", tmp_path / "blocked.yaml", "--budget", 60, "-o", tmp_path / "results")
        assert (code, self.WHY in err, (tmp_path / "results").exists()) == (3, True, False)

    def test_elsewhere_it_is_reported(self, mdesign, tmp_path, fsm):
        options = [word for each in [*BLOCKED, "duration=1"] for word in ("--set", each)]
        code, _, err = mdesign("evaluate", fsm, "-n", 2, *options)
        assert (code, self.WHY in err) == (0, True)
        code, _, err = mdesign("missions", "preview", "aggregation", "-o", tmp_path / "a.png", *options)
        assert (code, self.WHY in err) == (0, True)
        code, _, err = mdesign("evaluate", fsm, "-n", 2, "--cost", *options)
        assert (code, err) == (0, "")


class TestPlacesToStart:
    def test_robots_must_find_places(self, mdesign, tmp_path):
        text = shipped.missions()["aggregation"].read_text().replace("robots: 3", "robots: 45")
        (tmp_path / "crowd.yaml").write_text(text)
        code, _, err = mdesign("validate", tmp_path / "crowd.yaml")
        assert code == 3
        assert "fit" in err


def test_a_diagram(mdesign, fsm):
    code, out, _ = mdesign("fsm", "show", fsm, "--format", "dot")
    assert code == 0
    assert out.startswith("digraph")
    assert "S0 -> C0x0 -> S1;" in out


class TestMissions:
    @pytest.mark.parametrize("arguments", [["missions"], ["missions", "list"]])
    def test_they_are_listed_a_line_each(self, mdesign, arguments):
        code, out, _ = mdesign(*arguments)
        assert code == 0
        lines = out.splitlines()[1:]
        assert [line.split()[0] for line in lines] == list(shipped.missions())
        assert next(line for line in lines if line.startswith("grid_exploration ")).split()[1:6] == [
            "3", "120", "s", "minimise", "cell_age",
        ]  # fmt: skip

    @pytest.mark.parametrize("command", ["missions", "robots"])
    def test_lines_are_cut_to_a_terminal(self, mdesign, monkeypatch, command):
        whole = mdesign(command, "list")[1].splitlines()
        monkeypatch.setenv("COLUMNS", "70")
        monkeypatch.setattr("sys.stdout.isatty", lambda: True)
        lines = mdesign(command, "list")[1].splitlines()
        assert len(lines) == len(whole)
        assert max(map(len, lines)) == 70 < max(map(len, whole))
        cut = [(line, text) for line, text in zip(lines, whole, strict=True) if line.endswith("…")]
        assert len(cut) > 0.5 * len(lines)
        assert all(len(line) == 70 and line[-15:-1] in text for line, text in cut)

    def test_a_terminal_shows_the_beginning_of_what_a_mission_is(self):
        line = next(line for line in missions_table(80).splitlines() if line.startswith("aggregation "))
        assert load_mission("aggregation").description.startswith(line[:-1].rpartition("  ")[2])
        assert len(line) == 80

    def test_list_for_programs(self, mdesign):
        found = json.loads(mdesign("missions", "list", "--json")[1])
        assert [mission["name"] for mission in found] == list(shipped.missions())
        first = found[0]
        assert load_mission(first["file"]).digest == load_mission(first["name"]).digest
        assert (first["robots"], first["objective"], first["direction"]) == (3, "robots_in_zone", "maximise")

    def test_show_gives_the_file_to_start_from(self, mdesign, tmp_path):
        code, out, _ = mdesign("missions", "show", "aggregation")
        assert code == 0
        assert out == shipped.missions()["aggregation"].read_text()
        (tmp_path / "my.yaml").write_text(out)
        assert mdesign("missions", "show", tmp_path / "my.yaml")[1] == out

    def test_show_with_overrides_gives_what_would_be_raced(self, mdesign):
        out = mdesign("missions", "show", "aggregation", "--set", "robots=7")[1]
        assert parse_mission(out) == load_mission("aggregation", ["robots=7"])

    @pytest.mark.parametrize("command", ["show", "preview"])
    def test_no_such_mission(self, mdesign, tmp_path, monkeypatch, command):
        monkeypatch.chdir(tmp_path)
        code, out, err = mdesign("missions", command, "agregation")
        assert (code, out) == (3, "")
        assert "did you mean 'aggregation'?" in err
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.thorough
    def test_preview(self, mdesign, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        assert mdesign("missions", "preview", "aggregation")[:2] == (0, "aggregation.png\n")
        assert (tmp_path / "aggregation.png").read_bytes().startswith(b"\x89PNG")
        picture = tmp_path / "p.svg"
        assert mdesign("missions", "preview", "aggregation", "-o", picture, "--set", "robots=5")[1] == f"{picture}\n"
        before = picture.read_bytes()
        assert mdesign("missions", "preview", "aggregation", "-o", picture, "--robot-model", "epuck")[0] == 0
        assert picture.read_bytes() != before

    @pytest.mark.parametrize(
        ("arguments", "code", "words"),
        [
            (["preview", "aggregation", "-o", "p.pdf"], 2, "ends in .png or .svg, found 'p.pdf'"),
            (["preview", "aggregation", "-o", "png"], 2, "ends in .png or .svg, found 'png'"),
            (
                ["preview", "aggregation", "-o", "nowhere/p.png"],
                1,
                "nowhere/p.png: cannot be written: No such file",
            ),
            (["preview", "aggregation", "--set", "robots=50"], 3, "the robots do not fit"),
            (["preview"], 2, "MISSION"),
            (["sample"], 2, "--class"),
            (["sample", "--class", "dancing"], 2, "dancing"),
            (["sample", "--class", "homing", "-n", "0"], 2, "'-n'"),
            (
                ["sample", "--class", "homing", "-o", "file/deeper"],
                1,
                "file/deeper: cannot be written: Not a directory",
            ),
        ],
    )
    def test_mistakes(self, mdesign, tmp_path, monkeypatch, arguments, code, words):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "file").touch()
        found, out, err = mdesign("missions", *arguments)
        assert (found, out) == (code, "")
        assert words in err
        assert [file.name for file in tmp_path.iterdir()] == ["file"]

    def test_samples_are_valid_and_a_longer_series_begins_alike(self, mdesign, tmp_path):
        options = ["--class", "homing", "--seed", 3]
        code, out, _ = mdesign("missions", "sample", *options, "-n", 2, "-o", tmp_path / "two")
        assert code == 0
        assert out.splitlines() == [str(tmp_path / "two" / f"homing-3-{number}.yaml") for number in (1, 2)]
        assert mdesign("validate", *out.splitlines())[0] == 0
        mdesign("missions", "sample", *options, "-o", tmp_path / "one")
        first = (tmp_path / "one" / "homing-3-1.yaml").read_bytes()
        assert first == (tmp_path / "two" / "homing-3-1.yaml").read_bytes()

    def test_samples_replace_nothing(self, mdesign, tmp_path):
        (tmp_path / "homing-1-2.yaml").write_text("mine")
        code, out, err = mdesign("missions", "sample", "--class", "homing", "-n", 3, "-o", tmp_path)
        assert (code, out) == (1, "")
        assert "homing-1-2.yaml" in err
        assert [file.name for file in tmp_path.iterdir()] == ["homing-1-2.yaml"]


class TestSchema:
    def test_of_missions_and_robot_models(self, mdesign):
        mission = json.loads(mdesign("schema")[1])
        Draft202012Validator(mission).validate(yaml.safe_load(shipped.missions()["foraging"].read_text()))
        model = json.loads(mdesign("schema", "robot-model")[1])
        for file in shipped.robot_models().values():
            Draft202012Validator(model).validate(yaml.safe_load(file.read_text()))
        assert mdesign("schema", "race")[0] == 2

    @pytest.mark.usefixtures("registries")
    def test_knows_plugins(self, mdesign, tmp_path):
        plugin = tmp_path / "mine.py"
        plugin.write_text(
            "from mercator_design import objective\n"
            "@objective\n"
            "def eastmost(\n"
            "    trace,\n"
            "    *,\n"
            "    start: float = 0.0,  # [m] from where distances count\n"
            "    bonus: float,\n"
            "):\n"
            "    return float(trace.final_positions[:, 0].max()) - start + bonus\n"
        )
        code, out, _ = mdesign("schema", "--plugin", plugin)
        assert code == 0
        alternatives = json.loads(out)["$defs"]["Objective"]["oneOf"]
        (own,) = [each for each in alternatives if each["properties"]["name"] == {"const": "eastmost"}]
        assert own["properties"]["bonus"] == {"type": "number"}
        assert own["properties"]["start"]["description"] == "[m] from where distances count"


def test_help_without_arguments_is_a_page(mdesign):
    code, out, err = mdesign()
    lines = (out or err).splitlines()
    assert code in {0, 2}  # as the version of click has it
    assert lines[0].startswith("Usage: mdesign")
    assert {"race", "evaluate", "robots"} <= {line.split()[0] for line in lines if line.startswith("  ")}
    assert "\\n" not in out + err


def test_each_verb_is_found_by_its_name():
    context = click.Context(cli)
    assert [cli.get_command(context, name).name for name in VERBS] == sorted(VERBS)


@pytest.mark.thorough
def test_heavy_modules_are_loaded_when_they_are_needed():
    """None for help; a verb loads neither numba nor what the processes and statistics of races need."""
    script = (
        "import sys; from mercator_design.cli import cli; cli(['--help'], standalone_mode=False);"
        "heavy = {'numpy', 'numba', 'pymunk', 'scipy', 'pandas', 'joblib', 'optuna', 'rich', 'matplotlib'};"
        "print('heavy:', *heavy & set(sys.modules));"
        "import mercator_design.cli.races.race, mercator_design.cli.races.tune, mercator_design.cli.races.runs;"
        "heavy = {'numba', 'scipy.special', 'scipy.ndimage', 'pandas', 'joblib', 'optuna', 'matplotlib'};"
        "print('heavy:', *heavy & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "heavy:"
    assert done.stdout.count("heavy:\n") == 2


def test_control_software_runs_on_the_standard_library_alone():
    """As on the robot: every module of control software imports and runs where nothing heavy is installed."""
    script = f"""
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in {{'numpy', 'numba', 'pymunk', 'scipy', 'pandas', 'joblib', 'optuna', 'rich', 'PIL'}}:
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Absent())
import importlib, pkgutil, mercator_design.fsm as fsm
from mercator_design.software import Controller
for room in ('fsm', 'modules', 'network', 'plugins', 'software', 'tree'):
    package = importlib.import_module('mercator_design.' + room)
    for module in pkgutil.iter_modules(package.__path__):
        importlib.import_module('mercator_design.' + room + '.' + module.name)
controller = Controller(fsm.parse({W1!r}))
for _ in range(5):
    wheels = controller.step(fsm.Readings(ground_red=0., ground_green=0., ground_blue=0.), [0.1] * 9)
assert controller.state == 1 and wheels[:2] == (0, 0), wheels
"""
    environment = {key: value for key, value in os.environ.items() if key != "NUMBA_DISABLE_JIT"}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


class TestRecord:
    def test_a_table(self, mdesign, tmp_path):
        (tmp_path / "fsm.txt").write_text("--nstates 1 --s0 0 --rwm0 20")
        options = ["--mission", "aggregation", "--set", "duration=2", "--seed", 3, "--every", 5]
        out = tmp_path / "trace.csv"
        code, text, err = mdesign("record", tmp_path / "fsm.txt", *options, "--devices", "imu, wheels", "-o", out)
        assert (code, err) == (0, "")
        assert "seed 3, score" in text
        table = pd.read_csv(out)
        assert list(table.columns) == [
            *[
                "time",
                "robot",
                "x",
                "y",
                "heading",
                "state",
                "led_colour",
                "signal",
                "imu_0",
                "imu_1",
                "imu_2",
                "wheels_0",
                "wheels_1",
            ]
        ]
        assert table.time.unique().tolist() == [0.5, 1.0, 1.5, 2.0]
        assert len(table) == 4 * 3

    def test_arrays(self, mdesign, tmp_path):
        (tmp_path / "fsm.txt").write_text("--nstates 1 --s0 0 --rwm0 20")
        options = ["--mission", "aggregation", "--set", "duration=2", "--devices", "lidar", "--every", 10]
        assert mdesign("record", tmp_path / "fsm.txt", *options, "-o", tmp_path / "trace.npz")[0] == 0
        with np.load(tmp_path / "trace.npz") as arrays:
            assert arrays["lidar"].shape == (2, 3, 719)
            assert arrays["pose"].shape == (2, 3, 3)
            assert arrays["time"].tolist() == [1.0, 2.0]

    def test_turns_of_the_lidars_and_odometry(self, mdesign, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "fsm.txt").write_text("--nstates 1 --s0 0 --rwm0 20")
        options = ["--mission", "map_dodecagon", "--set", "duration=2", "--turns"]
        assert mdesign("record", "fsm.txt", *options, "-o", "trace.npz")[0] == 0
        with np.load("trace.npz") as arrays:
            turns, beams = 12, 719
            assert arrays["turn"].shape == (turns, 3, beams)
            assert (arrays["turn"] > 0.0).mean() > 0.99
            assert arrays["turn_start"].shape == (turns, 3)
            assert (np.diff(arrays["turn_angle"]) < 0.0).all()
            assert (np.diff(arrays["turn_time"]) > 0.0).all()
            assert arrays["odometry_time"].shape == (41, 3)
            assert arrays["odometry"].shape == (41, 3, 3)
        low = ["--mission", "aggregation", "--set", "duration=1", "--turns"]
        code, _, err = mdesign("record", "fsm.txt", *low, "-o", "low.npz")
        assert code == 0
        assert "Warning: aggregation: lidars look over all walls and see only robots" in err
        code, _, err = mdesign("record", "fsm.txt", *options, "-o", "trace.csv")
        assert code == 2
        assert "--turns: expected an --output that ends in .npz, found trace.csv" in err
        long = ["--mission", "map_dodecagon", "--set", "duration=86400", "--every", 1000, "--turns"]
        code, _, err = mdesign("record", "fsm.txt", *long, "-o", "long.npz")
        assert code == 1
        assert "turns: a recording of" in err

    @pytest.mark.parametrize(("every", "times"), [(8, [0.8, 1.6, 2.0]), (20, [2.0]), (1000, [2.0])])
    def test_the_last_cycle_is_always_there(self, mdesign, tmp_path, every, times):
        (tmp_path / "fsm.txt").write_text("--nstates 1 --s0 0 --rwm0 20")
        options = ["--mission", "aggregation", "--set", "duration=2"]
        for n, name in ((1, "all.csv"), (every, "some.csv")):
            assert mdesign("record", tmp_path / "fsm.txt", *options, "--every", n, "-o", tmp_path / name)[0] == 0
        whole, some = pd.read_csv(tmp_path / "all.csv"), pd.read_csv(tmp_path / "some.csv")
        assert some.time.unique().tolist() == times
        assert some.equals(whole[whole.time.isin(times)].reset_index(drop=True))

    def test_what_is_too_large_is_said_before_the_experiment(self, mdesign, tmp_path, monkeypatch):
        monkeypatch.setattr(Simulator, "run", None)
        (tmp_path / "fsm.txt").write_text("--nstates 1 --s0 0 --rwm0 20")
        options = ["--mission", "aggregation", "--set", "duration=86400", "-o", tmp_path / "trace.npz"]
        code, _, err = mdesign("record", tmp_path / "fsm.txt", *options, "--devices", "imu,lidar,imu", "--every", 2)
        assert code == 1
        assert "poses, states, imu, lidar: a recording of" in err
        assert [path.name for path in tmp_path.iterdir()] == ["fsm.txt"]

    @pytest.mark.parametrize("error", [KeyboardInterrupt, OSError(errno.ENOSPC, "No space left on device")])
    def test_a_file_is_whole_or_not_there(self, mdesign, tmp_path, monkeypatch, error):
        def torn(file, *_, **__):
            file.write(b"time,")
            raise error

        monkeypatch.setattr(cli_record, "write_recording", torn)
        (tmp_path / "fsm.txt").write_text("--nstates 1 --s0 0 --rwm0 20")
        (tmp_path / "trace.csv").write_text("of before")
        options = ["--mission", "aggregation", "--set", "duration=1", "-o", tmp_path / "trace.csv"]
        code, out, err = mdesign("record", tmp_path / "fsm.txt", *options)
        assert (code, out) == ((130, "") if error is KeyboardInterrupt else (1, ""))
        assert "Interrupted" in err or "trace.csv: cannot be written: No space left" in err
        assert sorted(path.name for path in tmp_path.iterdir()) == ["fsm.txt", "trace.csv"]
        assert (tmp_path / "trace.csv").read_text() == "of before"

    @pytest.mark.parametrize(
        ("options", "code", "words"),
        [
            (["-o", "trace.txt"], 2, "expected a name that ends in .csv or .npz"),
            (["-o", "trace.csv", "--devices", "radar"], 2, "expected a device: wheels, leds"),
            (["-o", "trace.csv", "--robot-model", "epuck", "--devices", "lidar"], 1, "robot epuck has no lidar"),
            (["-o", "nowhere/trace.csv"], 1, "nowhere/trace.csv: cannot be written: No such file"),
            (
                ["-o", "trace.csv", "--devices", "lidar", "--set", "duration=86400"],
                1,
                "poses, states, lidar: a recording of 15346 MiB, expected at most 2048 MiB; record fewer devices",
            ),
        ],
    )
    def test_mistakes_are_named(self, mdesign, tmp_path, monkeypatch, options, code, words):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "fsm.txt").write_text("--nstates 1 --s0 0 --rwm0 20")
        short = [] if "--set" in options else ["--set", "duration=1"]
        found, out, err = mdesign("record", "fsm.txt", "--mission", "aggregation", *short, *options)
        assert (found, out) == (code, "")
        assert words in err
        assert sorted(path.name for path in tmp_path.iterdir()) == ["fsm.txt"]


class TestRobots:
    def test_list(self, mdesign):
        code, out, _ = mdesign("robots", "list")
        assert code == 0
        names = [line.split()[0] for line in out.splitlines()]
        assert names == list(shipped.robot_models()) == sorted(names)
        assert mdesign("robots") == (0, out, "")

    def test_show(self, mdesign):
        code, out, _ = mdesign("robots", "show", "epuck")
        assert (code, out) == (0, shipped.robot_models()["epuck"].read_text())
        code, _, err = mdesign("robots", "show", "epuk")
        assert code == 3
        assert "did you mean 'epuck'" in err

    def test_models_are_validated_by_name(self, mdesign):
        assert mdesign("validate", "epuck", "mercator-varied")[0] == 0


ESCAPE = "\x1b[31m\x9b2J\u202e"
"""Colours the terminal, clears it, turns the direction of writing."""


class TestMessages:
    """No text of a user, or of a file from a stranger, steers the terminal; nobody sees a traceback."""

    @pytest.mark.parametrize(
        "arguments",
        [
            ["validate", f"{ESCAPE}.yaml"],
            ["validate", f"{ESCAPE}.txt"],
            ["validate", "escapes.txt", "token.txt"],
            ["evaluate", "mission.txt"],
            ["evaluate", "flavour.txt"],
            ["evaluate", "plugin.txt"],
            ["evaluate", "set.txt"],
            ["evaluate", "ignored.txt", "--lenient", "--mission", ESCAPE],
            ["record", "mission.txt", "-o", f"{ESCAPE}.csv"],
            ["record", "set.txt", "-o", "x.csv", "--devices", ESCAPE],
            ["fsm", "show", ESCAPE],
            ["fsm", "show", "token.txt"],
            ["missions", "show", ESCAPE],
            ["missions", "show", f"{ESCAPE}/"],
            ["missions", "preview", "aggregation", "-o", f"{ESCAPE}/x.png"],
            ["missions", "preview", "aggregation", "--robot-model", f"{ESCAPE}.yaml"],
            ["missions", ESCAPE],
            ["robots", "show", ESCAPE],
            ["race", "aggregation", "--budget", "60", "--set", f"{ESCAPE}=3"],
            ["race", "aggregation", "--budget", "60", "--set", 'name="\\e[31m\\x9b2J\\u202e"'],
            ["race", "aggregation", "--budget", "60", "--set", 'objective.zones=["\\e[31m\\x9b2J\\u202e"]'],
            [
                "race",
                "aggregation",
                "--budget",
                "60",
                "--set",
                'floor.image={path: "\\e[31m\\x9b2J\\u202e", size: [1,1]}',
            ],
            ["race", "aggregation", "--budget", ESCAPE],
            ["race", "aggregation", "--plugin", f"{ESCAPE}.py"],
            ["race", "aggregation", "--plugin", "raises.py"],
            ["race", "aggregation", "--plugin", "names.py"],
            [ESCAPE],
            ["race", f"--{ESCAPE}"],
        ],
    )
    def test_what_they_quote_is_printable(self, mdesign, tmp_path, monkeypatch, arguments):
        monkeypatch.chdir(tmp_path)
        fsm = "--nstates 1 --s0 1"
        for name, text in {
            "escapes.txt": ESCAPE,
            "token.txt": f"--nstates 1 --s0 {ESCAPE}",
            "mission.txt": f"# mission: {ESCAPE}\n{fsm}",
            "flavour.txt": f"# flavour: {ESCAPE}\n{fsm}",
            "plugin.txt": f"# mission: aggregation\n# plugins: {ESCAPE} 0123\n{fsm}",
            "set.txt": f"# mission: aggregation\n# set: {ESCAPE}\n{fsm}",
            "ignored.txt": f"{fsm} --n0 0 --nothing 3",
            "raises.py": f"raise ValueError({ESCAPE!r})",
            "names.py": "from mercator_design import objective\n"
            f"def f(trace, *, x): ...\nf.__name__ = {ESCAPE!r}\nobjective(f)",
        }.items():
            (tmp_path / name).write_text(text)
        code, out, err = mdesign(*arguments)
        assert code in {1, 2, 3}
        assert re.search(r"\\(x1b|u001b)\[31m\\x9b2J\\u202e", err) or "not valid YAML" in err
        assert all(line.isprintable() for line in [*out.splitlines(), *err.splitlines()])

    def test_what_is_long_is_cut(self, mdesign, tmp_path):
        (tmp_path / "long.txt").write_text(f"# mission: {60_000 * 'x'}\n--nstates 1 --s0 1")
        for arguments in (
            ["evaluate", tmp_path / "long.txt"],
            ["missions", "show", "aggregation", "--set", f"objective.zones=[{60_000 * 'x'}]"],
        ):
            code, _, err = mdesign(*arguments)
            assert (code, len(err) < 2000) == (3, True)

    @pytest.mark.parametrize("verb", [["robots", "show"], ["missions", "show"], ["validate"], ["fsm", "show"]])
    @pytest.mark.parametrize("content", [b"\xff\xfe\x00", None])
    def test_what_is_no_text_is_refused(self, mdesign, tmp_path, verb, content):
        file = tmp_path / "x.yaml" if content else Path("/dev/zero")
        if content:
            file.write_bytes(content)
        code, out, err = mdesign(*verb, file)
        assert (code, out) == (3, "")
        assert "expected UTF-8 text" in err or "found a device" in err

    @pytest.mark.thorough
    @pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux has a device that is always full")
    @pytest.mark.parametrize("verb", OUTPUTS)
    def test_no_room_for_the_output(self, verb, tmp_path):
        with Path("/dev/full").open("wb") as full:
            done = run_with_stdout(full, verb, tmp_path)
        assert (done.returncode, done.stderr) == (1, "Error: [Errno 28] No space left on device\n")

    @pytest.mark.thorough
    @pytest.mark.parametrize("verb", OUTPUTS)
    def test_the_reader_of_the_output_goes_away(self, verb, tmp_path):
        reader, writer = os.pipe()
        os.close(reader)
        with os.fdopen(writer, "wb") as stdout:
            done = run_with_stdout(stdout, verb, tmp_path)
        assert (done.returncode, done.stderr) == (128 + signal.SIGPIPE, "")

    @pytest.mark.thorough
    def test_no_output_at_all(self, fsm):
        script = "import sys; sys.stdout = None; from mercator_design.cli import main; main()"
        command = [sys.executable, "-c", script, "fsm", "explain", fsm]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")


def run_with_stdout(stdout, verb, folder):
    """A command in a process of its own that keeps its output until it is full, as usual."""
    (folder / "large.txt").write_text(LARGE)
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"}
    command = [sys.executable, "-c", "from mercator_design.cli import main; main()", *verb.split()]
    return subprocess.run(
        command, cwd=folder, stdout=stdout, stderr=subprocess.PIPE, text=True, env=environment, check=False
    )
