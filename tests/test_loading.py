"""YAML to dataclass and back: what is accepted, what each error says, and that no file can do harm."""

import json
import math
import os
import pickle
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.config import spelling, yaml_tree
from mercator_design.config.loading import parse, read
from mercator_design.config.schema import (
    FieldError,
    FilePath,
    KeywordsOf,
    Length,
    Name,
    Positive,
    Range,
    check,
    describe,
)
from mercator_design.config.writing import dump
from mercator_design.config.yaml_tree import MAX_FILE_SIZE, MAX_MISTAKES, steps
from mercator_design.errors import MissionError
from tests.processes import LIMIT
from tests.tiers import some


@dataclass(frozen=True, slots=True, kw_only=True)
class Round:
    shape: Literal["round"] = "round"
    radius: Positive
    name: Name | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Square:
    shape: Literal["square"] = "square"
    size: tuple[float, float]
    turn: float | Literal["free"] = "free"

    def __post_init__(self):
        if self.size[0] < self.size[1]:
            raise FieldError("size[1]", "expected no more than the first")


def grow(start: float, *, rate: Annotated[float, Range(0, 1)], steps: int = 3) -> float:
    return start * (1 + rate) ** steps


def shrink(start: float, *, factors: Annotated[tuple[float, ...], Length(1)]) -> float:
    return start * math.prod(factors)


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    name: str
    sign: Literal["plus", "minus"] = "plus"
    arguments: Annotated[Mapping[str, Any], KeywordsOf({"grow": grow, "shrink": shrink}, "name")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Thing:
    version: Literal[1] = 1
    count: Annotated[int, Range(1, 1000)] = 1
    weight: float = 0.0
    heavy: bool = False
    label: str = ""
    note: str | None = None
    zones: tuple[Round | Square, ...] = ()
    color: Literal["red", "on"] | tuple[int, int, int] = "red"
    values: Mapping[str, float] | None = None
    law: Law | None = None
    file: Annotated[str, FilePath()] | None = None


def thing(text, *overrides, **options):
    return parse(text, Thing, error=MissionError, label="a.yaml", overrides=overrides, **options)


def complaint(text, *overrides):
    with pytest.raises(MissionError) as caught:
        thing(text, *overrides)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "field", "value"),
    [
        ("weight: 1e3", "weight", 1000.0),
        ("weight: 3", "weight", 3.0),
        ("weight: -.5", "weight", -0.5),
        ("count: 010", "count", 10),
        ("label: 1e3", "label", "1e3"),
        ("label: no", "label", "no"),
        ("label: 'null'", "label", "null"),
        ("label: ''", "label", ""),
        ("note: null", "note", None),
        ("note: ~", "note", None),
        ("note:", "note", None),
        ("note: 'null'", "note", "null"),
        ("heavy: true", "heavy", True),
        ("color: on", "color", "on"),
        ("color: [1, 2, 3]", "color", (1, 2, 3)),
        ("values: {on: 1, 1: 2}", "values", {"on": 1.0, "1": 2.0}),
        ("zones: [{shape: round, radius: 2}]", "zones", (Round(radius=2.0),)),
        ("zones: [{shape: square, size: [2, 1], turn: 1}]", "zones", (Square(size=(2.0, 1.0), turn=1.0),)),
        ("law: {name: grow, rate: 1}", "law", Law(name="grow", arguments={"rate": 1.0, "steps": 3})),
        ("law: {factors: [1], name: shrink}", "law", Law(name="shrink", arguments={"factors": (1.0,)})),
        ("{weight: 2}", "weight", 2.0),
        ("\ufeffweight: 2", "weight", 2.0),
        ("%YAML 1.1\n---\nweight: 2\n...\n", "weight", 2.0),
    ],
)
def test_a_value_is_read_as_what_is_expected(text, field, value):
    found = getattr(thing(text), field)
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("wieght: 1", "a.yaml:1: wieght: unknown key; did you mean 'weight'?"),
        (
            "\n\nzzz: 1",
            "a.yaml:3: zzz: unknown key; known: version, count, weight, heavy, label, note, zones, ",
        ),
        ("weight: abc", 'a.yaml:1: weight: expected a number, found "abc"'),
        ("weight: '1'", 'weight: expected a number, found "1"'),
        ("weight: .inf", "expected a number"),
        ("weight: .nan", "expected a number"),
        ("weight: nan", "expected a number"),
        ("weight: 1e999", "expected a number"),
        ("weight: 1_000", "expected a number"),
        ("weight: \u0661", "expected a number"),
        ("weight:", "weight: expected a number, found nothing"),
        ("weight: true", "expected a number"),
        ("weight: [1]", "expected a number, found a list of 1"),
        ("weight: {a: 1}", "expected a number, found a mapping of keys"),
        ("count: 1.5", "expected a whole number >= 1 and <= 1000, found"),
        ("count: true", "expected a whole number"),
        ("count: 0", 'count: expected a whole number >= 1 and <= 1000, found "0"'),
        ("count: " + "9" * 5000, "expected a whole number"),
        ("heavy: yes", 'heavy: expected true or false, found "yes"'),
        ("heavy: 1", "expected true or false"),
        ("label: [a]", "label: expected text, found a list of 1"),
        ("label:", "label: expected text, found nothing"),
        ("version: 2", 'version: expected 1, found "2"'),
        ("color: rde", "color: expected one of red, on, found \"rde\"; did you mean 'red'?"),
        ("color: {}", "expected one of red, on or [a whole number, a whole number, a whole number], f"),
        ("color: [1, 2]", "found a list of 2"),
        ("color: [1, 2, x]", "color[2]: expected a whole number"),
        ("zones: [{radius: 1}]", "zones[0].shape: missing key; expected one of round, square"),
        ("zones: [{shape: ruond}]", "round, square, found \"ruond\"; did you mean 'round'"),
        ("zones: [{shape: [a]}]", "zones[0].shape: expected one of round, square, found a list of 1"),
        ("zones: {}", "zones: expected a list, found a mapping of keys"),
        (
            "zones:\n- shape: round\n  radius: 1\n- shape: round\n  raduis: 1",
            "a.yaml:5: zones[1].raduis: unknown",
        ),
        ("zones:\n- shape: round", "a.yaml:2: zones[0].radius: missing key; expected a number > 0"),
        (
            "zones:\n- shape: round\n  radius: 0",
            'a.yaml:3: zones[0].radius: expected a number > 0, found "0"',
        ),
        ("zones:\n- shape: round\n  radius: 1\n  name: a/b", "name: expected text: letters, digits"),
        ("zones:\n- shape: square\n  turn: fre\n", "zones[0].turn: expected a number or free, found"),
        (
            "zones:\n- shape: square\n  size:\n    - 1\n    - 2",
            "a.yaml:5: zones[0].size[1]: expected no more than",
        ),
        ("law: {name: grwo}", "law.name: expected one of grow, shrink, found \"grwo\"; did you mean 'grow'?"),
        ("law: {rate: 1}", "law.name: missing key; expected one of grow, shrink"),
        ("law: {name: grow}", "law.rate: missing key; expected a number >= 0 and <= 1"),
        ("law: {name: grow, rate: 2}", "law.rate: expected a number >= 0 and <= 1"),
        (
            "law: {name: grow, rate: 1, factors: [1]}",
            "law.factors: unknown key; known: name, sign, rate, steps",
        ),
        ("law: {name: shrink, factors: []}", "law.factors: expected a list of at least 1, found a list of 0"),
        ("law: {name: grow, arguments: {}}", "law.arguments: unknown key"),
        ("values: {a: x}", "values.a: expected a number"),
        ("values: [1]", "found a list of 1"),
        ("file: ''", "file: expected text: a path or null"),
        ('file: "a\\0b"', "file: expected text: a path or null"),
        ("weight: 1\nweight: 2", "a.yaml:2: duplicate key 'weight'"),
        ("zones:\n- {a: 1, a: 2}", "a.yaml:2: duplicate key 'a'"),
        ("note: &a x\nlabel: *a", "a.yaml:1: anchors and aliases"),
        ("note: *a", "a.yaml:1: anchors and aliases"),
        ("note: !!python/object/apply:os.system [ls]", "a.yaml:1: tags are not understood"),
        ("note: !x y", "tags are not understood"),
        ("!!map {weight: 1}", "tags are not understood"),
        ("[a]: 1", "a.yaml:1: expected text as a key, found a list of 1"),
        ("? {a: 1}\n: 2", "expected text as a key, found a mapping of keys"),
        ("<<: {weight: 1}", "<<: unknown key"),
        ("weight: 1\n---\nweight: 2", "a.yaml:2: expected one document, found a second"),
        ("", "a.yaml: expected keys and values, found an empty text"),
        ("# only a comment", "found an empty text"),
        ("---", "expected a mapping of keys, found nothing"),
        ("- 1", "a.yaml:1: expected a mapping of keys, found a list of 1"),
        ("abc", 'a.yaml:1: expected a mapping of keys, found "abc"'),
        ("weight: [1", "not valid YAML"),
        ("a: 1\n b: 2", "a.yaml:2: not valid YAML"),
        ("weight: 1\0", "a.yaml: not valid YAML"),
        ("weight: \x07", "a.yaml: not valid YAML"),
        ("weight: @", "a.yaml:1: not valid YAML"),
        ('label: "\\ud800"', "not valid YAML"),
        ("label: \ud800", "not valid YAML"),
        ("weight: \u202e", r'expected a number, found "\u202e"'),
    ],
)
def test_an_error_says_where_what_was_expected_and_what_was_found(text, message):
    assert message in complaint(text)


