"""The pages on jobs, as browsers get them."""

import html
import json
import re
import shutil
from html.parser import HTMLParser

import pytest

from mercator_design.serve.web.assets import assets
from tests.serve.races import BUDGET
from tests.serve.still import ROOT

EVIL = "<script>alert(1)</script>\u202e\"'&"


class Checked(HTMLParser):
    """Finds scripts and handlers in a page, and elements that are not closed."""

    VOID = frozenset({"meta", "link", "input", "br", "img", "hr"})

    def __init__(self, text):
        super().__init__()
        self.open, self.scripts, self.ids, self.unlabelled = [], [], [], 0
        self.feed(text)
        assert self.open == [], self.open

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        assert not any(name.startswith("on") for name in found), attributes
        if tag == "script":
            self.scripts.append(found.get("src"))
        if "id" in found:
            self.ids.append(found["id"])
        if tag in ("input", "select", "textarea") and "label" not in self.open and "aria-label" not in found:
            self.unlabelled += 1
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in self.VOID:
            assert self.open.pop() == tag

    def handle_startendtag(self, tag, attributes):
        pass


def checked(answer):
    assert answer.status_code == 200, answer.text
    assert "script-src 'self'" in answer.headers["content-security-policy"]
    page = Checked(answer.text)
    assert None not in page.scripts
    assert len(page.ids) == len({*page.ids})
    assert page.unlabelled == 0
    return answer.text


def test_the_first_page_leads_to_a_first_job(quiet, ann):
    if not quiet.service.index.all():
        text = checked(ann.get("/"))
        assert "No jobs yet" in text
        assert 'href="/new"' in text


def test_the_list(quiet, ann):
    job = quiet.submit()
    quiet.show(job, in_job={"name": EVIL})
    other = quiet.submit("bob")
    text = checked(ann.get("/"))
    assert job in text
    assert other not in text
    assert "alert(1)</script>" not in text
    assert "\u202e" not in text
    assert f'data-do="POST /jobs/{job}/pause"' in text


@pytest.mark.parametrize(
    ("wish", "message", "expected"),
    [
        ("run", "", ["pause", "cancel"]),
        ("run", "stopping: the disk is nearly full", ["pause", "cancel"]),
        ("pause", "", ["cancel"]),
        ("cancel", "", []),
    ],
)
def test_a_running_job_has_the_buttons_of_what_can_still_be_asked(quiet, ann, wish, message, expected):
    job = quiet.submit()
    quiet.show(job, in_job={"wish": wish}, state="running", message=message)
    assert re.findall(f'data-do="POST /jobs/{job}/([a-z]+)"', checked(ann.get("/"))) == expected


def test_filters(quiet, ann):
    job, cancelled = quiet.submit(name="one of a kind"), quiet.submit(name="two of a kind")
    quiet.service.jobs.cancel(cancelled)
    both = ann.get("/jobs", params={"text": "of a kind"}).text
    assert job in both
    assert cancelled in both
    some = ann.get("/jobs", params={"text": "of a kind", "state": "cancelled"})
    assert job not in some.text
    assert cancelled in some.text
    assert 'data-live="/jobs?state=cancelled&amp;text=of+a+kind"' in some.text
    order = ann.get("/jobs", params={"text": "of a kind", "order": "name", "direction": "up"}).text
    assert order.index(job) < order.index(cancelled)
    assert "No job matches" in ann.get("/jobs?text=nothing+like+it").text


@pytest.mark.parametrize(
    "query", ["state=x&order=key&direction=y&page=-3&whose=z", "page=999999", "text=%00%ff%3Cb%3E", "page=x"]
)
def test_odd_queries_are_no_errors(ann, query):
    checked(ann.get(f"/?{query}"))


