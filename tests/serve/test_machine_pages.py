"""The pages on which FSMs are drawn, compared and kept: their text, and in a browser."""

import html
import re

import pytest

from mercator_design.serve.web.assets import assets
from tests.serve.machines import FSM, MISSION, STOP, client_of, race_in
from tests.show.browser import CHROMIUM

pytestmark = pytest.mark.together("browser")

PAGES = ("/fsm", "/compare", "/gallery")


@pytest.fixture(scope="module")
def raced(service):
    """A run folder that was there before, in the data folder."""
    run = race_in(service.data / "before")
    service.supervisor.reconcile()
    return run


def save(client, name, **more):
    body = {"name": name, "mission": MISSION, "fsm": {"fsm": FSM}, **more}
    answer = client.post("/api/v1/designs", json=body)
    assert answer.status_code == 201, answer.text
    return answer.json()["id"]


class TestText:
    @pytest.mark.parametrize("path", PAGES)
    def test_pages_have_no_script_in_their_text(self, client, path):
        answer = client.get(path)
        assert answer.status_code == 200
        assert "script-src 'self'" in answer.headers["content-security-policy"]
        assert re.findall(r"<script(?![^>]* src=)", answer.text) == []
        assert re.findall(r"\son\w+=", answer.text) == []

    @pytest.mark.parametrize("path", PAGES)
    def test_every_input_has_a_label(self, client, path):
        text = client.get(path).text
        for tag in re.findall(r"<(?:input|select|textarea)[^>]*>", text):
            identity = re.search(r' id="([\w-]+)"', tag)
            labelled = identity and f'<label for="{identity[1]}"' in text
            assert labelled or re.search(r"<label[^>]*>\s*" + re.escape(tag), text), tag

    @pytest.mark.parametrize("path", PAGES)
    def test_assets_are_small(self, client, path):
        names = re.findall(r"/assets/([\w.]+)\?", client.get(path).text)
        assert sum(len(assets()[name].data) for name in names) < 200_000

    def test_the_editor_offers_also_an_old_job_or_design_that_is_asked_for(self, service, raced, monkeypatch):
        with client_of(service, "ann") as ann, client_of(service, "bob") as bob:
            design = save(ann, "an old one")
            monkeypatch.setattr(service.index, "find", lambda *_, **__: ([], 0))
            monkeypatch.setattr(service.designs, "find", lambda _: [])
            asked = f"/fsm?job=before&design={design}"
            for value in ("job:before", f"design:{design}"):
                assert ann.get("/fsm").text.count(f'value="{value}"') == 0
                assert ann.get(asked).text.count(f'value="{value}"') == 2  # as a mission, and to compare with
            assert design not in bob.get(asked).text
            assert ann.get("/fsm?job=none&design=none").status_code == 200

    def test_designs_of_others_are_not_on_them(self, service, raced):
        with client_of(service, "ann") as ann, client_of(service, "bob") as bob:
            secret, shared = save(ann, "mine alone"), save(ann, "for all", shared=True)
            for path in PAGES:
                text = bob.get(path).text
                assert (secret in text, shared in text) == (False, True), path
                assert secret in ann.get(path).text
            assert shared not in bob.get("/gallery?own=true").text
            assert "before" in bob.get("/gallery").text
            assert f'data-id="{shared}"' not in bob.get("/gallery?text=nothing").text
            assert "data-delete" not in bob.get("/gallery?text=for all").text

    def test_the_page_of_a_job_leads_to_them(self, client, raced):
        text = client.get("/jobs/before").text
        assert 'href="/fsm?job=before"' in text
        assert 'href="/compare?job=before"' in text

    def test_texts_of_users_are_texts(self, client):
        text = client.get("/gallery", params={"text": '"><script>alert(1)</script>'}).text
        assert "<script>alert" not in text
        assert html.escape('"><script>alert(1)</script>') in text


@pytest.fixture
def quiet(page, address, raced):
    """The page; afterwards, its console is empty, and no request has left the service."""
    page.open(f"{address}/healthz", storage={})
    yield page
    assert page.complaints == []
    assert [url for url in page.requests if not url.startswith((address, "data:"))] == []


def states(n):
    return f"document.querySelectorAll('#diagram [data-state]').length === {n}"


def transitions(n):
    return f"document.querySelectorAll('#diagram [data-transition][role=button]').length === {n}"


def text_is(text):
    return f"document.getElementById('text').value === {text!r}"


def choose(page, selector, value):
    page.wait_for(f"document.querySelector({selector!r})")
    page.evaluate(
        f"(() => {{ const one = document.querySelector({selector!r}); one.value = {value!r};"
        "for (const kind of ['input', 'change']) one.dispatchEvent(new Event(kind, { bubbles: true })); })()"
    )