@pytest.mark.parametrize(
    ("rules", "words"),
    [
        ((Length(1), Length(2)), "a list of at least 2"),
        ((Length(2), Length(1, 9)), "a list of at least 2 and at most 9"),
    ],
)
def test_several_bounds_of_a_length_are_said_as_one(rules, words):
    kind = tuple[int, ...]
    for rule in rules:
        kind = Annotated[kind, rule]
    assert describe(kind) == words


class TestAllMistakes:
    def test_those_of_a_file_are_told_at_once_by_their_lines(self):
        text = """note: &a 1
zones:
- shape: round
- {shape: sqare}
- {shape: square, size: [1, 2], turn: x}
- {shape: round, radius: -1, name: a/b, nmae: b}
law: {name: grow, rate: 2, sign: pluss, x: 1}
count: 0
count: 1
values: {a: x, b: 1, c: y}
wieght: 1
heavy: yes
"""
        assert complaint(text).split("\n") == [
            "a.yaml:1: anchors and aliases (&, *) are not understood; write the value out",
            "a.yaml:3: zones[0].radius: missing key; expected a number > 0",
            "a.yaml:4: zones[1].shape: expected one of round, square, found \"sqare\"; did you mean 'square'?",
            "a.yaml:4: zones[1].size: missing key; expected [a number, a number]",
            'a.yaml:5: zones[2].turn: expected a number or free, found "x"',
            'a.yaml:6: zones[3].radius: expected a number > 0, found "-1"',
            "a.yaml:6: zones[3].name: expected text: letters, digits, spaces and . _ + -, at most 100 or null, "
            'found "a/b"',
            "a.yaml:6: zones[3].nmae: unknown key; did you mean 'name'?",
            'a.yaml:7: law.rate: expected a number >= 0 and <= 1, found "2"',
            "a.yaml:7: law.sign: expected one of plus, minus, found \"pluss\"; did you mean 'plus'?",
            "a.yaml:7: law.x: unknown key; known: name, sign, rate, steps",
            'a.yaml:8: count: expected a whole number >= 1 and <= 1000, found "0"',
            "a.yaml:9: duplicate key 'count'; the first is at a.yaml:8",
            'a.yaml:10: values.a: expected a number, found "x"',
            'a.yaml:10: values.c: expected a number, found "y"',
            "a.yaml:11: wieght: unknown key; did you mean 'weight'?",
            'a.yaml:12: heavy: expected true or false, found "yes"; did you mean true?',
        ]

    def test_a_misspelt_key_is_not_missed_too(self):
        assert complaint("zones: [{shape: round, raduis: 1}]").count("\n") == 0

    def test_what_a_wrong_word_has_beside_it_is_read_as_the_nearest_has_it(self):
        assert complaint("law: {name: grwo, rate: x, sign: y, stpes: 3}").split("\n") == [
            "a.yaml:1: law.name: expected one of grow, shrink, found \"grwo\"; did you mean 'grow'?",
            'a.yaml:1: law.rate: expected a number >= 0 and <= 1, found "x"',
            'a.yaml:1: law.sign: expected one of plus, minus, found "y"',
            "a.yaml:1: law.stpes: unknown key; did you mean 'steps'?",
        ]
        assert complaint("zones: [{shape: sqare, size: [1, 2], turm: 1}, {shape: Round, radius: 0}]").split("\n") == [
            "a.yaml:1: zones[0].shape: expected one of round, square, found \"sqare\"; did you mean 'square'?",
            "a.yaml:1: zones[0].turm: unknown key; did you mean 'turn'?",
            "a.yaml:1: zones[1].shape: expected one of round, square, found \"Round\"; did you mean 'round'?",
            'a.yaml:1: zones[1].radius: expected a number > 0, found "0"',
        ]

    def test_what_refers_to_a_word_that_is_near_to_none_is_left_alone(self):
        assert complaint("law: {name: zzz, rate: x, sign: y, any: 1}").split("\n") == [
            'a.yaml:1: law.name: expected one of grow, shrink, found "zzz"',
            'a.yaml:1: law.sign: expected one of plus, minus, found "y"',
        ]

    def test_keys_of_any_kind_are_read_if_the_tag_is_near_to_none(self):
        assert complaint("zones: [{shape: 7, radius: -1, size: 3, nmae: x, foo: 1}, {radius: x}]").split("\n") == [
            'a.yaml:1: zones[0].shape: expected one of round, square, found "7"',
            'a.yaml:1: zones[0].radius: expected a number > 0, found "-1"',
            'a.yaml:1: zones[0].size: expected [a number, a number], found "3"',
            "a.yaml:1: zones[0].nmae: unknown key; did you mean 'name'?",
            "a.yaml:1: zones[0].foo: unknown key; known: shape, radius, name, size, turn",
            "a.yaml:1: zones[1].shape: missing key; expected one of round, square",
            'a.yaml:1: zones[1].radius: expected a number > 0, found "x"',
        ]

    def test_a_misspelt_key_of_a_tag(self):
        assert complaint("zones: [{shpe: round, raduis: 1}]\nlaw: {nmae: shrink, factors: []}").split("\n") == [
            "a.yaml:1: zones[0].shpe: unknown key; did you mean 'shape'?",
            "a.yaml:1: zones[0].raduis: unknown key; did you mean 'radius'?",
            "a.yaml:2: law.nmae: unknown key; did you mean 'name'?",
            "a.yaml:2: law.factors: expected a list of at least 1, found a list of 0",
        ]

    def test_siblings_of_what_has_a_wrong_tag_are_read(self):
        found = complaint("zones: [{shape: rond, radius: 1}, {shape: round, radius: -1}]\nwieght: 1").split("\n")
        assert [each.split(": ")[1] for each in found] == ["zones[0].shape", "zones[1].radius", "wieght"]

    @pytest.mark.parametrize(
        "text", ["note: *a", "values: {a: *a}", "color: [1, 2, *a]", "zones: [*a]", "*a", "law: {name: *a}", "law: *a"]
    )
    def test_what_could_not_be_read_is_reported_once(self, text):
        assert complaint(text) == "a.yaml:1: anchors and aliases (&, *) are not understood; write the value out"

    def test_overrides_too(self):
        found = complaint("weight: x\nnews: 1", "count=0", "zones[7]=1", "nothing", "heavy=no").split("\n")
        assert [each.partition(": ")[0] for each in found] == [
            "a.yaml:1",
            "a.yaml:2",
            "--set zones[7]=1",
            "--set nothing",
            "--set count=0",
            "--set heavy=no",
        ]

    def test_too_many_end_the_reading(self):
        *told, last = complaint("".join(f"k{n}: 1\n" for n in range(50))).split("\n")
        assert len(told) == MAX_MISTAKES
        assert last == "a.yaml: its reading ended with 20 mistakes"

    def test_an_error_keeps_its_messages_apart_and_on_one_line_each(self):
        with pytest.raises(MissionError) as caught:
            thing('weight: "a\\nb"\ncount: "c\\nError: d"')
        assert caught.value.messages == (
            'a.yaml:1: weight: expected a number, found "a\\nb"',
            'a.yaml:2: count: expected a whole number >= 1 and <= 1000, found "c\\nError: d"',
        )
        again = pickle.loads(pickle.dumps(caught.value))  # noqa: S301 - our own
        assert again.messages == caught.value.messages


