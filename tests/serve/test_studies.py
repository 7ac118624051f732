"""Studies as jobs: what is refused, their lives, their pages. test_client.py has one from submission to tables."""

import fcntl
import json
import os
import shutil
import tempfile
from contextlib import contextmanager

import pytest

from mercator_design.config import shipped
from mercator_design.serve.app import guarded
from mercator_design.serve.jobs.job import StudyRequest
from mercator_design.serve.jobs.operations import LimitReached, NotPossible
from mercator_design.serve.jobs.processes import Launcher
from mercator_design.serve.settings import UserLimits
from mercator_design.studies.folder import lock_file
from mercator_design.studies.plan import load_plan
from tests.serve.own_study import FILES, OWN, OWN_TOTAL
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
UNNAMED = TEXT.replace("name: small\n", "")
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
    text = f".service/jobs/{job}/study/study.yaml"
    assert command == ["study", "run", text, "-o", job, "--report", "--jobs", "2", "--quiet"]
    assert (house.data / text).read_text() == TEXT
    unnamed = StudyRequest(study="", study_text=TEXT, study_name="my study", budget=100)
    assert '--set=name="my study"' in launch.command(house.jobs.submit("ann", "my study", "", unnamed).job)
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

    @pytest.mark.parametrize(
        ("text", "given", "name"),
        [
            (TEXT, "mine", "small"),
            (UNNAMED, "1", "1"),
            (UNNAMED, "", "study"),
            (f"name: mine\n{UNNAMED}", "mine", "mine"),
        ],
    )
    def test_its_name_is_that_of_its_text_or_one_that_is_given(self, ann, quiet, text, given, name):
        answer = ann.post(STUDIES, json={"study_text": text, "study_name": given})
        assert answer.status_code == 201, answer.text
        job = answer.json()["job"]
        assert job["name"] == name
        command = Launcher(quiet.service.store, quiet.service.settings, 1).command(quiet.service.store.read(job["id"]))
        overrides = [one.removeprefix("--set=") for one in command if one.startswith("--set=")]
        assert load_plan(quiet.service.store.data / command[2], overrides).name == name

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
            (
                "{method: random}",
                "{files: [fsm.txt]}",
                "files[0]: expected a file that is sent with the study, found fsm",
            ),
            (
                "{method: random}",
                "{files: [/etc/passwd]}",
                "expected a file that is sent with the study, found /etc/pass",
            ),
            (
                "{method: random}",
                "{files: [../job.json]}",
                "expected a file that is sent with the study, found ../job.j",
            ),
            ("{method: random}", "{method: random, flavour: /x.yaml}", "methods.random.flavour: expected "),
            ("schema: 1", "schema: 1\nplugins: [random_walks]", "plugins[0]: expected no plugin, as only the administ"),
            ("schema: 1", "schema: 1\nplugins: [/x/y.py]", "plugins[0]: expected no plugin, as only the administra"),
            ("{method: random}", "{method: random, flavour: mine}", "flavour: expected the name of a shipped one"),
            ("mission: aggregation", "mission: ./own.yaml", "missions[0]: expected a file that is sent with the study"),
            ("mission: aggregation", "mission: nowhere", "missions[0]: nowhere: no such mission"),
            ("robots=2]", "robots=101]", "robots: expected at most 100, the limit here"),
            ("robots=2]", "robot_model=/etc/passwd]", "robot_model"),
            ("robots=2]", "'floor.image={path: /etc/passwd, size: [1, 1]}']", "image"),
            ("runs: 3", "runs: 3, realities: [nowhere]", "realities[0]: expected the name of a shipped one"),
            ("runs: 3", "runs: 3, realities: [./x.yaml]", "realities[0]: expected the name of a shipped one, found x."),
            ("schema: 1", "schema: 1\nrobot_models: [nowhere]", "robot_models[0]: expected the name of a shipped one"),
            ("repetitions: 2", "repetitions: 251", "expected at most 500 designs, the limit here, found 502"),
            ("random: {method: random}", "random/../x: {method: random}", "study.yaml"),
            ("name: small", "name: a/b", "name: expected text: letters, digits"),
            ("{method: random}", "&a {options: {instances: 5}}", "anchors and aliases (&, *) are not understood"),
        ],
    )
    def test_files_and_what_is_beyond_a_limit(self, ann, before, after, words):
        assert before in TEXT
        answer = ann.post(STUDIES, json={"study_text": TEXT.replace(before, after, 1)})
        assert answer.status_code == 422, answer.text
        assert words in " ".join(answer.json()["errors"])

    def test_numbers_of_designs_that_nobody_counts_one_by_one(self, ann):
        many = TEXT.replace("[20]", f"{[*range(20, 25_020)]}").replace("repetitions: 2", "repetitions: 10000")
        answer = ann.post(STUDIES, json={"study_text": many.replace("missions: [", "missions: [foraging, ")})
        assert answer.status_code == 422
        assert answer.json()["errors"] == ["small: expected at most 500 designs, the limit here, found 1000000000"]


