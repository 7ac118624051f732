"""Checks of pages by axe-core 4.14.1 (tests/data/axe.min.js, Mozilla Public License 2.0)."""

import json
from pathlib import Path

AXE = Path("tests/data/axe.min.js")
COLOUR_RULES = ("color-contrast", "link-in-text-block")
"""The rules of axe-core that are on by default and look at colours."""


def faults(page, *impacts, rules=()):
    """The faults of a page of these impacts: each with its name and where it is.

    Args:
        page: The page.
        impacts: Of the faults.
        rules: Those of axe-core that are checked; by default all.
    """
    if not page.evaluate("'axe' in window"):
        page.evaluate(AXE.read_text(encoding="utf-8") + "; true")
    options = {"resultTypes": ["violations"]} | ({"runOnly": rules} if rules else {})
    return page.evaluate(
        f"axe.run(document, {json.dumps(options)}).then((one) => one.violations"
        f".filter((each) => {list(impacts)!r}.includes(each.impact))"
        ".map((each) => `${each.id}: ${each.nodes.map((node) => node.target).join(' ')}`))"
    )


def serious_faults(page, **given):
    return faults(page, "serious", "critical", **given)