def _no_two(first: int, second: int):
    if first == second:
        yield FieldError("second", "expected another than the first")


def _small(first: int, third: int):
    if third > first:
        yield FieldError("third", "expected at most the first")


@dataclass(frozen=True, slots=True, kw_only=True)
class Numbers:
    """Three numbers."""

    CHECKS: ClassVar = (_no_two, _small)

    first: int = 1  # [m] of the first
    second: int = 2
    third: int = 0  # [m/s] of the third
    color: Literal["gray", "red"] = "red"
    centers: tuple[float, ...] = ()  # [rad] of the rest
    colors: Mapping[Literal["gray", "red"], int] | None = None
    missions: Mapping[str, int] | None = None

    def __post_init__(self):
        check(self)


def numbers(text, *overrides):
    return parse(text, Numbers, error=MissionError, label="a.yaml", overrides=overrides)


def wrong_numbers(text, *overrides):
    with pytest.raises(MissionError) as caught:
        numbers(text, *overrides)
    return list(caught.value.messages)


class TestChecks:
    def test_all_are_made_at_once(self):
        assert wrong_numbers("second: 1\nthird: 2") == [
            "a.yaml:1: second: expected another than the first",
            "a.yaml:2: third: expected at most the first",
        ]

    def test_those_are_made_whose_fields_could_be_read(self):
        assert wrong_numbers("second: x\nthird: 2") == [
            'a.yaml:1: second: expected a whole number, found "x"',
            "a.yaml:2: third: expected at most the first",
        ]
        assert len(wrong_numbers("first: x\nthird: 2")) == 1

    def test_without_a_file(self):
        with pytest.raises(FieldError, match="second: expected another") as caught:
            Numbers(second=1, third=2)
        assert [each.field for each in caught.value.others] == ["third"]
        assert caught.value.__notes__ == ["third: expected at most the first"]


