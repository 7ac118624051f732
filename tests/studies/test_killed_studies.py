"""Studies in processes that are killed, and on other executors: the tables do not depend on it.

A process sends the signal to itself at a moment of its work, so nothing depends on how fast it is.
"""

import logging
import os
import signal
import sys

import pytest

from mercator_design.race.session.events import SessionStarted
from mercator_design.race.session.journal import read
from mercator_design.studies.reading import read_status, study_table
from tests.processes import LIMIT, started

pytestmark = [pytest.mark.thorough, pytest.mark.together]

PLAN = """
budgets: [60]
repetitions: 2
methods: {halving: {}, random: {method: random}}
missions: [{mission: aggregation, set: [duration=2, robots=3]}]
assess: {runs: 20, realities: [{sample: 3, width: 0.5}]}
"""
TOTAL = 4 * (60 + 2 * 20)

AT_MOMENT = """
import os, sys
from pathlib import Path

from mercator_design.cli import main
from mercator_design.cli.study.texts import StudyDisplay

number, what, count = int(sys.argv[1]), sys.argv[2], int(sys.argv[3])
sys.argv[1:4] = []
show, renamed = StudyDisplay.note, []


def note(display, progress):
    show(display, progress)
    if what == "experiment" and progress.done - progress.known == count and progress.is_new:
        os.kill(os.getpid(), number)


def before(event, arguments):
    if event == "os.rename" and Path(os.fsdecode(arguments[1])).name == what:
        renamed.append(arguments)
        if len(renamed) == count:
            os.kill(os.getpid(), number)


StudyDisplay.note = note
sys.addaudithook(before)
main()
"""
"""mdesign in a process that gets a signal when `count` experiments have run in it, or when it is about to put the
`count`-th file of a name in its place, next to which its draft lies."""


def signalled(number, what, count):
    return [sys.executable, "-c", AT_MOMENT, int(number), what, count]


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    file = tmp_path_factory.mktemp("plan") / "killed.yaml"
    file.write_text(PLAN)
    return file


@pytest.fixture(scope="module")
def whole(plan, mdesign_once):
    mdesign_once("study", plan, "-o", plan.parent / "whole", "-q")
    return study_table(plan.parent / "whole")


def test_the_tables_of_a_study_that_was_killed(plan, whole, tmp_path, mdesign_once):
    """In a race, before its winner is written, and before an assessment is written; the last process ends the study."""
    folder, done = tmp_path / "killed", 0
    for what, count in (("experiment", 37), ("fsm.txt", 1), ("assessment.json", 2)):
        command = ("study", plan, "-o", folder, "-q", "-j", 2)
        with started(*signalled(signal.SIGKILL, what, count), *command) as process:
            assert process.wait(LIMIT) == -signal.SIGKILL, what
        assert done <= (done := read_status(folder).done) < TOTAL
    mdesign_once("study", plan, "-o", folder, "-q")
    assert study_table(folder).runs.equals(whole.runs)
    assert study_table(folder).designs.equals(whole.designs)
    assert not [*folder.rglob(".*-????????")], "drafts that nothing removes"


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, os.EX_TEMPFAIL)])
def test_signals_end_a_study_with_the_command_that_resumes_it(number, code, plan, tmp_path):
    folder = tmp_path / "stopped"
    with started(
        *signalled(number, "experiment", 20), "study", plan, "-o", folder, "-j", 2, "--part", "1/2", stderr=-1
    ) as process:
        _, err = process.communicate(timeout=LIMIT)
    assert process.returncode == code, err
    assert f"to resume: mdesign study {plan} -o {folder} -j 2 --part 1/2" in err
    assert "Traceback" not in err
    assert 20 <= read_status(folder).done < TOTAL / 2


@pytest.fixture
def dask():
    """The address of a local cluster of two worker processes."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=logging.CRITICAL
    ) as cluster:
        yield cluster.scheduler_address


@pytest.fixture(params=["processes", "concurrent.futures:ProcessPoolExecutor", "dask"])
def executor(request):
    """The options of an executor."""
    if request.param == "dask":
        return "--executor", "dask", "--scheduler", request.getfixturevalue("dask")
    return "--executor", request.param, "-j", 2


def test_other_executors_give_the_same_files(executor, plan, whole, tmp_path):
    folder = tmp_path / "study"
    command = (sys.executable, "-m", "mercator_design", "study", plan, "-o", folder, "-q", *executor)
    with started(*command) as process:
        assert process.wait(LIMIT) == 0
    assert study_table(folder).runs.equals(whole.runs)
    for pattern in ("fsm.txt", "assessment.json", "results.csv"):
        files = [*(plan.parent / "whole").rglob(pattern)]
        assert files
        for file in files:
            assert (folder / file.relative_to(plan.parent / "whole")).read_bytes() == file.read_bytes(), file
    sessions = [one for journal in folder.rglob("journal.jsonl") for one in read(journal).record.sessions]
    assert {one.executor for one in sessions if isinstance(one, SessionStarted)} == {executor[1]}
