"""The page of a new job: its text, and in a browser."""

import html
import json
import re

import pytest

from mercator_design.config import shipped
from mercator_design.missions.mission import load_mission, parse_mission
from mercator_design.serve.web.assets import assets
from tests.serve.machines import client_of, race_in
from tests.show.browser import CHROMIUM
from tests.tiers import some

pytestmark = pytest.mark.together("browser")

SHORT = """schema: 1
name: short
robots: 2
duration: 2
arena: {walls: {shape: regular_polygon, sides: 6, apothem: 1}}
floor: {zones: [{name: nest, shape: disc, center: [0, 0], radius: 0.4, color: black}]}
placement: {shape: disc, radius: 0.9}
objective: {name: robots_in_zone, zones: [nest], direction: maximise}
"""
DRAFT = "mercator/local/new/mission:foraging"


def text_in(page):
    """The mission on a page."""
    return html.unescape(re.search(r"<textarea[^>]*>\n(.*?)</textarea>", page, re.DOTALL)[1])


class TestText:
    def test_it_has_no_script_in_its_text_and_labels_for_all(self, client):
        answer = client.get("/new")
        assert answer.status_code == 200
        assert re.findall(r"<script(?![^>]* src=)", answer.text) == []
        assert re.findall(r"\son\w+=", answer.text) == []
        for tag in re.findall(r"<(?:input|select|textarea)[^>]*>", answer.text):
            assert f'for="{re.search(r" id=.([a-z_]+)", tag)[1]}"' in answer.text, tag

    def test_assets_are_small(self, client):
        sizes = {name: len(assets()[name].data) for name in re.findall(r"/assets/([\w.]+)\?", client.get("/new").text)}
        assert sizes["codemirror.js"] < 600_000
        assert sum(sizes.values()) < 900_000

    @pytest.mark.swept
    @pytest.mark.parametrize("name", some(shipped.missions(), 3))
    def test_it_begins_with_any_shipped_mission_and_its_name(self, client, name):
        text = text_in(client.get("/new", params={"mission": name}).text)
        mission = parse_mission(text, files=False)
        assert (mission.name, mission.digest) == (name, load_mission(name).digest)

    def test_it_begins_with_the_mission_of_a_job(self, client, service):
        text = SHORT + "# <b>mine</b> &amp;\n"
        body = {"mission_text": text, "budget": 777, "method": "irace", "seed": 5}
        job = client.post("/api/v1/jobs", json=body).json()["job"]["id"]
        page = client.get("/new", params={"from": job}).text
        assert text_in(page) == text
        assert 'name="budget" value="777"' in page
        assert 'value="irace" selected' in page
        assert f"job:{job}" in page

    def test_it_begins_with_a_run_folder_that_was_there_before(self, client, service):
        race_in(service.data / "before")
        service.supervisor.reconcile()
        text = text_in(client.get("/new", params={"from": "before"}).text)
        assert client.post("/api/v1/missions/check", json={"mission_text": text}).json()["errors"] == []
        service.index.remove("before")

    @pytest.mark.parametrize("query", [{"mission": "<script>"}, {"from": "<script>"}, {"mission": "../etc/passwd"}])
    def test_what_is_unknown_is_said(self, client, query):
        page = client.get("/new", params=query).text
        assert "there is no" in page
        assert "<script>" not in page
        assert text_in(page).startswith("# Foraging")

    def test_jobs_of_others_are_unknown(self, service):
        with client_of(service, "ann") as ann, client_of(service, "bob") as bob:
            body = {"mission_text": SHORT + "# secret\n", "budget": 100}
            job = ann.post("/api/v1/jobs", json=body).json()["job"]["id"]
            assert "secret" in ann.get("/new", params={"from": job}).text
            assert "secret" not in bob.get("/new", params={"from": job}).text
            assert bob.get(f"/api/v1/jobs/{job}/mission").status_code == 404


@pytest.fixture
def opened(page, address):
    """Opens the page with a text that was typed before; no page complains, or asks another service."""

    def open_(text, **how):
        page.open(f"{address}/new", storage={DRAFT: json.dumps({"text": text})}, **how)
        page.wait_for(summary("No mistakes"))
        page.wait_for("!document.getElementById('picture').hidden")
        page.wait_for("document.getElementById('estimate').textContent.startsWith('About')")  # then nothing moves
        return page

    yield open_
    complaints, requests = [*page.complaints], [*page.requests]
    if page.evaluate("location.pathname") != "/new":
        page.open("about:blank")  # which ends the event stream of a job's page
    assert complaints == []
    assert [url for url in requests if not url.startswith((address, "data:"))] == []