class TestHints:
    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("first: x", 'first: expected a whole number [m], found "x"'),
            ("third: 1 m/s", 'expected a whole number [m/s], found "1 m/s"; write the number alone, in m/s'),
            ("third: '1'", 'expected a whole number [m/s], found "1"; write it without quotes'),
            ("second: 1_000", "; did you mean 1000?"),
            (
                "centers: [90 deg]",
                'centers[0]: expected a number [rad], found "90 deg"; did you mean 1.5708, which is 90',
            ),
            ("centers: [90°]", "; did you mean 1.5708, which is 90 degrees?"),
            ("centers: ['1,5']", "; did you mean 1.5?"),
            ("centers: 1", 'centers: expected a list [rad], found "1"; did you mean [1]?'),
        ],
    )
    def test_units_and_suggestions(self, text, message):
        assert message in wrong_numbers(text)[0]

    @pytest.mark.parametrize("text", ["TRUE", "True", "on", "1"])
    def test_of_a_truth(self, text):
        assert complaint(f"heavy: {text}").endswith("; did you mean true?")


class TestSpelling:
    def test_both_are_read_and_one_is_written(self):
        british = numbers("{colour: grey, centres: [1], colours: {grey: 1, red: 2}}")
        assert british == numbers("{color: gray, centers: [1], colors: {gray: 1, red: 2}}")
        assert british.color == "gray"
        assert "color: gray\n" in dump(british)
        assert "our" not in dump(british)

    def test_names_that_a_user_chose_stay(self):
        assert numbers("missions: {grey: 1, gray: 2}").missions == {"grey": 1, "gray": 2}

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            (
                "color: red\ncolour: gray",
                "a.yaml:2: colour: the same as 'color', in another spelling; give one of the two",
            ),
            (
                "colour: red\ncolor: gray",
                "a.yaml:2: color: the same as 'colour', in another spelling; give one of the two",
            ),
            (
                "colors: {red: 1, gray: 1, grey: 2}",
                "a.yaml:1: colors.grey: 'gray' in another spelling is here already; ",
            ),
        ],
    )
    def test_both_at_once_are_a_mistake(self, text, message):
        (found,) = wrong_numbers(text)
        assert found.startswith(message)

    def test_overrides_replace_what_is_spelt_otherwise(self):
        assert numbers("color: red", "colour=grey").color == "gray"
        assert numbers("colours: {grey: 1}", "colors.gray=3").colors == {"gray": 3}
        assert numbers("centers: [1]", "centres[0]=3").centers == (3.0,)

    def test_an_override_in_both_spellings_is_one_too_many(self):
        (found,) = wrong_numbers("second: 3", "color=red", "colour=gray")
        assert found == "--set colour=gray: sets what --set color=red sets, too; give one of them"

    def test_a_mistake_in_what_is_spelt_otherwise_has_its_line(self):
        assert wrong_numbers("second: 3\ncolour: blue")[0].startswith("a.yaml:2: colour: expected one of gray, red")

    @given(st.sampled_from(["", "s", "_x", "ed"]), st.sampled_from(["", "my_", "re"]))
    def test_parts_of_words(self, after, before):
        assert spelling.find(f"{before}colour{after}", [f"{before}color{after}"]) == f"{before}color{after}"
        assert spelling.find(f"{before}centre{after}", [f"{before}centre{after}", f"{before}center{after}"]) == (
            f"{before}centre{after}"
        )
        assert spelling.find("colour", ["colours", "red"]) is None