def test_pages_of_the_list(quiet, ann):
    for _ in range(30):
        quiet.submit(name="many")
    first, last = ann.get("/jobs?text=many").text, ann.get("/jobs?text=many&page=2").text
    assert first.count("<tr id=") == 25
    assert last.count("<tr id=") == 5
    assert 'href="/?text=many&amp;page=2"' in first
    assert ann.get("/jobs?text=many&page=77").text.count("<tr id=") == 5


def test_the_page_of_a_job_over_its_life(quiet, ann, bob):
    job = quiet.submit()
    quiet.show(job, in_job={"name": EVIL})
    text = checked(ann.get(f"/jobs/{job}"))
    assert "alert(1)</script>" not in text
    assert 'class="state state-queued"' in text
    assert f'href="/new?from={job}"' in text
    assert "The race has not begun yet" in ann.get(f"/jobs/{job}/race").text
    assert "waits until other jobs have ended" in text
    quiet.race(job, lines=70)
    part = ann.get(f"/jobs/{job}/race")
    assert "The best so far" in part.text or "No winner yet" in part.text
    quiet.race(job)
    quiet.tick()
    parts = ann.get(f"/jobs/{job}/race")
    while "x-again" in parts.headers:
        parts = ann.get(f"/jobs/{job}/race")
    assert "The winner" in parts.text
    assert "What matters<" in parts.text
    assert re.search(r"on 30 fresh instances, [-.\d]+ to [-.\d]+ at 95%", parts.text)
    assert "on 30 fresh instances" in ann.get(f"/jobs/{job}/now").text
    assert "on 30 fresh instances" in ann.get("/").text
    assert "not a run folder" not in parts.text
    assert '/files/fsm.txt" download="fsm.txt"' in ann.get(f"/jobs/{job}/now").text
    assert "<svg" in parts.text
    assert str(quiet.service.data) not in parts.text
    have = re.search('data-have="([^"]+)"', parts.text)[1]
    assert ann.get(f"/jobs/{job}/race?have={have}").status_code == 204
    text = checked(ann.get(f"/jobs/{job}"))
    assert f'/api/v1/jobs/{job}/files/fsm.txt"' in text
    assert 'data-ended="true"' in text
    assert "What was asked" in ann.get(f"/jobs/{job}/about").text
    runs = json.loads(html.unescape(re.search('data-runs="([^"]+)"', parts.text)[1]))
    assert [one["label"].split(":")[0] for one in runs] == ["median", "best", "worst"]
    for one in runs:
        assert isinstance(one["seed"], int)
        (replay,) = ann.get(f"/api/v1/jobs/{job}/replay?seed={one['seed']}").json()
        assert replay["header"]["score"] == one["score"]
    for path in ("", "/now", "/race", "/about", "/files", "/messages"):
        assert bob.get(f"/jobs/{job}{path}").status_code == 404
    quiet.service.jobs.change(job, shared=True)
    text = checked(bob.get(f"/jobs/{job}"))
    assert "data-do=" not in text
    assert "Messages of its process" not in text
    assert bob.get(f"/jobs/{job}/messages").status_code == 403


def test_nothing_to_replay_yet(quiet, ann):
    job = quiet.submit()
    quiet.race(job, lines=3)
    assert "data-runs" not in ann.get(f"/jobs/{job}/race").text
    assert "has no winner yet" in ann.get(f"/api/v1/jobs/{job}/replay").json()["errors"][0]


def test_a_failed_job_says_why_and_what_to_do(quiet, ann):
    job = quiet.submit()
    quiet.service.store.update(job, failure=f"no {EVIL}", ended="2030-01-01T00:00:00+00:00")
    (quiet.service.store.folder(job) / "output.txt").write_text(f"Error: {EVIL}\x1b[31m\n")
    quiet.service.supervisor.refresh(job)
    text = checked(ann.get(f"/jobs/{job}"))
    assert "alert(1)</script>" not in text
    assert "\x1b" not in text
    assert "Resume it to try again" in text
    assert f'data-do="POST /jobs/{job}/resume"' in text
    assert "<details open><summary>Messages of its process" in text


