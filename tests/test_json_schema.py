"""The JSON Schema says of a file what the loader says, as far as a schema can."""

import dataclasses
import json
import re
from collections.abc import Mapping
from typing import Annotated, Literal, NamedTuple, get_args

import pytest
import yaml
from jsonschema import Draft202012Validator

from mercator_design.config import shipped, yaml_tree
from mercator_design.config.json_schema import json_schema
from mercator_design.config.loading import parse
from mercator_design.config.schema import KeywordsOf, Length, fields_of, is_record, is_union, tags, unwrapped
from mercator_design.config.writing import dump
from mercator_design.errors import MissionError
from mercator_design.missions.mission import Mission, load_mission, parse_mission
from mercator_design.missions.objectives import OBJECTIVES
from mercator_design.sim.robot_model import RobotModel, load_robot_model
from tests.tiers import some

MISSION = json_schema(Mission, title="Mission", given=("name",))
ROBOT_MODEL = json_schema(RobotModel, title="Robot model", given=("name",), based=True)
GOOD = """
schema: 1
robots: 2
duration: 10
arena:
  walls: {shape: polygon, vertices: [[-1, -1], [1, -1], [0, 2]]}
  obstacles: [{center: [0, 0], size: [0.1, 0.1]}]
floor:
  background: [1, 2, 3]
  zones:
    - {name: a, shape: disc, center: [0, 0], radius: 1, color: red}
    - {shape: tiles, size: 0.3, centers: [[0, 0], [1, 0]], colors: {red: 1, blue: 1}}
lights: [{position: [0, 0, 1], intensity: 2}]
placement: {shape: rectangle, size: [1, 1], heading: uniform}
objective: {name: color_value, values: {red: 1}, direction: maximise}
"""


def accepts(schema, text):
    return Draft202012Validator(schema).is_valid(yaml.load(text, Loader=yaml_tree.LOADER))  # noqa: S506 - a safe loader, and quick


def test_they_are_schemas():
    Draft202012Validator.check_schema(json.loads(json.dumps(MISSION, allow_nan=False)))
    Draft202012Validator.check_schema(json.loads(json.dumps(ROBOT_MODEL, allow_nan=False)))


@pytest.mark.swept
@pytest.mark.parametrize("name", some(shipped.missions(), 8))
def test_shipped_missions_fit_as_written_and_with_every_default(name):
    assert accepts(MISSION, shipped.missions()[name].read_text())
    assert accepts(MISSION, dump(load_mission(name)))


@pytest.mark.parametrize("name", shipped.robot_models())
def test_shipped_robot_models_fit(name):
    assert accepts(ROBOT_MODEL, shipped.robot_models()[name].read_text())
    assert not accepts(MISSION, shipped.robot_models()[name].read_text())


def test_a_good_mission():
    assert parse_mission(GOOD).robots == 2
    assert accepts(MISSION, GOOD)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("robots: 2", "robbots: 2"),
        ("robots: 2", "robots: 0"),
        ("robots: 2", "robots: 1001"),
        ("robots: 2", "robots: 2.5"),
        ("robots: 2", "robots: two"),
        ("robots: 2", "robots: null"),
        ("robots: 2", ""),
        ("schema: 1", "schema: 2"),
        ("duration: 10", "duration: 0"),
        ("duration: 10", "duration: 100000"),
        ("duration: 10", "duration: [10]"),
        ("schema: 1", "schema: 1\nname: ../../etc"),
        ("schema: 1", "schema: 1\ncontrol_period: 0.0001"),
        ("shape: polygon, ", ""),
        ("shape: polygon", "shape: disc"),
        ("[[-1, -1], [1, -1], [0, 2]]", "[[-1, -1], [1, -1]]"),
        ("[0, 2]", "[0, 2, 1]"),
        ("[0, 2]", "[0]"),
        ("[0, 2]", "[0, 2000]"),
        ("size: [0.1, 0.1]", "size: [0.1, 0.0]"),
        ("[1, 2, 3]", "[1, 2, 256]"),
        ("[1, 2, 3]", "blak"),
        ("shape: disc", "shape: disk"),
        ("radius: 1", "raduis: 1"),
        ("{red: 1, blue: 1}", "{red: 1, bleu: 1}"),
        ("{red: 1, blue: 1}", "{red: 1, blue: one}"),
        ("position: [0, 0, 1]", "position: [0, 0]"),
        ("intensity: 2", "intensity: -2"),
        ("heading: uniform", "heading: sideways"),
        ("name: color_value", "name: colr_value"),
        ("name: color_value, ", ""),
        ("values: {red: 1}", "values: {}"),
        ("values: {red: 1}", "values: {red: 1}, zones: [a]"),
        ("values: {red: 1}", "values: {red: 1}, when: never"),
        ("values: {red: 1}, ", ""),
        ("direction: maximise", "direction: up"),
    ],
)
def test_a_mistake_is_refused_by_both(old, new):
    assert old in GOOD
    broken = GOOD.replace(old, new, 1)
    with pytest.raises(MissionError):
        parse_mission(broken)
    assert not accepts(MISSION, broken)


@pytest.mark.parametrize(
    ("text", "valid"),
    [
        ("{schema: 1, base: mercator}", True),
        ("{schema: 1, base: epuck, drive: {noise: {sd: 0.1}}, physics: {time_step: 0.02}}", True),
        ("{schema: 1, base: mercator, drive: {nose: {sd: 0.1}}}", False),
        ("{schema: 1, base: mercator, drive: {noise: {sd: -0.1}}}", False),
        ("{schema: 1, base: mercator, body: {mass: heavy}}", False),
        ("{schema: 1, body: {mass: 2.0}}", False),
        ("{schema: 1, base: 7}", False),
    ],
)
def test_a_robot_model_on_a_base(tmp_path, text, valid):
    assert accepts(ROBOT_MODEL, text) is valid
    (tmp_path / "robot.yaml").write_text(text)
    if valid:
        load_robot_model(str(tmp_path / "robot.yaml"))
    else:
        with pytest.raises(MissionError):
            load_robot_model(str(tmp_path / "robot.yaml"))