@pytest.mark.parametrize(
    "text", ["wieght: 1", "weight: &a 1", "weight: @", "weight: 1\0", "a: 1\n---\nb: 1", "", "note: '~'"]
)
def test_the_parser_written_in_python_serves_as_well(text, monkeypatch):
    def outcome():
        try:
            return thing(text)
        except MissionError as error:
            return str(error).partition("not valid YAML")[:2]

    with_c = outcome()
    monkeypatch.setattr(yaml_tree, "LOADER", yaml.SafeLoader)
    assert outcome() == with_c


class TestOverrides:
    TEXT = "count: 3\nzones:\n- {shape: round, radius: 1}\n"

    def test_replace_add_and_empty(self):
        assert thing(self.TEXT, "count=20").count == 20
        assert thing(self.TEXT, "zones[0].radius = 0.3").zones == (Round(radius=0.3),)
        assert thing(self.TEXT, "zones=[]").zones == ()
        assert thing(self.TEXT, "zones[0]={shape: square, size: [2, 1]}").zones == (Square(size=(2.0, 1.0)),)
        assert thing(self.TEXT, "note=").note is None
        assert thing(self.TEXT, "note=a=b").note == "a=b"
        assert thing(self.TEXT, "law.name=grow", "law.rate=0.5").law.arguments == {"rate": 0.5, "steps": 3}
        assert thing(self.TEXT, "values.green=1").values == {"green": 1.0}

    @pytest.mark.parametrize(
        ("assignment", "message"),
        [
            ("cuont=20", "--set cuont=20: cuont: unknown key; did you mean 'count'?"),
            ("count=x", '--set count=x: count: expected a whole number >= 1 and <= 1000, found "x"'),
            ("zones[0].raduis=1", "--set zones[0].raduis=1: zones[0].raduis: unknown key; did"),
            ("zones[1].radius=1", "expected a list with an item [1], found a list of 1 (a.yaml:2)"),
            ("zones.radius=1", "expected a mapping for the key 'radius', found a list of 1"),
            ("count.x=1", "expected a mapping for the key 'x', found \"3\" (a.yaml:1)"),
            ("count[0]=1", "expected a list with an item [0]"),
            ("law.rate=1", "--set law.rate=1: law.name: missing key"),
            ("count", "--set count: expected path=value"),
            ("=1", "expected path=value"),
            ("a..b=1", "expected path=value"),
            ("zones[-1]=1", "expected path=value"),
            ("zones[99999999999999999999]=1", "expected path=value"),
            ("zones[x]=1", "expected path=value"),
            ("note=&a x", "--set note=&a x: anchors"),
            ("note=[1", "--set note=[1: not valid YAML"),
            ("note=" + "[" * 10_000, "nested more than 32 levels deep"),
        ],
    )
    def test_a_mistake_is_reported_by_the_words_of_the_command_line(self, assignment, message):
        assert message in complaint(self.TEXT, assignment)

    def test_into_what_is_no_mapping(self):
        assert "expected a mapping for the key 'a'" in complaint("- 1", "a=1")


