"""The page of a new study: its text, and in a browser."""

import base64
import html
import re

import pytest

from mercator_design.config import shipped
from tests.serve.own_study import FILES, OWN, OWN_TOTAL
from tests.show.browser import CHROMIUM

pytestmark = pytest.mark.together("browser")

FLAT = OWN.replace("made/", "")


def text_in(page):
    return html.unescape(re.search(r"<textarea[^>]*>\n(.*?)</textarea>", page, re.DOTALL)[1])


class TestText:
    def test_it_begins_with_any_shipped_study_and_has_labels_for_all(self, client):
        for name, file in shipped.studies().items():
            page = client.get("/new/study", params={"study": name}).text
            assert text_in(page) == file.read_text()
            assert f'<option value="{name}" selected>' in page
        assert re.findall(r"<script(?![^>]* src=)|\son\w+=", page) == []
        for tag in re.findall(r"<(?:input|select|textarea)[^>]*>", page):
            assert f'for="{re.search(r" id=.([a-z_]+)", tag)[1]}"' in page, tag

    def test_the_forms_lead_to_each_other(self, client):
        assert '<a href="/new/study">A study</a>' in client.get("/new").text
        assert '<a href="/new">A race</a>' in client.get("/new/study").text

    def test_what_is_unknown_is_said(self, client):
        page = client.get("/new/study", params={"study": "<script>"}).text
        assert "there is no shipped study &lt;script&gt;" in page
        assert "<script>" not in page


WRITE = """(() => {
  document.getElementById("text").value = %r;
  const data = new DataTransfer();
  const bytes = (text) => Uint8Array.from(atob(text), (one) => one.charCodeAt(0));
  for (const [name, text] of Object.entries(%s)) data.items.add(new File([bytes(text)], name));
  document.getElementById("files").files = data.files;
  document.getElementById("files").dispatchEvent(new Event("change"));
  document.getElementById("text").dispatchEvent(new Event("input"));
  return true;
})()"""
NOTICE = "document.getElementById('notice').textContent"


def write(page, text, files):
    """Write a study, and choose files."""
    page.evaluate(WRITE % (text, {name: base64.b64encode(data).decode() for name, data in files.items()}))


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")
class TestBrowser:
    @pytest.mark.parametrize(("width", "dark"), [(1200, False), (390, True)])
    def test_a_study_with_files_is_submitted(self, page, address, service, width, dark):
        page.open(f"{address}/new/study", width=width, dark=dark, storage={})
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        files = {name.removeprefix("made/"): text.encode() for name, text in FILES.items()}

        # what is refused is said as text, and what was written stays
        write(page, FLAT.replace("own files", "<b>bold</b>"), files)
        page.click("#submit")
        page.wait_for(f"{NOTICE}.includes('found \"<b>bold</b>\"')")
        write(page, FLAT, {"<img src=x>.txt": b"\xff"})
        assert "<img src=x>.txt, 1 bytes" in page.evaluate("document.getElementById('chosen').textContent")
        page.click("#submit")
        page.wait_for(f"{NOTICE} === '<img src=x>.txt: expected UTF-8 text'")
        write(page, FLAT, {"short.yaml": files["short.yaml"]})
        page.click("#submit")
        page.wait_for(f"{NOTICE}.includes('files[0]: expected a file that is sent with the study, found by-hand.txt')")
        assert page.evaluate("document.querySelectorAll('main b, main img').length") == 0
        assert all("status of 422" in one for one in page.complaints)  # which browsers tell, too
        page.complaints.clear()

        # what was written survives a reload; files are chosen again
        page.open(f"{address}/new/study", width=width, dark=dark)
        assert page.evaluate("document.getElementById('text').value") == FLAT
        write(page, FLAT, files)
        page.evaluate("(() => { const button = document.getElementById('submit'); button.click(); button.click(); })()")
        page.wait_for("location.pathname.startsWith('/jobs/')")
        page.wait_for_load()
        (row, *_), _ = service.index.find(None)
        assert page.evaluate("location.pathname") == f"/jobs/{row.id}"
        assert (row.job.name, row.job.request.budget) == ("own files", OWN_TOTAL)
        assert service.store.request(row.id).files == {name: data.decode() for name, data in files.items()}
        assert page.evaluate("localStorage.length") == 0
        assert page.complaints == []
        assert [url for url in page.requests if not url.startswith((address, "data:"))] == []
