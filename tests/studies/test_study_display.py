"""The progress of a study: its rate and the time left, without real time."""

import re

import pytest

from mercator_design.cli.study.texts import StudyDisplay
from mercator_design.studies.layout import Cell
from mercator_design.studies.running import StudyProgress


@pytest.fixture
def clock():
    def now():
        return now.seconds

    now.seconds = 100.0
    return now


@pytest.fixture(params=["plain", "rich"])
def told(request, clock, capsys, monkeypatch):
    """What the display says after some experiments, of which `known` had run before."""
    monkeypatch.setenv("COLUMNS", "140")
    display = StudyDisplay("small", 0, request.param, clock=clock)

    def told(done, known=0):
        is_new = done > known
        cell = Cell("near", "halving", 40, done + 1)  # a line for each
        display.note(
            StudyProgress(
                cell=cell, number=1, n_cells=2, is_assessed=False, is_new=is_new, done=done, known=known, total=1000
            )
        )
        if request.param == "rich":
            display.show(done)
            display.line._progress.print(display.line._progress.get_renderable())
        return re.sub(r"\x1b\[[\d;?]*[a-zA-Z]", "", capsys.readouterr().err)

    return told


def test_nothing_is_said_of_the_time_left_before_there_is_a_base(told, clock):
    clock.seconds += 60.0  # in which code is compiled
    text = told(1)
    assert "/s" not in text
    assert not re.search(r"\d:\d\d:\d\d", text)
    clock.seconds += 0.001
    assert "/s" not in told(9)  # which have ended together
    clock.seconds += 0.999
    assert "/s" not in told(21)
    clock.seconds += 4.0
    text = told(51)
    assert "10/s" in text
    assert "0:01:35" in text  # 949 experiments at 10 a second


def test_what_had_run_before_is_no_base(told, clock):
    assert "/s" not in told(400, known=400)
    clock.seconds += 30.0
    assert "/s" not in told(401, known=400)
    clock.seconds += 10.0
    text = told(501, known=400)
    assert "10/s" in text
    assert "0:00:50" in text