@given(st.lists(st.one_of(st.integers(0, 10**8), st.from_regex(r"[a-z_]{1,5}", fullmatch=True)), max_size=6))
def test_steps_of_a_path(way):
    way = ["top", *way]
    path = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in way)[1:]
    assert steps(path) == way


def test_defaults_stand_in_for_absent_keys_only():
    assert thing("weight: 1", defaults={"label": "x"}).label == "x"
    assert thing("label: y", defaults={"label": "x"}).label == "y"


def test_paths_start_from_the_file_and_on_the_command_line_from_the_current_folder(tmp_path, monkeypatch):
    (tmp_path / "sub").mkdir()
    file = tmp_path / "sub" / "a.yaml"
    file.write_text("file: b.png")
    monkeypatch.chdir(tmp_path)
    assert read(file, Thing, error=MissionError).file == str(tmp_path / "sub" / "b.png")
    assert read("sub/a.yaml", Thing, error=MissionError).file == str(tmp_path / "sub" / "b.png")
    assert read(file, Thing, error=MissionError, overrides=["file=b.png"]).file == str(tmp_path / "b.png")


_text = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\ufffe\uffff"), max_size=30)
_float = st.floats(allow_nan=False, allow_infinity=False)
_name = st.from_regex(r"[a-z0-9_][a-z0-9 .+-]{0,5}", fullmatch=True)
_things = st.builds(
    Thing,
    count=st.integers(1, 1000),
    weight=_float,
    heavy=st.booleans(),
    label=_text,
    note=st.none() | _text | st.sampled_from(["null", "~", "on", "1e3", " x ", "a: b", "# c", "a\nb\n"]),
    zones=st.lists(
        st.builds(Round, radius=st.floats(0, 1e300, exclude_min=True), name=st.none() | _name)
        | st.builds(Square, size=st.tuples(st.floats(5, 9), st.floats(0, 5)), turn=_float | st.just("free")),
        max_size=3,
    ).map(tuple),
    color=st.sampled_from(["red", "on"]) | st.tuples(*[st.integers(0, 255)] * 3),
    values=st.none() | st.dictionaries(_text, _float, max_size=3),
    law=st.none()
    | st.builds(
        Law,
        name=st.just("grow"),
        sign=st.sampled_from(["plus", "minus"]),
        arguments=st.fixed_dictionaries({"rate": st.floats(0, 1), "steps": st.integers(-5, 5)}),
    ),
    file=st.none() | st.just("/a b/ü.png"),
)


