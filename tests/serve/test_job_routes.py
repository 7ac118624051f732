"""The routes on jobs and their files."""

import errno
import os
import shutil
import sqlite3
import threading

import pytest

from tests.serve.races import BUDGET

JOBS = "/api/v1/jobs"


def test_submit_and_show(ann, quiet):
    body = {"mission": "aggregation", "budget": 60, "set": ["robots=2"], "seed": 7, "method": "random"}
    answer = ann.post(JOBS, json=body)
    assert answer.status_code == 201
    job = answer.json()["job"]
    assert (job["owner"], job["state"], job["seed"], job["budget"]) == ("ann", "queued", 7, 60)
    assert ann.get(f"{JOBS}/{job['id']}").json()["name"] == "aggregation"
    assert quiet.service.store.read(job["id"]).request.set == ("robots=2",)


def test_the_same_key_is_the_same_job(ann, bob):
    body, key = {"mission": "aggregation", "budget": 60}, {"Idempotency-Key": "abc"}
    first, second = ann.post(JOBS, json=body, headers=key), ann.post(JOBS, json=body, headers=key)
    assert (first.status_code, second.status_code) == (201, 200)
    assert first.json()["job"]["id"] == second.json()["job"]["id"]
    assert ann.post(JOBS, json={**body, "budget": 61}, headers=key).status_code == 409
    assert bob.post(JOBS, json=body, headers=key).json()["job"]["id"] != first.json()["job"]["id"]


@pytest.mark.parametrize(
    ("body", "status", "words"),
    [
        ({"mission": "nowhere", "budget": 60}, 422, "nowhere: no such mission; shipped are: "),
        ({"mission": "/etc/passwd", "budget": 60}, 422, "/etc/passwd: no such mission"),
        ({"mission": "aggregation", "budget": 3}, 422, "budget"),
        ({"mission": "aggregation", "budget": 60, "set": ["robots=101"]}, 422, "robots: expected at most 100"),
        ({"mission": "aggregation", "budget": 60, "set": ["robot_model=x.yaml"]}, 422, "robot_model"),
        ({"mission": "aggregation"}, 422, "body.budget: Field required"),
        ({"mission": "aggregation", "budget": "60"}, 422, "body.budget"),
        ({"mission": "aggregation", "budget": 60, "jobs": 3}, 422, "body.jobs: Extra inputs are not permitted"),
        ({"budget": 60}, 422, "body: expected one of mission and mission_text"),
        ({"mission": "aggregation", "budget": 10**8}, 429, "budget: expected at most 100000"),
        ({"mission_text": "name: [", "budget": 60}, 422, "mission.yaml"),
        ({"mission_text": "schema: 1\nname: x\nfloor: {image: /etc/passwd}", "budget": 60}, 422, "mission.yaml"),
    ],
)
def test_what_is_not_valid_is_refused(ann, body, status, words):
    answer = ann.post(JOBS, json=body)
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"
    assert words in " ".join(answer.json()["errors"])


def test_find(ann, bob, quiet):
    own, shared, private = quiet.submit("ann", name="needle"), quiet.submit("bob"), quiet.submit("bob")
    quiet.service.jobs.change(shared, shared=True)
    found = {job["id"] for job in ann.get(f"{JOBS}?limit=500").json()["jobs"]}
    assert {own, shared} <= found
    assert private not in found
    assert {job["id"] for job in bob.get(f"{JOBS}?limit=500").json()["jobs"]} >= {shared, private}
    assert [job["id"] for job in ann.get(f"{JOBS}?text=NEEDLE").json()["jobs"]] == [own]
    assert ann.get(f"{JOBS}?owner=bob").json()["total"] == 1
    assert ann.get(f"{JOBS}?text=%25").json()["total"] == 0
    page = ann.get(f"{JOBS}?limit=1&offset=1&order=submitted&descending=false").json()
    assert len(page["jobs"]) == 1
    assert page["total"] > 1
    assert ann.get(f"{JOBS}?order=key").status_code == 422
    assert ann.get(f"{JOBS}?state=gone").status_code == 422


def test_what_others_do_not_share_is_not_there(ann, bob, quiet):
    job = quiet.submit("bob")
    quiet.race(job)
    for method, path in [
        ("GET", ""), ("PATCH", ""), ("DELETE", ""), ("POST", "/pause"), ("POST", "/resume"), ("POST", "/cancel"),
        ("GET", "/files"), ("GET", "/files/fsm.txt"), ("GET", "/events"),
    ]:  # fmt: skip
        body = {"json": {"priority": 1}} if method == "PATCH" else {}
        there = ann.request(method, f"{JOBS}/{job}{path}", **body)
        nowhere = ann.request(method, f"{JOBS}/nowhere{path}", **body)
        assert (there.status_code, nowhere.status_code) == (404, 404)
        assert there.text.replace(job, "nowhere") == nowhere.text
    quiet.service.jobs.change(job, shared=True)
    assert ann.get(f"{JOBS}/{job}").status_code == 200
    assert ann.get(f"{JOBS}/{job}/files/fsm.txt").status_code == 200
    assert ann.post(f"{JOBS}/{job}/cancel").status_code == 403
    assert ann.delete(f"{JOBS}/{job}").status_code == 403


