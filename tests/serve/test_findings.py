"""Messages on a mission find their places in its text."""

import pytest

from mercator_design.config import shipped
from mercator_design.config.yaml_tree import MAX_DEPTH, MAX_FILE_SIZE
from mercator_design.errors import MissionError
from mercator_design.missions.mission import parse_mission
from mercator_design.serve.workers.findings import findings, without_folders
from mercator_design.serve.workers.outline import Outline

TEXT = shipped.missions()["foraging"].read_text()
MISTAKES = [
    # written, instead of; path of the mistake, what is marked
    ("robots: 3", "robtos: 3", "robtos", "robtos"),
    ("robots: 3", "robots: 0", "robots", "0"),
    ("shape: half_plane", "shape: half_plan", "floor.zones[0].shape", "half_plan"),
    ("point: [0, -0.6]", "point: [0, low]", "floor.zones[0].point[1]", "low"),
    ("nests: [nest]", "nests: [nets]", "objective.nests[0]", "nets"),
    ("  sides: 12\n", "  sides: twelve\n", "arena.walls.sides", "twelve"),
    ("    sides: 12\n", "", "arena.walls.sides", "walls"),  # missing: marked is where
    ("name: left source", "name: 'left \U0001f916 source'", "floor.zones[1].name", "'left \U0001f916 source'"),
]


def found_in(text):
    with pytest.raises(MissionError) as error:
        parse_mission(text, name="mission.yaml", files=False)
    return findings(error.value.messages, "mission.yaml", text)


@pytest.mark.parametrize(("right", "wrong", "path", "marked"), MISTAKES)
def test_a_mistake_is_marked(right, wrong, path, marked):
    text = TEXT.replace(right, wrong, 1)
    found = next(one for one in found_in(text) if one.path == path)
    line = text.split("\n")[found.line - 1]
    assert found.line == found.end_line
    assert line[found.column - 1 : found.end_column - 1] == marked
    assert "mission.yaml" not in found.message


def test_a_violation_of_yaml_has_its_column():
    (found,) = found_in("robots: 3\narena: ]\n")
    assert (found.line, found.column, found.path) == (2, 8, "")


def test_a_message_without_a_place_stays():
    (found,) = findings(["budget: expected more: 7"], "mission.yaml", TEXT)
    assert (found.message, found.path, found.line) == ("budget: expected more: 7", "", None)
    (found,) = findings(["--set robots=0: robots: expected more"], "mission.yaml", TEXT)
    assert found.message == "--set robots=0: robots: expected more"
    (found,) = findings(["the robots do not fit: 3 of 4"], "mission.yaml", TEXT)
    assert (found.message, found.path) == ("the robots do not fit: 3 of 4", "")


def test_folders_of_the_program_are_not_named():
    file = shipped.robot_models()["mercator"]
    assert without_folders(f"{file}:3: ground.labels: x") == "mercator.yaml:3: ground.labels: x"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "\0",
        "\ufeff",
        "[" * MAX_FILE_SIZE,
        "{" * 100,
        "- " * 5000,
        "a: &b [*b, *b]",
        "x" * (MAX_FILE_SIZE + 9),
        "? : ?",
    ],
)
def test_an_outline_of_anything_ends(text):
    def depth(piece):
        return 1 + max((depth(part) for _, part in piece.parts()), default=0)

    root = Outline.of(text).root
    assert root is None or depth(root) <= MAX_DEPTH + 2