@given(_things)
def test_what_is_written_is_read_back(value):
    assert thing(dump(value)) == value


def test_writing_is_made_for_people():
    value = Thing(
        label="two\nlines\n",
        zones=(Square(size=(2.0, 0.1)),),
        law=Law(name="grow", arguments={"rate": 1e-7, "steps": 3}),
    )
    assert dump(value) == (
        "version: 1\ncount: 1\nweight: 0.0\nheavy: false\nlabel: |\n  two\n  lines\nnote: null\n"
        "zones:\n- shape: square\n  size: [2.0, 0.1]\n  turn: free\ncolor: red\nvalues: null\n"
        "law:\n  name: grow\n  sign: plus\n  rate: 1.0e-07\n  steps: 3\nfile: null\n"
    )


ATTACKS = {
    "deep_list": (b"[" * 100_000, "nested more than 32 levels deep"),
    "deep_mapping": (b"{a: " * 50_000, "nested more than 32 levels deep"),
    "deep_keys": (b"? " * 100_000, "nested more than 32 levels deep"),
    "deep_dashes": (b"- " * 100_000, "nested more than 32 levels deep"),
    "deep_indents": (b"".join(b" " * n + b"a:\n" for n in range(600)), "nested more than 32 levels deep"),
    "commas": (b"{" + b"," * 200_000, "not valid YAML"),
    "questions": (b"{" + b"?," * 100_000, "duplicate key ''"),
    "quotes": (b'"' * 200_000, "a.yaml"),
    "colons": (b"a:" * 100_000, "a.yaml"),
    "colons_apart": (b"a: " * 80_000, "not valid YAML"),
    "stars": (b"*" * 200_000, "not valid YAML"),
    "anchors": (b"&" * 200_000, "not valid YAML"),
    "long_key": (b"? " + b"k" * 200_000 + b"\n: 1", "unknown key"),
    "long_line": (b"weight: " + b"1" * 200_000, "expected a number"),
    "many_keys": (b"".join(b"k%d: 1\n" % n for n in range(20_000)), "unknown key"),
    "many_items": (b"zones: [" + b"1," * 120_000 + b"]", "zones[0]: expected a mapping of keys"),
    "laughs": (b"".join(b"%c: &%c [*%c, *%c]\n" % (n, n, n - 1, n - 1) for n in range(98, 122)), "anchors"),
    "binary": (bytes(range(256)) * 100, "expected UTF-8 text, found the byte 0x80"),
    "utf16": ("weight: 1".encode("utf-16"), "expected UTF-8 text, found the byte 0xff"),
    "nul": (b"\0" * 1000, "not valid YAML"),
    "large": (b"a" * (MAX_FILE_SIZE + 1), "expected at most 256 KiB, found a larger file"),
}

