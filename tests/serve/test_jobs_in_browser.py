"""The pages on jobs in a browser: they follow races, and nothing is asked of anyone else."""

import pytest

from mercator_design.serve.app import guarded
from tests.serve.races import BUDGET
from tests.serve.serving import serving
from tests.serve.still import still
from tests.show.browser import CHROMIUM

pytestmark = [pytest.mark.timing, pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")]


@pytest.fixture(scope="module")
def live(tmp_path_factory, raced):
    """A service at an address, whose races go on when the test says so."""
    with still(tmp_path_factory.mktemp("browsed") / "runs", raced) as one, serving(guarded(one.service)) as address:
        one.address = address
        yield one


def running(live):
    """A job whose race has begun; no other one runs."""
    for row in live.service.index.all():
        if row.state in ("queued", "running", "paused"):
            live.service.jobs.cancel(row.id)
            if row.state == "running":
                live.processes[row.id].code = 75
    live.tick()
    job = live.submit("local")
    live.race(job, lines=3)
    live.tick()
    live.go_on = lambda lines: (live.append(job, lines), live.service.supervisor.refresh(job))
    return job


def is_clean(page, live):
    """Whether the page has not complained, and has asked this service alone."""
    assert page.complaints == []
    assert all(url.startswith((live.address, "data:")) for url in page.requests), page.requests
    return True


def test_the_list_follows_races_and_changes_them(page, live):
    job, other = running(live), live.submit("local")
    page.open(live.address)
    page.evaluate("window.isSame = true")
    page.evaluate("document.querySelector('input[name=text]').focus()")
    page.wait_for(f"document.getElementById('job-{job}').innerText.includes('0 of {BUDGET}')")
    live.go_on(30)
    done = live.service.index.get(job).experiments
    assert 0 < done < BUDGET
    page.wait_for(f"document.getElementById('job-{job}').innerText.includes('{done} of {BUDGET}')")
    assert page.evaluate("document.activeElement.name") == "text"
    for key in "aggregation-":
        page.press(key)
    page.wait_for("location.search.includes('text=aggregation-')")
    assert page.evaluate("document.activeElement.value") == "aggregation-"
    page.evaluate(f"document.getElementById('cancel-{other}').focus()")
    page.press("Enter")
    page.wait_for("document.querySelector('dialog[open]')")
    page.press("Escape")
    page.wait_for("!document.querySelector('dialog')")
    assert live.service.index.get(other).state == "queued"
    page.press("Enter")
    page.wait_for("document.querySelector('dialog[open]')")
    page.press("Enter")  # the first button: yes
    page.wait_for(f"document.getElementById('job-{other}').innerText.includes('cancelled')")
    assert live.service.index.get(other).state == "cancelled"
    assert page.evaluate("window.isSame")
    assert is_clean(page, live)


def test_a_job_is_followed_to_its_end_and_replayed_meanwhile(page, live):
    job = running(live)
    page.open(f"{live.address}/jobs/{job}")
    page.evaluate("window.isSame = true")
    page.wait_for("document.querySelector('#now').innerText.includes('running')")
    page.evaluate("document.querySelector('#messages summary').click()")
    while live.service.index.get(job).best is None:
        live.go_on(1)
    page.wait_for("document.querySelector('#answer svg')")
    assert "The best so far" in page.evaluate("document.querySelector('#answer').innerText")
    page.wait_for("!document.getElementById('watch').hidden")
    page.evaluate("document.getElementById('watch').click()")
    page.wait_for("!!document.querySelector('#stage canvas')")
    assert page.evaluate("document.querySelectorAll('#runs button').length") == 3
    page.evaluate("document.querySelector('#runs button:last-child').click()")
    page.wait_for("document.querySelector('#stage .stage:last-child:not(:first-child) canvas')")
    assert live.service.index.get(job).state == "running"
    page.evaluate("window.canvas = document.querySelector('#stage canvas'); document.getElementById('watch').blur()")
    live.race(job)
    live.processes[job].code = 0
    live.tick()
    page.wait_for("document.querySelector('#now').dataset.state === 'finished'")
    page.wait_for("(document.querySelector('#answer')?.innerText || '').includes('The winner')")
    page.wait_for(f"document.querySelector('#files a[href=\"/api/v1/jobs/{job}/files/fsm.txt\"]')")
    assert page.evaluate("window.isSame")
    assert page.evaluate("window.canvas.isConnected")
    assert page.evaluate("document.querySelector('#messages details').open")
    assert is_clean(page, live)


def test_a_job_that_cannot_be_followed_live_is_renewed(page, live, monkeypatch):
    job, streams = running(live), live.service.accounts.streams
    with monkeypatch.context() as patch:
        patch.setattr(streams, "_of_user", 0)
        page.open(f"{live.address}/jobs/{job}")
        page.wait_for("document.querySelector('#notice').innerText.includes('Too many pages')")
        live.go_on(30)
        done = live.service.index.get(job).experiments
        page.evaluate("document.dispatchEvent(new CustomEvent('changed'))")  # as after its five seconds
        page.wait_for(f"document.querySelector('#now').innerText.includes('{done} of {BUDGET}')")
    page.evaluate("document.dispatchEvent(new CustomEvent('changed'))")
    page.wait_for("document.querySelector('#notice').innerText === ''")
    assert streams.counts["local"] == 1


@pytest.fixture(scope="module")
def finished(live):
    """A job that has raced."""
    job = live.submit("local")
    live.race(job)
    return job


@pytest.mark.parametrize(("width", "dark"), [(1200, False), (375, False), (375, True)])
def test_pages_fit(page, live, finished, width, dark):
    page.open(live.address, width=width, dark=dark)
    page.wait_for("document.querySelector('table.jobs')")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.open(f"{live.address}/jobs/{finished}", width=width, dark=dark)
    page.wait_for("document.querySelector('#answer svg')")
    page.wait_for("document.querySelector('#about section')")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert is_clean(page, live)


def test_a_job_is_changed_and_deleted(page, live):
    job = live.submit("local")
    page.open(f"{live.address}/jobs/{job}")
    page.evaluate("document.querySelector('#change').closest('details').open = true")
    page.evaluate("document.querySelector('#change [name=budget]').value = 5000")
    page.evaluate("document.querySelector('#change [name=priority]').value = 7")
    page.evaluate("document.querySelector('#change button').click()")
    page.wait_for("document.querySelector('#notice').innerText === 'Changed.'")
    row = live.service.index.get(job)
    assert (row.job.request.budget, row.job.request.priority) == (5000, 7)
    page.wait_for("document.querySelector('#now').innerText.includes('of 5000')")
    live.service.jobs.change(job, priority=3)  # elsewhere
    page.evaluate("document.querySelector('#notice').innerText = ''")
    page.evaluate("document.querySelector('#change [name=budget]').value = 6000")
    page.evaluate("document.querySelector('#change button').click()")
    page.wait_for("document.querySelector('#notice').innerText === 'Changed.'")
    row = live.service.index.get(job)
    assert (row.job.request.budget, row.job.request.priority) == (6000, 3)
    assert page.evaluate("document.querySelector('#change [name=priority]').value") == "3"
    page.evaluate(f"document.getElementById('delete-{job}').click()")
    page.wait_for("document.querySelector('dialog[open]')")
    page.evaluate("document.querySelector('dialog button[value=yes]').click()")
    page.wait_for("location.pathname === '/'")
    assert live.service.index.get(job) is None
    assert is_clean(page, live)


def test_of_a_job_that_is_being_deleted_nothing_is_asked(page, live):
    job = live.submit("local")
    page.open(f"{live.address}/jobs/{job}")
    page.evaluate("{ Mercator.api = () => new Promise((_, reject) => { Mercator.refuse = reject; }); }")
    page.evaluate(f"document.getElementById('delete-{job}').click()")
    page.wait_for("document.querySelector('dialog[open]')")
    page.evaluate("document.querySelector('dialog button[value=yes]').click()")
    page.wait_for("'refuse' in Mercator")
    page.requests.clear()
    page.evaluate("Live.refresh('now')")
    page.evaluate("document.dispatchEvent(new CustomEvent('changed'))")  # its answer may come only now
    page.evaluate("new Promise((done) => setTimeout(done, 100))")
    assert page.requests == []
    page.evaluate("Mercator.refuse(new Error('No.'))")
    page.wait_for("document.querySelector('#notice').innerText === 'No.'")
    page.evaluate("Live.refresh('now')")
    assert page.requests
    assert live.service.index.get(job) is not None


def test_a_service_that_has_gone_and_comes_back_is_reported(page, live, tmp_path, raced):
    with still(tmp_path / "runs", raced) as one:
        with serving(guarded(one.service)) as address:
            page.open(address)
        page.wait_for("document.querySelector('#notice').innerText.includes('does not answer')")
        one.submit("local")
        with serving(guarded(one.service), int(address.rpartition(":")[2])):
            page.wait_for("document.querySelector('#jobs').innerText.includes('queued')")
            page.wait_for("document.querySelector('#notice').innerText === ''")
