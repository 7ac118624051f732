"""Pictures of behaviour trees."""

import itertools
import re
from xml.etree import ElementTree as ET

import pytest

from mercator_design.show.machines.tree_diagram import tree_svg
from mercator_design.show.machines.tree_notations import tree_to_dot, tree_to_mermaid, tree_to_tikz
from mercator_design.tree.text import parse
from tests.tree.maple import DATA

TREE = parse(
    "--nroot 3 --nchildroot 2 --n0 0 --nchild0 2 --n00 6 --c00 0 --p00 0.5 --n01 5 --a01 0 --rwm01 5 --p01 0 "
    "--n1 4 --nchild1 1 --n10 5 --a10 1 --p10 0.25"
)
ALL = [each["tree"] for each in DATA["vectors"]]
SVG = "{http://www.w3.org/2000/svg}"


def boxes(svg):
    found = ET.fromstring(svg).iter(f"{SVG}rect")  # noqa: S314 - our own
    numbers = [
        [float(one.get(key)) for key in ("x", "y", "width", "height")] for one in found if one.get("class") == "box"
    ]
    frame = [float(each) for each in ET.fromstring(svg).get("viewBox").split()]  # noqa: S314
    return numbers, frame


@pytest.mark.parametrize("narrow", [False, True])
@pytest.mark.parametrize("text", ALL[::6], ids=range(len(ALL[::6])))
def test_boxes_are_in_the_picture_and_do_not_overlap(text, narrow):
    tree = parse(text)
    found, (left, top, width, height) = boxes(tree_svg(tree, narrow=narrow, caption=["a command"]))
    assert len(found) == len([*tree.preorder])
    for x, y, w, h in found:
        assert left <= x <= x + w <= left + width
        assert top <= y <= y + h <= top + height
    for (x, y, w, h), (other_x, other_y, other_w, other_h) in itertools.combinations(found, 2):
        assert x + w <= other_x or other_x + other_w <= x or y + h <= other_y or other_y + other_h <= y


def test_children_are_below_their_parent_from_left_to_right():
    found, _ = boxes(tree_svg(TREE))
    levels = [round(y, 1) for _, y, _, _ in found]
    assert levels[1] == levels[4] > levels[0]
    assert levels[2] == levels[3] == levels[5] > levels[1]
    assert found[1][0] < found[4][0]
    assert found[2][0] < found[3][0] < found[5][0]


def test_texts_and_numbers_of_nodes():
    svg = tree_svg(TREE, caption=["a < b"])
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", svg)
    assert texts == [
        "→* sequence*", "? selector", "black floor?", "beta 0.5 per cycle", "exploration", "tau 5 cycles", "¬ negation",
        "stop", "p 0.25 per cycle", "a &lt; b",
    ]  # fmt: skip
    assert set(re.findall(r'data-state="(\d+)"', svg)) == set("012345")


def test_dot():
    assert tree_to_dot(TREE).splitlines()[3:] == [
        '  n0 [shape=square; label="→*"];',
        '  n1 [shape=square; label="?"];',
        '  n2 [shape=ellipse; label="black floor?\\nbeta 0.5 per cycle"];',
        '  n3 [shape=box; label="exploration\\ntau 5 cycles"];',
        '  n4 [shape=square; label="¬"];',
        '  n5 [shape=box; label="stop\\np 0.25 per cycle"];',
        "  n0 -> n1;", "  n1 -> n2;", "  n1 -> n3;", "  n0 -> n4;", "  n4 -> n5;", "}",
    ]  # fmt: skip


def test_mermaid():
    assert tree_to_mermaid(TREE).splitlines() == [
        "flowchart TD",
        '  n0{{"→*"}}',
        '  n1{{"?"}}',
        '  n2(["black floor?<br>beta 0.5 per cycle"])',
        '  n3["exploration<br>tau 5 cycles"]',
        '  n4{{"¬"}}',
        '  n5["stop<br>p 0.25 per cycle"]',
        "  n0 --> n1", "  n1 --> n2", "  n1 --> n3", "  n0 --> n4", "  n4 --> n5",
    ]  # fmt: skip


@pytest.mark.parametrize("text", ALL[::10], ids=range(len(ALL[::10])))
def test_tikz_has_a_bracket_for_each_node(text):
    tree = parse(text)
    lines = tree_to_tikz(tree).splitlines()
    body = [line for line in lines if line.lstrip().startswith("[{")]
    assert len(body) == len([*tree.preorder])
    assert sum(line.count("[") - line.count("]") for line in body) == 0
