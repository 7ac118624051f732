"""Every page of the service, checked by axe-core; test_visit.py checks them with results."""

import shutil

import pytest

from tests.serve.accessibility import COLOUR_RULES, serious_faults
from tests.show.browser import CHROMIUM

pytestmark = [pytest.mark.together("browser"), pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")]

PAGES = {
    "/": "document.querySelector('table.jobs')",
    "/new": "!document.getElementById('picture').hidden",
    "/new/study": "true",
    "/fsm": "document.querySelector('#diagram button')",
    "/compare": "true",
    "/gallery": "document.querySelector('.diagram svg')",
    "/jobs/before": "document.querySelector('#answer svg') && document.querySelector('#about section')",
    "/login": "true",
}
"""Each with what is true when all of it is there."""


@pytest.fixture(scope="module")
def raced_before(service, raced):
    shutil.copytree(raced, service.data / "before")
    service.supervisor.reconcile()


@pytest.mark.usefixtures("raced_before")
@pytest.mark.parametrize("width", [1200, 375])
@pytest.mark.parametrize("path", PAGES)
def test_no_serious_fault_and_room_on_a_phone(page, address, path, width):
    page.open(address + path, width=width)
    page.wait_for(PAGES[path])
    page.wait_for("!document.querySelector('.htmx-request, [aria-busy=true]')")
    assert page.evaluate("[...document.querySelectorAll('.scroll')].every((one) => one.tabIndex === 0)")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert serious_faults(page) == []
    if width == 1200:
        page.like_dark()
        assert page.evaluate("matchMedia('(prefers-color-scheme: dark)').matches")
        assert serious_faults(page, rules=COLOUR_RULES) == []


def test_a_fault_is_found(page, address):
    page.open(f"{address}/login")
    page.evaluate("document.querySelector('main').append(document.createElement('select')); true")
    assert [fault.partition(":")[0] for fault in serious_faults(page)] == ["select-name"]


def test_a_fault_of_dark_colours_is_found(page, address):
    page.open(f"{address}/login")
    page.evaluate("document.querySelector('main').insertAdjacentHTML('beforeend', '<p style=\"color: #222\">Dim</p>')")
    assert serious_faults(page, rules=COLOUR_RULES) == []
    page.like_dark()
    assert [fault.partition(":")[0] for fault in serious_faults(page, rules=COLOUR_RULES)] == ["color-contrast"]
