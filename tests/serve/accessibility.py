"""Checks of pages by axe-core 4.14.1 (tests/data/axe.min.js, Mozilla Public License 2.0)."""

from pathlib import Path

AXE = Path("tests/data/axe.min.js")


def faults(page, *impacts):
    """The faults of a page of these impacts: each with its name and where it is."""
    page.evaluate(AXE.read_text(encoding="utf-8") + "; true")
    return page.evaluate(
        "axe.run(document, { resultTypes: ['violations'] }).then((one) => one.violations"
        f".filter((each) => {list(impacts)!r}.includes(each.impact))"
        ".map((each) => `${each.id}: ${each.nodes.map((node) => node.target).join(' ')}`))"
    )


def serious_faults(page):
    return faults(page, "serious", "critical")
