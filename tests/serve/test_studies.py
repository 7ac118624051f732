"""Studies as jobs: what is refused, their lives, their pages, and one from its submission to its files."""

import fcntl
import json
import os
import shutil
from contextlib import contextmanager

import pytest

from mercator_design.config import shipped
from mercator_design.serve.app import guarded
from mercator_design.serve.jobs.job import StudyRequest
from mercator_design.serve.jobs.operations import LimitReached, NotPossible
from mercator_design.serve.jobs.processes import Launcher
from mercator_design.serve.service import Service
from mercator_design.serve.settings import UserLimits
from mercator_design.studies.folder import lock_file
from tests.serve.serving import serving

pytestmark = pytest.mark.together

STUDIES, JOBS = "/api/v1/studies", "/api/v1/jobs"
TEXT = """
schema: 1
name: small
budgets: [20]
repetitions: 2
methods: {random: {method: random}, few: {method: random, options: {instances: 5}}}
missions: [{mission: aggregation, set: [duration=1, robots=2]}]
assess: {runs: 3}
"""
TOTAL = 4 * (20 + 3)
REQUEST = StudyRequest(study="", study_text=TEXT, budget=TOTAL)


@pytest.fixture(scope="session")
def studied(mdesign_once, tmp_path_factory):
    """The folder of a study that has ended."""
    folder = tmp_path_factory.mktemp("studied")
    (folder / "small.yaml").write_text(TEXT)
    mdesign_once("study", folder / "small.yaml", "--jobs", "1", "-o", folder / "done", "--quiet")
    mdesign_once("study", "report", folder / "done")  # in tests, no report is written unless it is asked for
    return folder / "done"


