"""Every page of the service, checked by axe-core 4.14.1 (tests/data/axe.min.js, Mozilla Public License 2.0)."""

import shutil
from pathlib import Path

import pytest

from tests.view.browser import CHROMIUM

pytestmark = [pytest.mark.together, pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")]

AXE = Path("tests/data/axe.min.js")
PAGES = ("/", "/new", "/fsm", "/compare", "/gallery", "/jobs/before", "/login")
LOOKS = {"light": {}, "dark": {"dark": True}, "phone": {"width": 375}}


@pytest.fixture(scope="module")
def raced_before(service, raced):
    shutil.copytree(raced, service.data / "before")
    service.supervisor.reconcile()


@pytest.mark.usefixtures("raced_before")
@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize("path", PAGES)
def test_no_serious_fault_and_room_on_a_phone(page, address, path, look):
    page.open(address + path, **LOOKS[look])
    page.wait_for("!document.querySelector('.htmx-request, [aria-busy=true]')")
    assert look != "phone" or page.evaluate("document.documentElement.scrollWidth") <= 375
    page.evaluate(AXE.read_text(encoding="utf-8") + "; true")
    found = page.evaluate(
        "axe.run(document, { resultTypes: ['violations'] }).then((one) => one.violations"
        ".filter((each) => ['serious', 'critical'].includes(each.impact))"
        ".map((each) => `${each.id}: ${each.nodes.map((node) => node.target).join(' ')}`))"
    )
    assert found == []


def test_a_fault_is_found(page, address):
    page.open(f"{address}/login")
    page.evaluate("document.querySelector('main').append(document.createElement('select')); true")
    page.evaluate(AXE.read_text(encoding="utf-8") + "; true")
    found = page.evaluate("axe.run(document).then((one) => one.violations.map((each) => each.id))")
    assert "select-name" in found
