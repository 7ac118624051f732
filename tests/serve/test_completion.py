"""What may be written at a place of a mission's text, by a table of places, marked with a bar."""

import pytest

from mercator_design.config import shipped
from mercator_design.serve.workers.completion import completions
from tests.tiers import some

START = """schema: 1
robots: 3
arena:
  walls: {shape: regular_polygon, sides: 4, apothem: 1}
floor:
  zones:
    - name: nest
      shape: disc
    - name: left source
      color: red
"""
CASES = [
    # the text with the place, some words that are offered, some that are not
    ("|", {"schema", "robots", "arena", "objective", "name"}, {"radius"}),
    (START + "|", {"placement", "objective", "lights", "duration"}, {"robots", "arena", "floor"}),
    (START + "pla|", {"placement"}, {"robots"}),
    ("arena:\n  |\nrobots: 3\n", {"walls", "wall_height", "obstacles", "room"}, {"robots", "schema"}),
    ("arena:\n  walls:\n    |\n", {"shape"}, {"walls"}),
    ("arena:\n  walls:\n    |\n    sides: 4\n    shape: regular_polygon\n", {"apothem"}, {"sides", "vertices"}),
    ("arena:\n  walls:\n    shape: |\n", {"regular_polygon", "polygon"}, {"disc"}),
    ("arena: {walls: {shape: polygon, |}}", {"vertices"}, {"sides", "shape"}),
    (START + "    - |", {"shape", "name", "color"}, {"walls"}),
    (START + "    - shape: ri|\n      color: red", {"ring", "rectangle", "tiles"}, {"poses"}),
    (START + "    - {shape: tiles, |}", {"centers", "colors", "size"}, {"radius", "color"}),
    (START + "    - {shape: disc, color: |}", {"black", "orange", "[0, 0, 0]"}, set()),
    (START + "    - {shape: tiles, colors: {re|}}", {"red", "cyan"}, {"radius"}),
    (START + "  background: |", {"gray", "[0, 0, 0]"}, {"mercator"}),
    (START + "  dynamics:\n    - name: |", {"schedule", "drawn_colors", "visited"}, {"trips"}),
    (START + "  dynamics:\n    - name: schedule\n      |", {"zones", "times", "colors"}, {"color", "name"}),
    (START + "  dynamics:\n    - name: schedule\n      zones: [|]", {"nest", "left source"}, {"red"}),
    (START + "robot_model: |", set(shipped.robot_models()), {"foraging"}),
    (START + "placement:\n  shape: |", {"disc", "rectangle", "one_of", "poses"}, {"ring"}),
    (START + "placement:\n  shape: disc\n  heading: |", {"uniform"}, set()),
    (START + "placement:\n  shape: disc\n  |\n  radius: 1", {"center", "uniform_in"}, {"radius", "size"}),
    (START + "objective:\n  name: |", {"trips", "robots_in_zone"}, {"schedule"}),
    (START + "objective:\n  |", {"name", "direction"}, {"sources"}),
    (START + "objective:\n  name: trips\n  |\n  nests: [nest]", {"sources", "direction"}, {"nests", "zones"}),
    (START + "objective:\n  name: trips\n  sources: |", {"[nest]", "[left source]"}, {"nest"}),
    (START + "objective:\n  name: trips\n  sources: [nest, le|]", {"left source"}, set()),
    (START + "objective:\n  name: trips\n  sources:\n    - |", {"nest", "left source"}, set()),
    (START + "objective:\n  name: trips\n  values: {|}", {"nest", "left source"}, {"red"}),
    (START + "objective:\n  name: zone_value\n  values:\n    |", {"nest", "left source"}, {"red"}),
    (START + "objective:\n  direction: |", {"maximise", "minimise"}, {"nest"}),
    (START + "objective:\n  name: robots_where_told\n  places: {black: |}", {"nest", "left source"}, {"black"}),
    (START + "lights:\n  - position: [0, 0, 1]\n    kind: |", {"lamp", "beacon", "null"}, set()),
    ("floor:\n  background: gray\n  |\n# a comment\nrobots: [unfinished\n", {"zones", "image"}, {"background"}),
    ("# robo|", set(), {"robots"}),
    ("description: 'it is |", set(), {"robots"}),
    ("robots: [\n", set(), {"robots"}),
    ("unknown:\n  deeper:\n    |", set(), {"robots"}),
]  # fmt: skip


def at_bar(text):
    """The completions at the bar in a text."""
    before, _, after = text.partition("|")
    return completions(before + after, before.count("\n") + 1, len(before) - before.rfind("\n"))


@pytest.mark.parametrize(("text", "some", "none"), CASES)
def test_what_is_offered(text, some, none):
    labels = [one.label for one in at_bar(text).options]
    assert some <= {*labels}
    assert not none & {*labels}
    assert len({*labels}) == len(labels)


def test_a_key_has_its_type_its_default_and_its_description():
    found = {one.label: one for one in at_bar(START + "|").options}
    assert found["control_period"].detail == "a number >= 0.001 and <= 10; default 0.1"
    assert found["control_period"].info == "[s] from one control cycle to the next"
    assert found["duration"].is_required
    assert not found["control_period"].is_required
    assert (found["placement"].insert, found["lights"].insert) == ("placement:\n  ", "lights:\n  - ")


def test_an_objective_and_a_shape_are_described():
    found = {one.label: one.info for one in at_bar(START + "objective:\n  name: |").options}
    assert all(found.values())
    found = {one.label: one.info for one in at_bar(START + "    - shape: |").options}
    assert found["ring"].startswith("The points at least `inner_radius`")


def test_the_word_that_is_begun_is_replaced():
    assert at_bar("robots: 3\ncontrol_pe|").column == 1
    assert at_bar(START + "objective:\n  name: trips\n  sources: [nest, left so|]").column == 19


def test_a_list_that_begins_gets_its_dash():
    found = {one.label: one.insert for one in at_bar(START + "objective:\n  name: trips\n  sources:\n    |").options}
    assert found["left source"] == "- left source"


@pytest.mark.parametrize(("line", "column"), [(1, 500), (10, 1), (10**6, 10**6)])
def test_a_place_behind_the_text_has_no_completions(line, column):
    assert completions("robots: 3\n", line, column).options == ()


@pytest.mark.swept
@pytest.mark.parametrize("name", some(shipped.missions(), 2))
def test_no_place_of_a_shipped_mission_fails(name):
    text = shipped.missions()[name].read_text()
    for number, line in enumerate(text.splitlines(), start=1):
        for column in {0, len(line) - len(line.lstrip()), len(line)}:
            completions(text, number, column + 1)
            completions(text[: text.find(line) + column], number, column + 1)