def test_change_and_delete(ann, quiet):
    job = quiet.submit()
    changed = ann.patch(f"{JOBS}/{job}", json={"budget": 200, "priority": 3, "shared": True}).json()
    assert (changed["budget"], changed["priority"], changed["shared"]) == (200, 3, True)
    assert ann.patch(f"{JOBS}/{job}", json={"budget": 100, "priority": 5, "shared": False}).status_code == 409
    assert ann.get(f"{JOBS}/{job}").json() == changed
    assert ann.post(f"{JOBS}/{job}/pause").json()["state"] == "paused"
    assert ann.post(f"{JOBS}/{job}/resume").json()["state"] == "queued"
    assert ann.post(f"{JOBS}/{job}/cancel").json()["state"] == "cancelled"
    assert ann.post(f"{JOBS}/{job}/pause").status_code == 409
    assert ann.delete(f"{JOBS}/{job}").status_code == 204
    assert ann.get(f"{JOBS}/{job}").status_code == 404


def test_files(ann, quiet):
    job = quiet.submit()
    assert ann.get(f"{JOBS}/{job}/files").json() == []
    quiet.race(job)
    names = [one["name"] for one in ann.get(f"{JOBS}/{job}/files").json()]
    assert {"fsm.txt", "journal.jsonl", "results.csv", "provenance.json", "mission.yaml"} <= {*names}
    for name in names:
        answer = ann.get(f"{JOBS}/{job}/files/{name}")
        assert answer.content == (quiet.folder(job) / name).read_bytes()
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert "sandbox" in answer.headers["content-security-policy"]
    assert ann.get(f"{JOBS}/{job}/files/fsm.txt").headers["content-type"].startswith("text/plain")


def test_no_other_file_is_reached(ann, quiet, tmp_path):
    job = quiet.submit()
    quiet.race(job)
    folder = quiet.folder(job)
    secret = tmp_path / "secret"
    secret.write_text("not for you")
    (folder / "link").symlink_to(secret)
    (folder / "links").symlink_to(tmp_path)
    (folder / ".hidden").write_text("not for you")
    os.mkfifo(folder / "pipe")
    for name in (
        "link", "links/secret", ".hidden", "pipe", "../.service/index.sqlite", "..%2f.service%2findex.sqlite",
        "/etc/passwd", "%2fetc%2fpasswd", "fsm.txt/", "", "a\0b", "x" * 300, "x" * 500,
    ):  # fmt: skip
        answer = ann.get(f"{JOBS}/{job}/files/{name}".replace("\0", "%00"))
        assert answer.status_code in (404, 422), name
        assert "not for you" not in answer.text
    names = {one["name"] for one in ann.get(f"{JOBS}/{job}/files").json()}
    assert not names & {"link", "links/secret", ".hidden", "pipe"}


def test_names_that_are_no_text_are_left_out(ann, quiet):
    job = quiet.submit()
    quiet.race(job)
    before = ann.get(f"{JOBS}/{job}/files").json()
    for name in (b"\xff.txt", b"fsm\xe9.txt", b"\xed\xa0\x80", b"\xff/inside.txt"):
        path = quiet.folder(job) / os.fsdecode(name)
        path.parent.mkdir(exist_ok=True)
        path.write_text("x")
    assert ann.get(f"{JOBS}/{job}/files").json() == before
    for page in ("", "/files", "/now", "/race", "/about"):
        assert ann.get(f"/jobs/{job}{page}").status_code == 200
    for name in ("%FF.txt", "fsm%E9.txt", "%EF%BF%BD.txt", "%FF/inside.txt"):
        assert ann.get(f"{JOBS}/{job}/files/{name}").status_code == 404


DAMAGES = {
    "journal.jsonl": lambda data: data.replace(b'"experiment"', b'"experimental"', 1),
    "mission.yaml": lambda data: data.replace(b"name:", b"names:"),
    "provenance.json": lambda _: b"{",
}