def summary(text):
    return f"document.getElementById('summary').textContent.startsWith({text!r})"


def lines(page):
    return page.evaluate("[...document.querySelectorAll('.cm-line')].map((line) => line.textContent)")


def write(page):
    """Put the cursor at the beginning of the text."""
    page.evaluate("document.querySelector('.cm-content').focus()")
    page.press("Control+Home")


HAS_LINE = "[...document.querySelectorAll('.cm-line')].some((line) => line.textContent === {!r})"
PICTURE = "document.getElementById('picture').src"
FOCUS = "document.activeElement.id || document.activeElement.className"

HELD = """(() => {
  const fetched = window.fetch;
  const held = window.held = { bodies: [], pictures: 0 };
  const gate = new Promise((release, lose) => {
    held.release = release;
    held.lose = () => lose(new Error("the answer was lost"));
  });
  gate.catch(() => {});
  window.fetch = async (address, options) => {
    if (!address.endsWith("%s")) return fetched(address, options);
    held.bodies.push(JSON.parse(options.body));
    const answer = await fetched(address, options);
    if (held.bodies.length === 1) await gate;
    return answer;
  };
  new MutationObserver((all) => (held.pictures += all.length))
    .observe(document.getElementById("picture"), { attributeFilter: ["src"] });
})()"""
"""Holds the first answer of an address back until it is released or lost."""


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")
class TestBrowser:
    def test_a_mission_is_chosen_written_and_submitted(self, opened, address, service):
        page = opened(SHORT)
        assert page.evaluate("document.getElementById('kept').textContent") == "Your earlier text was restored."
        assert lines(page)[1] == "name: short"
        picture = page.evaluate(PICTURE)

        # a mistake is marked, told, and mended
        write(page)
        page.press(*"robtos: 3", "Enter")
        page.wait_for(summary("1 mistake"))
        page.wait_for("document.querySelector('.cm-lint-marker-error')")
        assert page.evaluate("document.querySelector('.cm-lintRange-error').textContent") == "robtos"
        found = page.evaluate("document.getElementById('findings').textContent")
        assert found == "Line 1robtos: unknown key; did you mean 'robots'?"
        assert page.evaluate("document.getElementById('picture').className") == "old"
        page.click("#findings button")
        assert page.evaluate(FOCUS).startswith("cm-content")
        page.press("ArrowDown", "Home", *["Backspace"] * 10)
        page.wait_for(summary("No mistakes"))
        page.wait_for("document.getElementById('picture').className === ''")
        assert lines(page)[:3] == SHORT.splitlines()[:3]

        # the picture changes with the text
        write(page)
        page.press("ArrowDown", "ArrowDown", "End", "Backspace", "5")
        page.wait_for(HAS_LINE.format("robots: 5"))
        page.wait_for(f"{PICTURE} !== {picture!r}")
        page.wait_for("document.getElementById('facts').textContent.includes('5, mercator')")

        # a completion by keyboard, and out of the editor
        page.press("Control+End", *"robot_m")
        page.wait_for("document.querySelector('.cm-tooltip-autocomplete li[aria-selected]')")
        page.wait_for("document.querySelector('.cm-tooltip-autocomplete li').textContent.startsWith('robot_model')")
        page.evaluate("new Promise((done) => setTimeout(done, 150))")  # the editor takes no choice that came just now
        page.press("Enter")
        page.wait_for(HAS_LINE.format("robot_model: "))
        page.wait_for("document.querySelector('.cm-tooltip-autocomplete')?.textContent.includes('epuck')")
        page.press("Escape", *"mercator", "Escape", "Tab")
        page.wait_for(summary("No mistakes"))
        assert page.evaluate(FOCUS) == "back"

        # what was typed survives a reload
        page.open(f"{address}/new")
        page.wait_for(HAS_LINE.format("robot_model: mercator"))

        # an estimate, and one job by two clicks
        page.click('[data-budget="300"]')
        page.wait_for("document.getElementById('estimate').textContent.startsWith('About')")
        before = service.index.find(None)[1]
        page.evaluate("(() => { const button = document.getElementById('submit'); button.click(); button.click(); })()")
        page.wait_for("location.pathname.startsWith('/jobs/')")
        page.wait_for_load()
        rows, total = service.index.find(None)
        job = rows[0].job
        assert (total, job.name, job.request.budget) == (before + 1, "short", 300)
        assert page.evaluate("location.pathname") == f"/jobs/{rows[0].id}"
        assert (
            service.store.text(job.id, "mission.yaml")
            == SHORT.replace("robots: 2", "robots: 5") + "robot_model: mercator"
        )
        assert page.evaluate("localStorage.length") == 0

    def test_what_was_typed_just_before_a_reload_survives_it(self, opened, address):
        page = opened(SHORT)
        page.evaluate("document.querySelector('.cm-content').focus()")
        page.press("Control+End", *"# more", "Escape")
        page.open(f"{address}/new")
        page.wait_for(HAS_LINE.format("# more"))
        page.wait_for(summary("No mistakes"))

    def test_a_picture_that_is_being_drawn_is_reported(self, opened):
        page = opened(SHORT)
        write(page)
        page.press(*"robtos: 3", "Enter")
        page.wait_for(summary("1 mistake"))
        page.evaluate(HELD % "/missions/preview")
        page.press(*["Backspace"] * len("robtos: 3\n"))
        page.wait_for("held.bodies.length === 1")
        assert page.evaluate("document.getElementById('caption').textContent") == "Drawing the mission …"
        page.evaluate("held.release()")
        page.wait_for("document.getElementById('caption').textContent.startsWith('From above')")

    def test_back_to_the_text_at_the_start_and_a_shipped_mission_by_its_name(self, opened, address, service):
        page = opened(SHORT)
        page.click("#back")
        page.wait_for(HAS_LINE.format("name: foraging"))
        page.wait_for("document.getElementById('back').disabled")
        page.wait_for(summary("No mistakes"))
        page.evaluate("document.getElementById('mission').value = 'cleaning'")
        page.click("#start button")
        page.wait_for("location.search === '?mission=cleaning'")
        page.wait_for(summary("No mistakes"))
        page.click("#submit")
        page.wait_for("location.pathname.startsWith('/jobs/')")
        page.wait_for_load()
        (row, *_), _ = service.index.find(None)
        request = service.store.request(row.id)
        assert (request.mission, request.budget, request.mission_text) == ("cleaning", 2000, None)

    def test_settings_and_refusals_are_said(self, opened):
        page = opened(SHORT)
        page.evaluate("document.getElementById('budget').value = '-1'")
        page.click("#submit")
        page.wait_for("document.getElementById('notice').textContent.startsWith('Budget')")
        assert page.evaluate(FOCUS) == "budget"
        page.evaluate("document.getElementById('budget').value = '3'")
        page.evaluate("document.getElementById('budget').dispatchEvent(new Event('input'))")
        page.wait_for("document.getElementById('estimate').textContent.startsWith('budget: expected at least')")
        assert page.evaluate("location.pathname") == "/new"
        assert all("status of 422" in one for one in page.complaints)  # which browsers tell, too
        page.complaints.clear()

    def test_an_answer_on_an_older_text_is_dropped(self, opened):
        page = opened(SHORT)
        page.evaluate(HELD % "/missions/preview")
        write(page)
        page.press("ArrowDown", "ArrowDown", "End", "Backspace", "3")
        page.wait_for("held.bodies.length === 1")
        page.press("Backspace", "4")
        page.wait_for("document.getElementById('facts').textContent.includes('4, mercator')")
        page.press("Backspace", "5")
        page.wait_for("document.getElementById('facts').textContent.includes('5, mercator')")
        assert page.evaluate("[held.bodies.length, held.pictures]") == [1, 0]
        page.evaluate("held.release()")
        page.wait_for("held.pictures")
        assert page.evaluate("held.bodies.map((body) => body.mission_text.match(/robots: (.)/)[1])") == ["3", "5"]
        assert page.evaluate("held.pictures") == 1

    def test_a_job_whose_answer_was_lost_is_submitted_once(self, opened, service):
        page = opened(SHORT)
        before = service.index.find(None)[1]
        page.evaluate(HELD % "/jobs")
        page.click("#submit")
        page.wait_for("held.bodies.length === 1")
        page.evaluate("held.lose()")
        page.wait_for("document.getElementById('notice').textContent.includes('does not answer')")
        assert page.evaluate("location.pathname") == "/new"
        page.click("#submit")
        page.wait_for("location.pathname.startsWith('/jobs/')")
        page.wait_for_load()
        assert service.index.find(None)[1] == before + 1

    @pytest.mark.parametrize("dark", [False, True])
    def test_telephone_and_colours(self, opened, dark):
        page = opened(SHORT, width=375, height=760, dark=dark)
        assert page.evaluate("document.documentElement.scrollWidth") == 375
        tops = [page.evaluate(f"document.querySelector('{one}').getBoundingClientRect().top") for one in (
            ".cm-editor", "#picture", "#race",
        )]  # fmt: skip
        assert tops == sorted(tops)
        background = page.evaluate("getComputedStyle(document.querySelector('.cm-editor')).backgroundColor")
        assert background == ("rgb(17, 22, 27)" if dark else "rgb(255, 255, 255)")