DRAWN = "--nstates 2 --s0 0 --rwm0 50 --n0 1 --n0x0 0 --c0x0 0 --p0x0 0.5 --s1 1 --n1 1 --n1x0 0 --c1x0 5 --p1x0 0.25"


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")
class TestBrowser:
    def test_an_fsm_is_drawn_run_compared_saved_and_found(self, quiet, address, service):
        page = quiet
        page.open(f"{address}/fsm")
        page.click("#diagram button")
        page.wait_for(states(1))
        page.click("#add-state")
        page.wait_for(states(2))
        page.drag(page.middle("#diagram [data-state='0'] .box"), page.middle("#diagram [data-state='1'] .box"))
        page.wait_for(transitions(1))
        page.drag(page.middle("#diagram [data-state='1'] .box"), page.middle("#diagram [data-state='0'] .box"))
        page.wait_for(transitions(2))
        choose(page, "#condition", "fixed probability")
        choose(page, "#parameter-beta", "0.25")
        page.wait_for(text_is(DRAWN))
        page.click("#diagram [data-transition='0-0'][role=button]")
        page.wait_for("document.querySelector('#part h2').textContent === 'Transition 0 of exploration'")
        for name in ("mission", "rival"):
            choose(page, f"#{name}", "job:before")
        choose(page, "#runs", "4")
        page.click("#run")
        page.wait_for("document.querySelectorAll('#replay canvas').length === 4")
        found = page.evaluate("document.getElementById('results').textContent")
        assert re.search(r"my FSM is \w+.* than|my FSM is not distinguishable from", found)
        assert "paired t-test on 4 instances" in found
        page.evaluate("document.getElementById('name').value = 'drawn by mouse'")
        page.click("#saving button")
        page.wait_for("document.querySelector('#saved a')")
        (design,) = service.designs.find(None, text="drawn by mouse")
        assert service.designs.text(design.id, "fsm.txt").endswith(f"{DRAWN}\n")
        page.click("#saved a")
        page.wait_for(f"document.querySelector('#{design.id} svg')")
        page.click(f"#{design.id} [data-replay]")
        page.wait_for("document.querySelector('dialog[open] canvas')")
        page.click("#close")
        assert page.evaluate("document.querySelector('dialog[open]')") is None

    def test_by_keyboard_alone(self, quiet, address):
        page = quiet
        page.open(f"{address}/fsm")
        page.wait_for("document.querySelector('#diagram button')")
        page.evaluate("document.querySelector('#diagram button').focus()")
        page.press("Enter")
        page.wait_for(states(1))
        for name, key in (("add-state", "Enter"), ("add-transition", " ")):
            page.wait_for(f"document.getElementById('{name}')")
            page.evaluate(f"document.getElementById('{name}').focus()")
            page.press(key)
        page.wait_for(f"{states(2)} && {transitions(1)}")
        page.evaluate("document.querySelector('#diagram [data-state=\"0\"]').focus()")
        page.press("Enter")
        page.wait_for("document.querySelector('#part h2').textContent === 'State 0 (initial)'")
        page.evaluate("document.getElementById('parameter-tau').select()")
        page.press("7")
        line = "--nstates 2 --s0 0 --rwm0 7 --s1 1 --n1 1 --n1x0 0 --c1x0 0 --p1x0 0.5"
        page.wait_for(text_is(line))
        page.open(f"{address}/fsm")  # what was drawn is still there
        page.wait_for(text_is(line))
        page.evaluate("document.querySelector('#diagram [data-transition][role=button]').focus()")
        page.press("Delete")
        page.wait_for(transitions(0))
        page.evaluate("document.getElementById('undo').focus()")
        page.press("Enter")
        page.wait_for(text_is(line))

    def test_by_finger(self, quiet, address):
        page = quiet
        page.open(f"{address}/fsm", width=375)
        page.click("#diagram button")
        page.wait_for(states(1))
        page.click("#add-state")
        page.wait_for(states(2))
        page.middle("#diagram [data-state='0'] .box")
        target = page.middle("#diagram [data-state='1'] .box")
        page.slide(page.middle("#diagram [data-state='0'] .box"), target)
        page.wait_for(transitions(1))
        assert page.evaluate("document.documentElement.scrollWidth") == 375

    @pytest.mark.parametrize("kept", ["{", "[]", '{"machine": {"flavour": "mint", "states": []}}', '{"machine": 1}'])
    def test_what_another_version_has_kept_is_left_alone(self, quiet, address, kept):
        page = quiet
        page.evaluate(f"localStorage.setItem('mercator/local/fsm', {kept!r})")
        page.open(f"{address}/fsm")
        page.click("#diagram button")
        page.wait_for(states(1))

    def test_text_is_read_and_mistakes_are_shown(self, quiet, address):
        page = quiet
        page.open(f"{address}/fsm")
        page.wait_for("document.querySelector('#diagram button')")
        for text, problem in (("--nstates 9", "found 9"), (STOP, "")):
            page.evaluate(f"document.getElementById('text').value = {text!r}")
            page.click("#use-text")
            page.wait_for(f"document.getElementById('text-problem').textContent.includes({problem!r}) || null")
        page.wait_for(states(1))
        choose(page, "#behaviour", "exploration")
        choose(page, "#parameter-tau", "1000")
        page.wait_for("document.getElementById('notes').textContent.includes('states[0].tau: expected')")
        assert page.evaluate("document.getElementById('run').disabled")

    def test_the_winner_of_a_job_is_edited(self, quiet, address, raced):
        page = quiet
        page.open(f"{address}/fsm?job=before")
        page.wait_for(states(len(raced.pfsm.states)))
        assert page.evaluate("document.getElementById('rival').value") == "job:before"
        assert page.evaluate("document.getElementById('mission').value") == "job:before"

    @pytest.mark.parametrize("dark", [False, True])
    def test_comparison_by_a_link(self, quiet, address, dark):
        page = quiet
        link = f"{address}/compare?job=before&fsm={STOP.replace(' ', '+')}&fsm={FSM.replace(' ', '+')}&runs=3"
        page.open(link, width=375, dark=dark)
        page.wait_for("document.querySelectorAll('#replay canvas').length === 4")
        assert page.evaluate("document.querySelectorAll('table tbody tr').length") == 3 + 3
        assert page.evaluate("document.documentElement.scrollWidth") == 375
        assert "fsm=" in page.evaluate("location.search")
        assert "runs=3" in page.evaluate("location.search")