@pytest.mark.parametrize(("is_job", "is_there"), [(True, True), (True, False), (False, True)])
@pytest.mark.parametrize("name", DAMAGES)
def test_no_message_says_where_the_data_are(ann, quiet, name, is_there, is_job):
    job = quiet.submit()
    quiet.race(job)
    if not is_job:
        quiet.folder(job).rename(quiet.service.data / f"copy-{job}")
        job = f"copy-{job}"
    file = quiet.folder(job) / name
    if is_there:
        file.write_bytes(DAMAGES[name](file.read_bytes()))
    else:
        file.unlink()
    quiet.service.supervisor.reconcile()
    for path in ("", "/now", "/race", "/about", "/files", "/messages"):
        for kind in ("text/html", "*/*"):
            assert str(quiet.service.data) not in ann.get(f"/jobs/{job}{path}", headers={"accept": kind}).text, path
    for path in ("", "/winner", "/replay", "/files", "/events"):
        assert str(quiet.service.data) not in ann.get(f"{JOBS}/{job}{path}").text, path
    body = {"mission": {"job": job, "set": ["robots=1"]}, "fsms": [{"job": job}], "seed": 1}
    assert str(quiet.service.data) not in ann.post("/api/v1/fsms/replay", json=body).text
    assert str(quiet.service.data) not in ann.get("/").text
    assert str(quiet.service.data) not in ann.get(JOBS).text


def test_a_journal_that_grows_is_sent_to_a_whole_line(ann, quiet):
    job = quiet.submit()
    quiet.race(job, lines=20)
    journal = quiet.folder(job) / "journal.jsonl"
    whole = journal.read_bytes()
    with journal.open("ab") as file:
        file.write(b'{"event":"expe')
    answer = ann.get(f"{JOBS}/{job}/files/journal.jsonl")
    assert answer.content == whole
    assert int(answer.headers["content-length"]) == len(whole)

    stop = threading.Event()

    def grow():
        while not stop.is_set():
            with journal.open("ab") as file:
                file.write(b"x" * 1000 + b"\n")

    thread = threading.Thread(target=grow)
    thread.start()
    try:
        for _ in range(4):
            answer = ann.get(f"{JOBS}/{job}/files/journal.jsonl")
            assert len(answer.content) == int(answer.headers["content-length"])
    finally:
        stop.set()
        thread.join()


@pytest.mark.parametrize(("seed", "status"), [(2**53 - 1, 201), (2**53, 422)])
def test_seeds_are_those_that_pages_have_exactly(ann, seed, status):
    assert ann.post(JOBS, json={"mission": "aggregation", "budget": BUDGET, "seed": seed}).status_code == status


def test_a_full_disk_is_no_fault(ann, quiet, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    job = quiet.submit()
    monkeypatch.setattr("mercator_design.serve.records.write_text", full)
    answer = ann.post(JOBS, json={"mission": "aggregation", "budget": BUDGET})
    assert (answer.status_code, answer.json()["title"]) == (507, "Disk full")
    assert ann.post(f"{JOBS}/{job}/pause").status_code == 507
    monkeypatch.undo()
    assert ann.get(f"{JOBS}/{job}").json()["state"] == "queued"


@pytest.mark.parametrize(("pages", "status"), [(2, 507), (1000, 500)])
def test_a_full_database_is_no_fault(ann, monkeypatch, pages, status):
    """The other error has similar words."""
    database = sqlite3.connect(":memory:", check_same_thread=False)
    database.execute(f"PRAGMA max_page_count={pages}")
    database.execute("CREATE TABLE one (x CHECK (x != 'the disk is full'))")

    def write(*_, **__):
        database.execute("INSERT INTO one VALUES (zeroblob(100000))")
        database.execute("INSERT INTO one VALUES ('the disk is full')")

    monkeypatch.setattr("mercator_design.serve.records.write_text", write)
    assert ann.post(JOBS, json={"mission": "aggregation", "budget": BUDGET}).status_code == status
    database.close()


def test_faults_are_told_without_their_details(ann, quiet, monkeypatch):
    def broken(*_, **__):
        raise sqlite3.OperationalError("no such table: /secret/place")

    monkeypatch.setattr(quiet.service.index, "find", broken)
    answer = ann.get(JOBS)
    assert answer.status_code == 500
    assert "secret" not in answer.text
    monkeypatch.setattr(quiet.service.index, "find", lambda *_, **__: 1 / 0)
    answer = ann.get(JOBS)
    assert (answer.status_code, answer.json()["title"]) == (500, "Internal error")


def test_a_damaged_file_is_reported_without_its_path(ann, quiet):
    job = quiet.submit()
    (quiet.service.store.folder(job) / "job.json").write_text("{")
    answer = ann.get(f"{JOBS}/{job}/mission")
    assert answer.status_code == 500
    assert answer.json()["errors"] == ["the service has made a mistake; its log says which"]


def test_old_run_folders_can_be_looked_at_by_all(ann, quiet):
    shutil.copytree(quiet.raced, quiet.service.data / "old run #1")
    quiet.service.supervisor.reconcile()
    path = f"{JOBS}/old%20run%20%231"
    assert ann.get(path).json()["owner"] == ""
    assert ann.get(f"{path}/files/fsm.txt").status_code == 200
    assert ann.post(f"{path}/cancel").status_code == 403
    assert ann.delete(path).status_code == 403