def test_every_objective_has_its_alternative():
    alternatives = MISSION["$defs"]["Objective"]["oneOf"]
    assert [each["properties"]["name"]["const"] for each in alternatives] == list(OBJECTIVES)
    assert all(each["description"] for each in alternatives)


def test_what_an_editor_shows():
    robots, apothem = MISSION["properties"]["robots"], MISSION["$defs"]["RegularPolygon"]["properties"]["apothem"]
    assert (robots["minimum"], robots["maximum"]) == (1, 1000)
    assert apothem["description"] == "[m] from the centre to the inner face of a wall"
    assert MISSION["properties"]["control_period"]["default"] == 0.1
    assert "name" not in MISSION["required"]


def properties(schema):
    """Name and schema of every key of a file, wherever in it."""
    if isinstance(schema, list):
        for item in schema:
            yield from properties(item)
    elif isinstance(schema, dict):
        yield from schema.get("properties", {}).items()
        for part in schema.values():
            yield from properties(part)


@pytest.mark.parametrize("schema", [MISSION, ROBOT_MODEL])
def test_descriptions_are_read_without_the_source(schema):
    for name, found in properties(schema):
        description = found.get("description", "")
        assert not re.match(r"\.\.\.|\[[^]]*]$", description), (name, description)
        assert not re.search(r"\.\.\.$|\bNone\b|\bthe same\b", description), (name, description)


@pytest.mark.parametrize("schema", [MISSION, ROBOT_MODEL])
def test_every_key_has_its_description(schema):
    found = list(properties(schema))
    assert len(found) > 100
    assert [name for name, each in found if len(each.get("description", "")) < 5] == []


def test_descriptions_are_comments_or_else_docstrings():
    disc, robot = MISSION["$defs"]["Disc"], ROBOT_MODEL["else"]
    assert (
        disc["properties"]["shape"]["description"]
        == disc["description"]
        == "The points at most `radius` from `center`."
    )
    assert robot["properties"]["leds"]["description"] == "Lamps that show the state, unless modules set them."
    (trips,) = (
        each for each in MISSION["$defs"]["Objective"]["oneOf"] if each["properties"]["name"].get("const") == "trips"
    )
    assert trips["properties"]["name"]["description"] == trips["description"]
    assert trips["properties"]["nests"]["description"] == "zones where it puts it down"
    assert trips["properties"]["direction"]["description"] == "whether a higher or a lower score is better"


def kinds_within(kind):
    """An annotation and all those it is made of."""
    base, _ = unwrapped(kind)
    yield base
    parts = [each for each, _ in fields_of(base).values()] if is_record(base) else get_args(base)
    for part in parts:
        yield from kinds_within(part)


def test_a_base_knows_every_key_that_tells_alternatives_apart():
    found = set()
    for kind in kinds_within(RobotModel):
        records = [each for each in get_args(kind) if is_record(each)] if is_union(kind) else []
        found |= {tags(records)[0]} if len(records) > 1 else set()
    assert found == set(yaml_tree._TAGS)


class Mood(NamedTuple):
    calm: bool
    depth: float = 0.5


def walk(*, steps: int):
    pass


def rest(*, mood: Mood | None = None):
    pass


@dataclasses.dataclass(frozen=True, kw_only=True)
class Task:
    weights: Annotated[Annotated[Mapping[Literal["a", "b"], float], Length(1)], Length(0, 1)]
    pair: tuple[str, int]
    do: str
    how: Annotated[Mapping[str, object], KeywordsOf({"walk": walk, "rest": rest}, "do")]


@pytest.mark.parametrize(
    ("text", "valid"),
    [
        ("{weights: {a: 1}, pair: [x, 1], do: walk, steps: 3}", True),
        ("{weights: {a: 1}, pair: [x, 1], do: rest}", True),
        ("{weights: {a: 1}, pair: [x, 1], do: rest, mood: {calm: true}}", True),
        ("{weights: {a: 1}, pair: [x, 1], do: rest, mood: null}", True),
        ("{weights: {a: 1}, pair: [x, 1], do: rest, mood: {depth: 1}}", False),
        ("{weights: {a: 1}, pair: [x, 1], do: rest, mood: {calm: 1}}", False),
        ("{weights: {a: 1}, pair: [x, 1], do: walk, mood: null}", False),
        ("{weights: {a: 1}, pair: [x, 1], do: walk}", False),
        ("{weights: {a: 1}, pair: [x, y], do: rest}", False),
        ("{weights: {a: 1}, pair: [x, 1, 2], do: rest}", False),
        ("{weights: {a: 1, b: 2}, pair: [x, 1], do: rest}", False),
        ("{weights: {}, pair: [x, 1], do: rest}", False),
        ("{weights: {c: 1}, pair: [x, 1], do: rest}", False),
        ("{weights: {a: 1}, pair: [x, 1], do: sleep}", False),
    ],
)
def test_kinds_that_missions_do_not_have_yet(text, valid):
    schema = json_schema(Task, title="Task")
    Draft202012Validator.check_schema(schema)
    assert accepts(schema, text) is valid
    if valid:
        parse(text, Task, error=MissionError)
    else:
        with pytest.raises(MissionError):
            parse(text, Task, error=MissionError)
