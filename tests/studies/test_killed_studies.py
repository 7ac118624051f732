"""Studies in processes that are killed, and on other executors: the tables do not depend on it."""

import os
import random
import signal
import sys

import pytest

from mercator_design.studies.reading import read_status, study_table
from tests.processes import LIMIT, started, wait_until

pytestmark = [pytest.mark.thorough, pytest.mark.together]

MDESIGN = (sys.executable, "-c", "from mercator_design.cli import main; main()")
PLAN = """
budgets: [100]
repetitions: 2
methods: {halving: {}, random: {method: random}}
missions: [{mission: aggregation, set: [duration=10, robots=5]}]
assess: {runs: 20, realities: [{sample: 3, width: 0.5}]}
"""


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    file = tmp_path_factory.mktemp("plan") / "killed.yaml"
    file.write_text(PLAN)
    return file


@pytest.fixture(scope="module")
def whole(plan, mdesign_once):
    mdesign_once("study", plan, "-o", plan.parent / "whole", "-q")
    return study_table(plan.parent / "whole")


def done(folder):
    return read_status(folder).done if (folder / "study.json").exists() else 0


def test_the_tables_of_a_study_that_was_killed(plan, whole, tmp_path):
    """At moments that lie between what has run and its end, wherever a process then is."""
    draws, folder, total = random.Random(1), tmp_path / "killed", 4 * (100 + 2 * 20)
    command = [*MDESIGN, "study", plan, "-o", folder, "-q", "-j", 2]
    for _ in range(4):
        before = done(folder)
        target = before + draws.randrange((total - before) // 2)
        with started(*command) as process:
            wait_until(lambda target=target, process=process: process.poll() is not None or done(folder) > target)
            process.kill()
            assert process.wait(LIMIT) in {0, -signal.SIGKILL}
    with started(*command) as process:
        assert process.wait(LIMIT) == 0
    assert study_table(folder).runs.equals(whole.runs)
    assert study_table(folder).designs.equals(whole.designs)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, os.EX_TEMPFAIL)])
def test_signals_end_a_study_with_the_command_that_resumes_it(number, code, plan, tmp_path):
    folder = tmp_path / "stopped"
    with started(*MDESIGN, "study", plan, "-o", folder, "-j", 2, stderr=-1) as process:
        wait_until(lambda: process.poll() is not None or done(folder) > 20)
        process.send_signal(number)
        _, err = process.communicate(timeout=LIMIT)
    assert process.returncode == code, err
    assert f"to resume: mdesign study {plan} -o {folder}" in err
    assert "Traceback" not in err
    assert 20 < done(folder) < 560


def test_worker_processes_give_the_same_tables(plan, whole, tmp_path):
    with started(*MDESIGN, "study", plan, "-o", tmp_path / "p", "-q", "--executor", "processes", "-j", 2) as process:
        assert process.wait(LIMIT) == 0
    assert study_table(tmp_path / "p").runs.equals(whole.runs)