class TestItsFiles:
    """What the text names comes with it, and nothing else is read."""

    def test_they_are_kept_beside_it(self, ann, quiet):
        key = {"Idempotency-Key": "with-files"}
        body = {"study_text": OWN, "files": FILES}
        answer = ann.post(STUDIES, json=body, headers=key)
        assert answer.status_code == 201, answer.text
        job = answer.json()["job"]
        assert (job["name"], job["budget"]) == ("own files", OWN_TOTAL)
        assert quiet.service.store.request(job["id"]).files == FILES
        folder = quiet.service.store.folder(job["id"])
        assert (folder / "study/made/by-hand.txt").read_text() == FILES["made/by-hand.txt"]
        assert "nstates" not in (folder / "job.json").read_text()
        assert ann.post(STUDIES, json=body, headers=key).json()["job"]["id"] == job["id"]
        other = {**FILES, "made/by-hand.txt": "--nstates 1 --s0 0 --rwm0 30\n"}
        assert ann.post(STUDIES, json={"study_text": OWN, "files": other}, headers=key).status_code == 409

    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            (
                {"short.yaml": None},
                "study.yaml:7: missions[0]: expected a file that is sent with the study, found short",
            ),
            ({"more.yaml": ""}, "more.yaml: expected only files that the missions and methods of the study name"),
            ({"short.yaml": "x" * 262_145}, "body.files.short.yaml: String should have at most 262144 characters"),
            ({f"{k}.txt": "" for k in range(200)}, "body.files: Dictionary should have at most 200 items"),
            (
                {"../job.json": "{}"},
                "body.files: expected a path as missions/own.yaml, of at most 200 bytes, without '..'",
            ),
            ({"/etc/cron.d/x": ""}, "without '..' and hidden files, found /etc/cron.d/x"),
            ({"a//b": ""}, "without '..' and hidden files, found a//b"),
            ({".hidden": ""}, "without '..' and hidden files, found .hidden"),
            ({"": ""}, "without '..' and hidden files, found "),
            ({"é" * 101: ""}, "of at most 200 bytes"),
            ({"a\0b": ""}, "without '..' and hidden files"),
            ({"made": ""}, "expected each file with a name of its own, found made twice, or as a folder"),
            ({"study.yaml": ""}, "expected each file with a name of its own, found study.yaml twice, or as a folder"),
            ({"\ud800": ""}, "body.files"),
            ({"short.yaml": "\ud800"}, "body.files.short.yaml"),
            ({"short.yaml": "robots: 3\n"}, "study.yaml:7: missions[0]: short.yaml:1: schema: missing key"),
            ({"short.yaml": FILES["short.yaml"].replace(": mercator", ": ./m.yaml")}, "robot_model: expected no file"),
            ({"short.yaml": FILES["short.yaml"].replace("robots: 2", "robots: 101")}, "robots: expected at most 100"),
            ({"made/by-hand.txt": "import os\n"}, "study.yaml:6: methods.hand: made/by-hand.txt:1: "),
            (
                {"made/by-hand.txt": "# module plugins: x.py 0123\n--nstates 1 --s0 0 --rwm0 20\n"},
                "made/by-hand.txt: has modules of the plugin x.py; give --plugin with that plugin",
            ),
        ],
    )
    def test_what_is_refused(self, ann, changes, words):
        files = {name: text for name, text in (FILES | changes).items() if text is not None}
        body = json.dumps({"study_text": OWN, "files": files})
        answer = ann.post(STUDIES, content=body, headers={"content-type": "application/json"})
        assert answer.status_code in (413, 422), answer.text
        assert words in " ".join(answer.json()["errors"])
        assert tempfile.gettempdir() not in answer.text

    def test_a_shipped_study_has_none(self, ann):
        answer = ann.post(STUDIES, json={"study": "maple", "files": {"x.txt": ""}})
        assert (answer.status_code, "x.txt: expected only files" in answer.text) == (422, True)


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
def server(quiet):
    with serving(guarded(quiet.service)) as address:
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
        (tmp_path / "own.yaml").write_text(TEXT.replace("{method: random}", "{method: random, flavour: x.yaml}"))
        code, out, err = client("submit", "own.yaml")
        assert (code, out) == (3, "")
        assert "methods.random.flavour: expected the name of a shipped one, found x.yaml" in err

    @pytest.mark.parametrize(
        ("named", "words"),
        [
            ("fsm.txt", "own.yaml:6: methods.hand.files[0]: "),
            ("../fsm.txt", "own.yaml:6: methods.hand.files[0]: expected a file in the folder of the study or below, "),
            ("large.txt", "large.txt: expected at most 256 KiB, found a larger file"),
        ],
    )
    def test_a_file_that_cannot_be_sent(self, client, tmp_path, named, words):
        (tmp_path / "large.txt").write_text("#" * 300_000)
        (tmp_path / "own.yaml").write_text(TEXT.replace("methods: {", f"methods: {{hand: {{files: [{named}]}}, "))
        code, out, err = client("submit", "own.yaml")
        assert (code, out) == (2, "")
        assert words in err


def test_no_shipped_study_has_the_name_of_a_mission():
    """By its name alone, one or the other is submitted."""
    assert not shipped.studies().keys() & shipped.missions().keys()
