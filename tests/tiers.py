"""The two tiers of tests: by default those that a developer waits for, and by `-m thorough` all others.

Tests of the thorough tier have the mark `thorough`. Those with the mark `timing` and those in a browser get it here.
Tests with the mark `swept`, and those with hypothesis, are in both tiers: in the first one with few cases. A test that
is named (`file.py::test`) runs in any case, with as many cases as in the thorough tier.
"""

import os
import re

import pytest
from hypothesis import is_hypothesis_test, settings

from mercator_design.race.executors.executor import available_jobs

FIRST = "not thorough"
"""Marks of the first tier, as in pyproject.toml."""

EFFORT = float(os.environ.get("TEST_EFFORT", "1"))
"""Factor of the number of random cases in the thorough tier, and of the time that the twin soaks.

From 10 on, tests that take minutes run too. 100 takes hours.
"""

# A first example may compile a kernel, so its time says nothing.
settings.register_profile("first", deadline=None, max_examples=10)
settings.register_profile("thorough", deadline=None, max_examples=round(100 * EFFORT))

_is_first = False
_left_out = pytest.StashKey[int]()


takes_long = pytest.mark.skipif(EFFORT < 10, reason="takes minutes: TEST_EFFORT=10 runs it")


def cases(number):
    """So many random cases in the thorough tier, or more with a higher effort."""
    return range(round(number * EFFORT))


def some(values, number):
    """All of these values, for a test with the mark `swept`; in the first tier so many of them, evenly spread."""
    values = list(values)
    if not _is_first or number >= len(values):
        return values
    return [values[k * (len(values) - 1) // max(number - 1, 1)] for k in range(number)]


def pytest_configure(config):
    config.stash[_left_out] = 0
    if config.option.markexpr == FIRST and any("::" in str(argument) for argument in config.args):
        config.option.markexpr = ""
    global _is_first  # noqa: PLW0603 - before test modules are imported
    _is_first = config.option.markexpr == FIRST
    if not config.getoption("--hypothesis-profile"):
        settings.load_profile("first" if _is_first else "thorough")


def pytest_xdist_auto_num_workers(config):
    """Two more than processors in the thorough tier: tests in real time mostly wait, others for programs they start."""
    return available_jobs() + (0 if config.option.markexpr == FIRST else 2)


@pytest.hookimpl(tryfirst=True)  # before pytest selects by marks
def pytest_collection_modifyitems(config, items):
    wanted = re.search(r"(?<!not )\bthorough\b", config.option.markexpr)
    for item in items:
        is_swept = item.get_closest_marker("swept") or is_hypothesis_test(getattr(item, "obj", None))
        if (
            (wanted and is_swept)
            or item.get_closest_marker("timing")
            or "chromium" in getattr(item, "fixturenames", ())
        ):
            item.add_marker(pytest.mark.thorough)


@pytest.hookimpl(trylast=True)
def pytest_deselected(items):
    for item in items:
        item.config.stash[_left_out] += bool(item.get_closest_marker("thorough"))


def pytest_sessionfinish(session):
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["left_out"] = session.config.stash[_left_out]


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node):
    node.config.stash[_left_out] = getattr(node, "workeroutput", {}).get("left_out", 0)


def pytest_terminal_summary(terminalreporter, config):
    if left_out := config.stash[_left_out]:
        terminalreporter.write_line(f"{left_out} thorough tests were left out: `pytest -m thorough` runs them")