def test_a_damaged_run_folder_is_reported(quiet, ann):
    job = quiet.submit()
    quiet.race(job)
    journal = quiet.folder(job) / "journal.jsonl"
    journal.write_bytes(journal.read_bytes().replace(b'"experiment"', b'"experimental"', 1))
    assert "journal was damaged or changed" in ann.get(f"/jobs/{job}/race").text
    assert ann.get(f"/jobs/{job}/about").status_code == 200
    checked(ann.get(f"/jobs/{job}"))


@pytest.mark.parametrize("name", ["my old run", "x" * 255])
def test_old_run_folders_are_shown_without_actions(quiet, ann, name):
    shutil.copytree(quiet.raced, quiet.service.data / name)
    quiet.service.supervisor.reconcile()
    name = name.replace(" ", "%20")
    text = checked(ann.get(f"/jobs/{name}"))
    assert "data-do=" not in text
    assert "A run folder in the data folder" in text
    assert f'href="/api/v1/jobs/{name}/files/fsm.txt"' in text
    assert ann.get(f"/api/v1/jobs/{name}/files/fsm.txt").status_code == 200
    assert ann.get(f"/new?from={name}").status_code == 200


FOREIGN = """
from pathlib import Path
from mercator_design import objective
Path({mark!r}).touch()

@objective
def leftmost(trace) -> float:
    return float(trace.poses[-1, 0, 0])
"""


@pytest.mark.usefixtures("registries")
def test_plugins_of_old_run_folders_are_not_run(quiet, ann, mdesign_once, tmp_path):
    """Only those that serve.yaml names are: who puts a folder there may have it from a stranger."""
    plugin, mark, race = tmp_path / "mine.py", tmp_path / "has run", ("--budget", BUDGET, "--jobs", 1, "--quiet")
    plugin.write_text(FOREIGN.format(mark=str(mark)))
    mission = ("aggregation", "--set", "duration=2", "--set", "objective={name: leftmost, direction: maximise}")
    mdesign_once("race", *mission, "--plugin", plugin, *race, "-o", quiet.service.data / "foreign")
    mark.unlink()
    quiet.service.supervisor.reconcile()
    for part in ("", "/race", "/about", "/files"):
        text = html.unescape(ann.get(f"/jobs/foreign{part}").text)
        assert ("Note: mine.py: expected a plugin that serve.yaml names" in text) == (part == "/race")
    assert not mark.exists()


def test_an_administrator_sees_all(quiet):
    job = quiet.submit("bob")
    with quiet.client(ROOT) as root:
        assert job in root.get("/").text
        assert f'data-do="POST /jobs/{job}/pause"' in checked(root.get(f"/jobs/{job}"))


def test_pages_are_small():
    names = {"report.css", "charts.css", "app.css", "htmx.min.js", "app.js", "live.js", "jobs.css"}
    assert sum(len(assets()[name].data) for name in names) < 100_000
    assert sum(len(assets()[name].data) for name in names | {"viewer.js", "viewer.css", "page.js", "job.js"}) < 200_000


def test_errors_are_pages_to_who_reads_pages(ann, monkeypatch, quiet):
    html = {"accept": "text/html,*/*"}
    for path in ("/jobs/nowhere", "/nowhere"):
        answer = ann.get(path, headers=html)
        assert answer.status_code == 404
        assert "<h1>" in answer.text
        assert "script-src 'self'" in answer.headers["content-security-policy"]
    assert "there is no job nowhere" in ann.get("/jobs/nowhere", headers=html).text
    assert ann.get("/jobs/nowhere").json()["status"] == 404
    assert ann.get("/api/v1/jobs/nowhere", headers=html).json()["status"] == 404
    monkeypatch.setattr(quiet.service.index, "find", lambda *_, **__: 1 / 0)
    answer = ann.get("/", headers=html)
    assert answer.status_code == 500
    assert "the service has made a mistake" in answer.text
