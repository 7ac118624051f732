"""Run folders that were damaged or written by strangers: clear errors, no traceback, and nothing different after resume."""

import json
import os
import random
import shutil
import subprocess
import sys

import pytest

from mercator_design import analysis
from mercator_design.errors import MercatorError
from mercator_design.missions.mission import load_mission
from mercator_design.race.executors import ThreadExecutor
from mercator_design.report.runs import run_summary, runs_json, runs_table
from mercator_design.run_files import JOURNAL, read_journal, restored
from mercator_design.run_folder import RunFolder
from mercator_design.run_tables import configurations_table, experiments_table, tests_table
from mercator_design.run_verification import verify
from mercator_design.sim.simulate import Simulator
from tests.race.damage import WRONG, damaged

MDESIGN = [sys.executable, "-c", "from mercator_design.cli import main; main()"]
RACE = ["race", "aggregation", "--budget", "60", "--method", "irace", "--set", "robots=2", "--set", "duration=3"]
RESULTS = ("fsm.txt", "results.csv", "mission.yaml", "robot_model.yaml")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder of a race that nothing stopped."""
    Simulator(load_mission("aggregation")).rehearse(lambda _: None)
    folder = tmp_path_factory.mktemp("runs") / "whole"
    subprocess.run([*MDESIGN, *RACE, "-o", str(folder), "--test-runs", "2"], check=True, capture_output=True)
    return folder


def resumed(path):
    """Run the race of a folder to its end; gives its digest and its tests."""
    with RunFolder.reopen(path) as folder, ThreadExecutor(1) as executor:
        result = folder.task.run(executor, folder.journal, testing=folder.testing)
        folder.finish(result, seconds=1.0)
        return folder.journal.digest(), folder.journal.tests


def looks_at(path):
    """Whatever reads a run folder; each either does or raises a MercatorError. Gives what these say."""
    said = []

    def verified():
        verify(path, restored(path), 2, ThreadExecutor(1))

    for look in (
        lambda: runs_table(path.parent),
        lambda: json.loads(runs_json(path.parent)),
        lambda: run_summary(path),
        lambda: experiments_table(path).to_csv(),
        lambda: configurations_table(path).to_csv(),
        lambda: tests_table(path).to_csv(),
        lambda: analysis.importance(path),
        verified,
    ):
        try:
            look()
        except MercatorError as error:
            said.append(str(error))
    return said


def damaged_provenance(text, draws):
    """JSON in which something is wrong, or bytes that are no JSON."""
    if draws.random() < 0.2:
        place = draws.randrange(len(text))
        return text[:place] + draws.choice(("", "\0", '"', "[" * 5000, "\ud800".encode("utf-8", "surrogatepass").decode("latin1"))) + text[place + 1 :]
    data = json.loads(text)
    here = data
    while True:
        key = draws.choice([*here])
        if not isinstance(here[key], dict) or not here[key] or draws.random() < 0.4:
            break
        here = here[key]
    what = draws.choice(("wrong", "wrong", "wrong", "remove", "add"))
    if what == "remove":
        del here[key]
    elif what == "add":
        here["more"] = draws.choice(WRONG)
    else:
        here[key] = draws.choice(WRONG)
    return json.dumps(data)


def check(seeds, whole, tmp_path):
    expected = read_journal(whole).record
    journal, provenance = (whole / JOURNAL).read_bytes(), (whole / "provenance.json").read_text()
    lines = journal.splitlines(keepends=True)
    for seed in seeds:
        draws = random.Random(seed)
        folder = tmp_path / f"{seed}" / "r"
        shutil.copytree(whole, folder)
        part = journal if draws.random() < 0.5 else b"".join(lines[: draws.randrange(2, len(lines))])
        done = "provenance"
        if draws.random() < 0.2:
            (folder / "provenance.json").write_text(damaged_provenance(provenance, draws))
        else:
            part, done = damaged(part, draws)
        (folder / JOURNAL).write_bytes(part)
        for name in ("fsm.txt", "results.csv"):
            (folder / name).unlink()
        looks_at(folder)
        try:
            digest, tests = resumed(folder)
        except MercatorError:
            pass
        else:
            assert (digest, tests) == (expected.digest(), expected.tests), (seed, done)
            for name in RESULTS:
                assert (folder / name).read_bytes() == (whole / name).read_bytes() or done == "provenance", (seed, done)
        shutil.rmtree(folder.parent)


@pytest.mark.parametrize("seeds", [range(20), pytest.param(range(20, 2000), marks=pytest.mark.slow)])
def test_damaged_journals(whole, tmp_path, seeds, monkeypatch):
    monkeypatch.setattr(os, "fsync", lambda file: None)  # which takes most of the time
    check(seeds, whole, tmp_path)