_RUNNER = """
import json, resource, sys, time
resource.setrlimit(resource.RLIMIT_AS, (300_000_000, 300_000_000))
from mercator_design.errors import MissionError
from mercator_design.config.loading import read
sys.path.insert(0, sys.argv[1])
from test_loading import Thing
outcomes = {}
for path in sys.argv[2:]:
    start = time.process_time()
    try:
        read(path, Thing, error=MissionError)
    except MissionError as error:
        outcomes[path] = [str(error), time.process_time() - start]
print(json.dumps(outcomes))
"""


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    """Path -> [message, seconds] of every attack, read in a process that may use 300 MB."""
    folder = tmp_path_factory.mktemp("attacks")
    paths = {name: folder / name / "a.yaml" for name in ATTACKS}
    for name, path in paths.items():
        path.parent.mkdir()
        path.write_bytes(ATTACKS[name][0])
    os.mkfifo(folder / "pipe")
    (folder / "to_zero").symlink_to("/dev/zero")
    (folder / "loop").symlink_to(folder / "loop")
    with (folder / "huge").open("wb") as file:
        file.truncate(10**12)  # sparse
    others = ["/dev/zero", folder / "pipe", folder / "to_zero", folder / "loop", folder / "huge", folder]
    command = [sys.executable, "-c", _RUNNER, Path(__file__).parent, *paths.values(), *others]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent.parent)}
    done = subprocess.run(command, capture_output=True, timeout=LIMIT, check=True, env=environment)
    found = json.loads(done.stdout)
    assert list(found) == [str(path) for path in command[4:]], "one was accepted"
    return {Path(path).parent.name if path.endswith("a.yaml") else path: got for path, got in found.items()}


@pytest.mark.swept
@pytest.mark.together
@pytest.mark.parametrize("name", some(ATTACKS, 6))
def test_an_attack_is_refused_at_once_and_in_little_memory(name, outcomes):
    message, seconds = outcomes[name]
    assert ATTACKS[name][1] in message
    assert len(message) < 500 + 250 * message.count("\n")
    assert message.count("\n") <= MAX_MISTAKES
    assert seconds < 1.0


@pytest.mark.together
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("/dev/zero", "expected a regular file"),
        ("pipe", "expected a regular file"),
        ("to_zero", "expected a regular file"),
        ("loop", "no such file"),
        ("huge", "found a larger file"),
    ],
)
def test_only_regular_small_files_are_opened(name, expected, outcomes):
    [(message, seconds)] = [got for path, got in outcomes.items() if path.endswith(name)]
    assert expected in message
    assert seconds < 1.0


@pytest.mark.parametrize("path", ["missing.yaml", "nul\0.yaml", "x" * 5000, "x/" * 5000, ""])
def test_a_file_that_is_not_there(path, tmp_path):
    with pytest.raises(MissionError, match=r"no such file|cannot be read|found a folder"):
        read(tmp_path / path, Thing, error=MissionError)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_an_unreadable_file(tmp_path):
    file = tmp_path / "a.yaml"
    file.write_text("weight: 1")
    file.chmod(0)
    with pytest.raises(MissionError, match="cannot be read: Permission denied"):
        read(file, Thing, error=MissionError)


def test_an_error_of_the_disk_is_reported(tmp_path, monkeypatch):
    file = tmp_path / "a.yaml"
    file.write_text("weight: 1")

    def broken(*_args):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(Path, "open", broken)
    with pytest.raises(MissionError, match=r"a\.yaml: cannot be read: Input/output error"):
        read(file, Thing, error=MissionError)
