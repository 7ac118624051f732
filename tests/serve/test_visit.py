"""A whole visit in a browser: from the login to the fsm.txt, with a real race."""

import json

import pytest

from mercator_design.config import shipped
from mercator_design.fsm.text import parse
from mercator_design.serve.accounts.users import Users
from mercator_design.serve.app import guarded
from mercator_design.serve.service import Service
from tests.serve.accessibility import serious_faults
from tests.serve.serving import serving
from tests.show.browser import CHROMIUM

pytestmark = [pytest.mark.timing, pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")]

MISSION = shipped.missions()["aggregation"].read_text(encoding="utf-8")
SHORT = MISSION.replace("robots: 3\n", "robots: 2\n").replace("duration: 120", "duration: 3")


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """The address of a service with a user, and the user's token."""
    data = tmp_path_factory.mktemp("lab") / "runs"
    token = Users(data).add("ann")
    with Service(data) as service, serving(guarded(service)) as address:
        yield address, token


def submit(page, **body):
    request = json.dumps({"method": "random", **body})
    return page.evaluate(f"Mercator.api('POST', '/jobs', {request}).then((one) => one.job.id)")


def choose(page, identity, value):
    page.wait_for(f"document.querySelector('#{identity} option[value={json.dumps(value)}]')")
    page.evaluate(
        f"(() => {{ const one = document.getElementById({identity!r}); one.value = {value!r};"
        "one.dispatchEvent(new Event('change', { bubbles: true })); })()"
    )


def test_from_the_login_to_the_fsm(page, lab):
    address, token = lab
    page.open(address)
    assert page.evaluate("document.querySelector('h1').textContent") == "Log in"
    page.evaluate("document.getElementById('token').focus()")
    page.press(*token, "Enter")
    page.wait_for("document.querySelector('h1')?.textContent === 'Jobs'")
    assert page.evaluate("document.querySelector('.who').textContent") == "ann"

    # a mission with a mistake is mended and submitted
    page.open(f"{address}/new?mission=aggregation")
    draft = json.dumps(json.dumps({"text": f"robtos: 9\n{SHORT}", "settings": {"budget": "60", "method": "random"}}))
    page.evaluate(f"localStorage.setItem('mercator/ann/new/mission:aggregation', {draft})")
    page.open(f"{address}/new?mission=aggregation")
    page.wait_for("document.getElementById('findings').textContent.includes(\"did you mean 'robots'?\")")
    page.evaluate("document.querySelector('.cm-content').focus()")
    page.press("Control+Home", "ArrowDown", "Home", *["Backspace"] * len("robtos: 9\n"))
    page.wait_for("document.getElementById('summary').textContent.startsWith('No mistakes')")
    page.evaluate("document.getElementById('submit').click()")
    page.wait_for("location.pathname.startsWith('/jobs/')")
    job = page.evaluate("decodeURIComponent(location.pathname.slice(6))")

    # its race is followed to its end, and its winner receive_again
    page.wait_for("document.querySelector('#now')?.dataset.state === 'finished'")
    page.wait_for("document.getElementById('watch') && !document.getElementById('watch').hidden")
    page.evaluate("document.getElementById('watch').click()")
    page.wait_for("document.querySelector('#stage canvas')")
    assert serious_faults(page) == []

    # another job is cancelled
    other = submit(page, mission="foraging", budget=100_000)
    page.open(address)
    page.wait_for(f"document.getElementById('cancel-{other}')")
    page.evaluate(f"document.getElementById('cancel-{other}').click()")
    page.wait_for("document.querySelector('dialog[open]')")
    page.evaluate("document.querySelector('dialog button[value=yes]').click()")
    page.wait_for(f"document.querySelector('#job-{other} .state-cancelled')")

    # an FSM is drawn, and run against the winner
    page.open(f"{address}/fsm")
    page.click("#diagram button")
    page.wait_for("document.querySelectorAll('#diagram [data-state]').length === 1")
    choose(page, "mission", f"job:{job}")
    choose(page, "rival", f"job:{job}")
    page.evaluate("document.getElementById('runs').value = 4")
    page.evaluate("document.getElementById('run').click()")
    page.wait_for("document.querySelector('#results .verdict')")
    assert "paired t-test on 4 instances" in page.evaluate("document.getElementById('results').textContent")
    assert serious_faults(page) == []

    # designs are compared, and the winner is fetched
    page.open(f"{address}/compare?job={job}&fsm=--nstates+1+--s0+1&runs=4")
    page.wait_for("document.querySelectorAll('#results table').length === 2")
    assert serious_faults(page) == []
    page.open(f"{address}/jobs/{job}")
    page.wait_for("document.querySelector('a[download]')")
    text = page.evaluate("fetch(document.querySelector('a[download]').href).then((one) => one.text())")
    parse(text.strip().splitlines()[-1], "watermelon")
    assert [url for url in page.requests if not url.startswith((address, "data:"))] == []
    assert page.complaints == []

    # out again: nothing of it is shown any more, and no draft is left
    page.evaluate("localStorage.setItem('mercator/bob/fsm', '{}')")  # of who used this browser before
    page.open(f"{address}/new?mission=aggregation")
    assert page.evaluate("Object.keys(localStorage).join()") == "mercator/ann/fsm"
    page.evaluate("document.querySelector('.cm-content').focus()")
    page.press("a")  # what was typed just now is kept when the page is left
    page.click("header form button")
    page.wait_for("document.querySelector('h1')?.textContent === 'Log in'")
    assert page.evaluate("Object.keys(localStorage).join()") == "mercator/left"
    page.open(f"{address}/jobs/{job}")
    assert page.evaluate("document.querySelector('h1').textContent") == "Log in"
