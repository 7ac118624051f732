"""Charts: their marks are where their values are, their ticks are round, and names of others appear as text."""

import math
import re
from xml.etree import ElementTree as ET

import pytest

from mercator_design.show.charts import (
    COLOURS,
    Axis,
    Bars,
    ChartLine,
    Dot,
    Thread,
    bar_chart,
    heat_map,
    interval_chart,
    line_chart,
    number,
    parallel_chart,
    ticks,
    viridis,
)
from mercator_design.show.pictures.figures import save_curves

NASTY = "<script>alert(1)</script>\u202e\x1b[31m" + "x" * 10_000
CHARTS = {
    "lines": lambda name: line_chart(
        [ChartLine(name, [0, 1, 2], [3, 5, 4], [2, 4, 3], [4, 6, 5]), ChartLine("other", [0], [1])],
        Axis(name),
        Axis(name, name),
    ),
    "bars": lambda name: bar_chart([name, "b"], [Bars(name, [1, 2]), Bars("other", [3, 4])], Axis(name), Axis(name)),
    "dots": lambda name: interval_chart([Dot(name, 2, 1, 3, [1, 2, 3], "p = 1")], Axis(name)),
    "cells": lambda name: heat_map([[1, math.nan], [3, 4]], [name, "b"], ["0", name], Axis(name), Axis(name)),
    "threads": lambda name: parallel_chart(
        [Axis(name), Axis("k", categories=(name, "b"))],
        [Thread(name, [1, 0], 0), Thread("b", [math.nan, 1], 1, is_bold=True)],
        Axis(name, low=1, high=2),
    ),
}


def marks(svg, attribute):
    """The elements with an attribute, and all their attributes."""
    return [one.attrib for one in ET.fromstring(svg).iter() if attribute in one.attrib]  # noqa: S314 - our own


@pytest.mark.parametrize("draw", CHARTS.values(), ids=CHARTS)
class TestAll:
    def test_names_appear_as_text_and_labels_are_short(self, draw):
        svg = draw(NASTY)
        root = ET.fromstring(svg)  # noqa: S314 - our own
        kinds = {one.tag.rpartition("}")[2] for one in root.iter()}
        assert kinds <= {"svg", "g", "path", "rect", "circle", "text", "title"}
        assert not any(mark in svg for mark in ("<script", "\u202e", "\x1b"))
        shown = [one.text or "" for one in root.iter() if one.tag.endswith("text")]
        assert max(map(len, shown)) <= 60
        assert any("<script>" in text for text in shown)

    def test_nothing_is_outside(self, draw):
        svg = draw("name")
        width, height = map(float, re.search(r'viewBox="0 0 (\d+) (\d+)"', svg).groups())
        places = re.findall(
            r'c?x="([-\d.]+)" c?y="([-\d.]+)"|translate\(([-\d.]+) ([-\d.]+)\)|M([-\d.]+) ([-\d.]+)', svg
        )
        for place in places:
            x, y = (float(value) for value in place if value)
            assert 0 <= x <= width
            assert 0 <= y <= height


def test_points_are_where_their_values_are():
    points = marks(CHARTS["lines"]("name"), "data-y")
    assert [(float(one["data-x"]), float(one["data-y"])) for one in points] == [(0, 3), (1, 5), (2, 4), (0, 1)]
    x, y = ([float(one[key]) for one in points] for key in ("cx", "cy"))
    assert x[2] - x[1] == pytest.approx(x[1] - x[0], abs=0.1)
    assert (y[0] - y[1]) / (y[2] - y[1]) == pytest.approx(2, abs=0.01)
    assert y[3] > y[0]


def test_bars_are_stacked():
    bars = marks(CHARTS["bars"]("name"), "data-value")
    height = {(one["data-name"], one["data-value"]): float(one["height"]) for one in bars}
    assert height["b", "4"] == pytest.approx(4 * height["name", "1"], rel=0.01)
    tops = [float(one["y"]) for one in bars]
    assert float(bars[0]["y"]) == pytest.approx(tops[2] + float(bars[2]["height"]), abs=0.1)


def test_cells_that_have_no_value_are_left_out():
    assert [one["data-value"] for one in marks(CHARTS["cells"]("name"), "data-value")] == ["1", "3", "4"]


@pytest.mark.parametrize(("low", "high"), [(0, 1), (-3.2, 17), (1e-9, 3e-9), (5, 5), (0, 1e12)])
def test_ticks_are_few_round_and_inside(low, high):
    found = ticks(low, high)
    assert 1 <= len(found) <= 6
    assert all(low - 1e-9 <= one <= max(high, low + 1) for one in found)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (361523.4, "361500"),
        (15000, "15000"),
        (0.0, "0"),
        (-0.0, "0"),
        (-0.12345, "-0.1235"),
        (1e9, "1e+09"),
        (2e-5, "2e-05"),
    ],
)
def test_numbers_are_plain(value, text):
    assert number(value) == text


def test_whole_ticks_and_the_scale():
    assert ticks(1, 3, whole=True) == [1, 2, 3]
    assert [viridis(share) for share in (-1, 0, 1, 2)] == ["#440154", "#440154", "#fde725", "#fde725"]


def test_lines_of_a_group_have_one_colour(tmp_path):
    lines = [ChartLine(name, [0, 1], [k, k + 1], [k, k], [k + 1, k + 2]) for k, name in enumerate("abc")]
    lines.append(ChartLine("d", [0.5], [2], [1], [3]))
    save_curves(
        tmp_path / "x.svg", lines, Axis("x"), Axis("y"), title="t", caption="c", groups=["one", "two", "one", "two"]
    )
    drawn = (tmp_path / "x.svg").read_text()
    assert COLOURS[0] in drawn
    assert COLOURS[1] in drawn
    assert COLOURS[2] not in drawn