def place(studied, folder, *, cells=4):
    """Put a study at the place of a job's: that has ended, or of which only some designs have run."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(studied, folder)
    if cells < 4:
        (folder / "report.html").unlink()
        for cell in sorted((folder / "cells").glob("*/*/*/*"), key=lambda path: path.name)[cells:]:
            shutil.rmtree(cell)


@contextmanager
def locked(folder):
    """The lock of a study, held as by a process that runs it."""
    file = os.open(lock_file(folder), os.O_RDWR | os.O_CREAT)
    try:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
    finally:
        os.close(file)


def submitted(house, owner="ann", **changes):
    return house.jobs.submit(owner, "small", "", StudyRequest(study="", study_text=TEXT, budget=TOTAL, **changes)).id


class TestItsLife:
    def test_it_runs_to_its_end(self, house, studied):
        job = submitted(house)
        assert house.state(job) == "queued"
        house.tick()
        place(studied, house.store.run_folder(job), cells=2)
        house.tick(5)
        row = house.row(job)
        assert (row.state, row.experiments, row.best, row.job.seconds) == ("running", 2 * (20 + 3), None, 5.0)
        house.tick()
        place(studied, house.store.run_folder(job))
        house.end(job)
        row = house.row(job)
        assert (row.state, row.message, row.experiments, row.is_study) == ("finished", "", TOTAL, True)
        assert row.job.ended

    def test_the_time_left_is_that_of_the_whole(self, house, studied):
        job = submitted(house)
        house.tick()
        for cells in (1, 2):
            place(studied, house.store.run_folder(job), cells=cells)
            house.tick(10)
        assert house.row(job).left == pytest.approx(2 * 23 * 10 / 23)

    def test_without_its_page_it_is_not_finished(self, house, studied):
        job = submitted(house)
        house.tick()
        place(studied, house.store.run_folder(job))
        (house.store.run_folder(job) / "report.html").unlink()
        house.end(job, -9)
        house.tick()
        assert house.started == [job, job]

    def test_after_a_crash_it_waits_for_the_process_that_is_left_and_goes_on(self, house, studied):
        job = submitted(house)
        house.tick()
        folder = house.store.run_folder(job)
        place(studied, folder, cells=3)
        with locked(folder):
            house.crash()
            house.tick(5)
            assert (house.state(job), house.started) == ("running", [job])
            house.jobs.pause(job)
            with pytest.raises(NotPossible, match="cannot delete a job that is running"):
                house.jobs.delete(job)
        house.tick(5)
        assert house.state(job) == "paused"
        house.jobs.resume(job)
        house.tick(5)
        assert house.started == [job, job]
        assert house.store.request(job) == REQUEST

    def test_studies_and_races_take_turns_and_have_priorities(self, furnished):
        house = furnished(races=1)
        race, low, high, other = house.submit(), submitted(house), submitted(house, priority=3), house.submit("bob")
        for _ in range(4):
            house.tick()
            house.end(house.started[-1], 1)
        assert house.started == [high, other, race, low]

    def test_a_damaged_cell_is_told(self, house, studied):
        job = submitted(house)
        folder = house.store.run_folder(job)
        place(studied, folder, cells=2)
        next(folder.glob("cells/**/assessment.json")).write_text("{")
        row = house.supervisor.refresh(job)
        assert (row.state, "assessment.json" in row.message, str(house.data) in row.message) == ("failed", True, False)

    def test_limits(self, furnished):
        house = furnished(limits=UserLimits(budget=TOTAL - 1))
        with pytest.raises(LimitReached, match=f"experiments: expected at most {TOTAL - 1}, found {TOTAL}"):
            submitted(house)

    def test_its_budget_is_in_its_file(self, house):
        job = submitted(house)
        with pytest.raises(NotPossible, match="the budgets of a study are in its file"):
            house.jobs.change(job, budget=10**4)
        assert house.jobs.change(job, priority=7).job.request.priority == 7


def test_its_command(house):
    launch = Launcher(house.store, house.settings, 2)
    command = launch.command(house.store.read(job := submitted(house)))
    text = f".service/jobs/{job}/study.yaml"
    assert command == ["study", "run", text, "-o", job, "--report", "--jobs", "2", "--quiet"]
    assert (house.data / text).read_text() == TEXT
    named = house.jobs.submit("ann", "maple", "", StudyRequest(study="maple", budget=100)).id
    assert launch.command(house.store.read(named))[:5] == ["study", "run", "maple", "-o", named]


class TestSubmitting:
    def test_a_text(self, ann, bob, quiet):
        answer = ann.post(STUDIES, json={"study_text": TEXT, "priority": 2})
        assert answer.status_code == 201, answer.text
        job = answer.json()["job"]
        assert (job["kind"], job["name"], job["budget"], job["priority"]) == ("study", "small", TOTAL, 2)
        assert (job["method"], job["flavour"], job["best"]) == ("", "", None)
        assert answer.headers["location"] == f"{JOBS}/{job['id']}"
        assert ann.get(f"{JOBS}/{job['id']}").json() == job
        assert bob.get(f"{JOBS}/{job['id']}").status_code == 404
        assert quiet.service.store.request(job["id"]).study_text == TEXT

    def test_a_shipped_one_is_beyond_the_usual_limit(self, ann):
        answer = ann.post(STUDIES, json={"study": "maple"})
        assert answer.status_code == 429
        assert "experiments: expected at most 100000, found " in answer.text

    def test_the_same_key_is_the_same_job(self, ann):
        key = {"Idempotency-Key": "a-study"}
        first, second = (ann.post(STUDIES, json={"study_text": TEXT}, headers=key) for _ in range(2))
        assert (first.status_code, second.status_code) == (201, 200)
        assert first.json()["job"]["id"] == second.json()["job"]["id"]
        assert ann.post(STUDIES, json={"study_text": TEXT + "# \n"}, headers=key).status_code == 409
        assert ann.post(JOBS, json={"mission": "aggregation", "budget": 60}, headers=key).status_code == 409

    @pytest.mark.parametrize(
        ("body", "words"),
        [
            ({}, "expected one of study and study_text"),
            ({"study": "maple", "study_text": TEXT}, "expected one of study and study_text"),
            ({"study": "nowhere"}, "nowhere: no such study; shipped are: "),
            ({"study": "/etc/passwd"}, "/etc/passwd: no such study"),
            ({"study_text": "name: ["}, "study.yaml"),
            ({"study_text": TEXT, "budget": 3}, "Extra inputs are not permitted"),
        ],
    )
    def test_what_is_not_valid(self, ann, body, words):
        answer = ann.post(STUDIES, json=body)
        assert answer.status_code == 422
        assert words in " ".join(answer.json()["errors"])

    @pytest.mark.parametrize(
        ("before", "after", "words"),
        [
            ("{method: random}", "{files: [fsm.txt]}", "files[0]: expected no file"),
            ("{method: random}", "{method: random, flavour: /x.yaml}", "methods.random.flavour: expected "),
            ("{method: random}", "{method: random, flavour: mine}", "flavour: expected the name of a shipped one"),
            ("mission: aggregation", "mission: ./own.yaml", "missions[0].mission: expected "),
            ("mission: aggregation", "mission: nowhere", "missions[0]: nowhere: no such mission"),
            ("robots=2]", "robots=101]", "robots: expected at most 100, the limit here"),
            ("robots=2]", "robot_model=/etc/passwd]", "robot_model"),
            ("robots=2]", "'floor.image={path: /etc/passwd, size: [1, 1]}']", "image"),
            ("runs: 3", "runs: 3, realities: [nowhere]", "realities[0]: expected the name of a shipped one"),
            ("runs: 3", "runs: 3, realities: [/x.yaml]", "realities[0]: expected no file"),
            ("schema: 1", "schema: 1\nrobot_models: [nowhere]", "robot_models[0]: expected the name of a shipped one"),
            ("repetitions: 2", "repetitions: 251", "expected at most 500 designs, the limit here, found 502"),
        ],
    )
    def test_files_and_what_is_beyond_a_limit(self, ann, before, after, words):
        assert before in TEXT
        answer = ann.post(STUDIES, json={"study_text": TEXT.replace(before, after, 1)})
        assert answer.status_code == 422, answer.text
        assert words in " ".join(answer.json()["errors"])


class TestItsPage:
    @pytest.fixture
    def job(self, quiet):
        return quiet.service.jobs.submit("ann", "small", "", REQUEST).id

    def placed(self, quiet, studied, job, **how):
        place(studied, quiet.folder(job), **how)
        if not how:
            quiet.service.store.update(job, ended="2030-01-01T00:00:00+00:00")
        quiet.service.supervisor.refresh(job)

    def test_progress_and_then_the_report(self, quiet, ann, studied, job):
        assert "The study has not begun yet" in ann.get(f"/jobs/{job}/race").text
        self.placed(quiet, studied, job, cells=2)
        part = ann.get(f"/jobs/{job}/race")
        assert "2 of 4 designs are assessed." in part.text
        assert "iframe" not in part.text
        assert "New budget" not in ann.get(f"/jobs/{job}").text
        self.placed(quiet, studied, job)
        part = ann.get(f"/jobs/{job}/race")
        assert f'<iframe class="report" src="{JOBS}/{job}/files/report.html"' in part.text
        version = part.text.split('data-have="')[1].split('"')[0]
        assert ann.get(f"/jobs/{job}/race?have={version}").status_code == 204
        assert ann.get(f"/jobs/{job}/about").status_code == 200
        files = ann.get(f"/jobs/{job}/files").text
        assert "tables/designs.csv" in files
        assert "cells/" not in files
        names = {one["name"] for one in ann.get(f"{JOBS}/{job}/files").json()}
        assert {"cells/aggregation/few/20/1/fsm.txt", "tables/designs.csv", "figures/scores.pdf"} <= names
        figure = ann.get(f"{JOBS}/{job}/files/figures/scores.pdf")
        assert figure.headers["content-type"] == "application/pdf"
        assert figure.headers["content-disposition"] == "attachment"

    def test_its_events_are_states(self, quiet, ann, studied, job):
        self.placed(quiet, studied, job)
        lines = ann.get(f"{JOBS}/{job}/events").text.splitlines()
        assert [line for line in lines if line.startswith("event")] == ["event: state"]
        state = next(json.loads(line[6:]) for line in lines if line.startswith("data: "))
        assert (state["kind"], state["state"], state["experiments"]) == ("study", "finished", TOTAL)

    def test_what_is_of_races_says_so(self, quiet, ann, studied, job):
        self.placed(quiet, studied, job)
        answer = ann.get(f"{JOBS}/{job}/mission")
        assert answer.status_code == 409
        assert f"{job}: expected a race, found a study" in answer.text
        assert "found a study" in ann.get(f"/new?from={job}").text
        assert job not in ann.get("/gallery").text
        assert "Run again" not in ann.get(f"/jobs/{job}").text


@pytest.fixture(scope="module")
def server(tmp_path_factory, plain_races):
    """A service that runs studies."""
    with Service(tmp_path_factory.mktemp("live") / "runs") as service, serving(guarded(service)) as address:
        yield address


class TestTheClient:
    @pytest.fixture
    def client(self, mdesign, server, monkeypatch, tmp_path):
        monkeypatch.setenv("MERCATOR_DESIGN_SERVER", server)
        monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
        monkeypatch.delenv("MERCATOR_DESIGN_TOKEN", raising=False)
        monkeypatch.chdir(tmp_path)
        return mdesign

    def test_options_of_races(self, client, tmp_path):
        (tmp_path / "own.yaml").write_text(TEXT)
        code, _, err = client("submit", "own.yaml", "--budget", "50")
        assert code == 2
        assert "--budget is of a race: own.yaml is a study, which has it in its file" in err
        assert client("submit", "maple", "--set", "budgets=[20]")[0] == 2
        code, _, err = client("submit", "aggregation")
        assert code == 2
        assert "Missing option '--budget'" in err

    def test_a_study_that_is_refused(self, client, tmp_path):
        (tmp_path / "own.yaml").write_text(TEXT.replace("{method: random}", "{files: [fsm.txt]}"))
        code, out, err = client("submit", "own.yaml")
        assert (code, out) == (3, "")
        assert "expected no file" in err


def test_no_shipped_study_has_the_name_of_a_mission():
    """By its name alone, one or the other is submitted."""
    assert not shipped.studies().keys() & shipped.missions().keys()
