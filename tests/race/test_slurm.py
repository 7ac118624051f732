"""Races and studies on a real SLURM, where Debian's packages are installed."""

import importlib.util
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from mercator_design.errors import RaceError
from mercator_design.race.session.journal import read
from tests import slurm
from tests.processes import LIMIT, started, wait_until

pytestmark = [
    pytest.mark.timing,
    pytest.mark.skipif(bool(slurm.missing()), reason=slurm.missing() or "SLURM is there"),
]
ROOT = Path(__file__).parents[2]
STUDY = """
schema: 1
name: small
budgets: [800]
repetitions: 2
methods: {random: {method: random}}
missions: [{mission: aggregation, set: [robots=2, duration=3], name: short}]
assess: {runs: 3}
"""
RACE = ["race", "aggregation", "--budget", "800", "--set", "robots=2", "--set", "duration=3", "--no-report"]


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    folder = tmp_path_factory.mktemp("slurm")
    with slurm.cluster(folder) as environment:
        programs = folder / "programs"
        programs.mkdir()
        main = "from mercator_design.cli import main; main()"
        (programs / "mdesign").write_text(f"#!/bin/sh\nexec {sys.executable} -c '{main}' \"$@\"\n")
        (programs / "mdesign").chmod(0o755)
        yield {**environment, "PATH": f"{programs}{os.pathsep}{environment['PATH']}"}


def call(environment, folder, *command):
    done = subprocess.run(
        [*map(str, command)], env=environment, cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, (command, done.stdout, done.stderr)
    return done.stdout


def records(folder):
    found = {}
    for journal in sorted(folder.rglob("journal.jsonl")):
        try:
            found[str(journal.relative_to(folder))] = read(journal).record
        except RaceError:
            continue  # it is being written
    return found


def n_experiments(folder):
    return sum(len(record.experiments) for record in records(folder).values())


def digests(folder):
    return {name: record.digest() for name, record in records(folder).items()}


def test_an_array_of_a_study_that_is_cancelled_and_queued_again(environment, tmp_path):
    """As at its walltime a task gets SIGTERM; the tables are those of a study that nothing interrupts."""
    (tmp_path / "small.yaml").write_text(STUDY)
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    recipe = ROOT / "docs" / "examples" / "study.sbatch"
    submit = ["sbatch", "--parsable", "--array=1-2", "--cpus-per-task=1", "--time=30", recipe, "small.yaml", parts]
    array = call(environment, tmp_path, *submit).strip()
    wait_until(lambda: n_experiments(parts) > 10)
    call(environment, tmp_path, "scancel", array)
    wait_until(lambda: not call(environment, tmp_path, "squeue", "--noheader", f"--jobs={array}"))
    cancelled = n_experiments(parts)
    assert cancelled < 1600
    array = call(environment, tmp_path, *submit).strip()
    wait_until(lambda: n_experiments(parts) > cancelled + 10)
    call(environment, tmp_path, "scancel", "--batch", "--signal=TERM", array)

    def is_complete():
        found = records(parts)
        return len(found) == 2 and all(one.is_complete for one in found.values())

    wait_until(is_complete)
    wait_until(lambda: not call(environment, tmp_path, "squeue", "--noheader", f"--jobs={array}"))
    call(environment, tmp_path, "mdesign", "study", "run", "small.yaml", "-o", whole, "--no-report", "-j", 2)
    assert digests(parts) == digests(whole)
    sessions = [len(record.sessions) for record in records(parts).values()]
    assert max(sessions) >= 3


@pytest.mark.skipif(
    importlib.util.find_spec("dask_jobqueue") is None,  # importing it here would take SIGINT from pytest
    reason="dask_jobqueue is not installed",
)
def test_a_race_whose_jobs_are_cancelled(environment, tmp_path):
    """It goes on with new ones, to the same end."""
    command = [sys.executable, ROOT / "docs" / "slurm.py", "--jobs", 1, "--cores", 1, "--memory", "1GB", "--check", 1]
    dask = ["--executor", "dask", "--scheduler", "scheduler.json", "-o", "dask"]
    options = {"env": environment, "cwd": tmp_path, "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    with (
        started("mdesign", *RACE, *dask, **options) as race,
        started(*command, **{**options, "stdout": subprocess.PIPE}) as jobs,
    ):
        wait_until(lambda: n_experiments(tmp_path) > 20)
        call(environment, tmp_path, "scancel", "--user=root")
        assert "asked for" in jobs.stdout.readline()
        assert "jobs that have ended are replaced" in jobs.stdout.readline()
        _, told = race.communicate(timeout=LIMIT)
        assert race.returncode == 0, told
        jobs.send_signal(signal.SIGTERM)
        jobs.communicate(timeout=LIMIT)
    assert not (tmp_path / "scheduler.json").exists()
    call(environment, tmp_path, "mdesign", *RACE, "-o", "here")
    found = digests(tmp_path)
    assert found["dask/journal.jsonl"] == found["here/journal.jsonl"]
