"""The quick reading of JSON data says the same as the builder that explains what is wrong with them."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.config.building import build
from mercator_design.config.json_data import WRONG, from_json, reader
from mercator_design.config.schema import Length, OneOf, Range
from mercator_design.config.yaml_tree import Fault, tree_of
from mercator_design.errors import RaceError


@dataclass(frozen=True, kw_only=True)
class Inner:
    name: Annotated[str, OneOf(("a", "b"))]
    size: Annotated[int, Range(0, 9)] = 3


@dataclass(frozen=True, kw_only=True)
class Outer:
    number: float | None
    flag: bool
    inner: Inner | None = None
    several: Annotated[tuple[int, ...], Length(1)] = (1,)
    pair: tuple[str, float] = ("x", 1.0)
    values: Mapping[str, str | int | float]
    word: Literal["yes", "no"] = "yes"


WORDS = st.sampled_from(["a", "1", "", "null", "true", "yes"])
NUMBERS = st.integers(-3, 12) | st.floats(allow_nan=False, allow_infinity=False)
JSON = st.recursive(
    st.none() | st.booleans() | NUMBERS | WORDS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["name", "size"]), inner, max_size=2),
    max_leaves=6,
)
RIGHT = {"number": 1.5, "flag": True, "inner": {"name": "a"}, "several": [1, 2], "pair": ["x", 2], "values": {"k": "v"}}


@given(
    st.dictionaries(st.sampled_from([*RIGHT, "word", "other"]), JSON, max_size=2), st.sets(st.sampled_from([*RIGHT]))
)
def test_both_say_the_same(changes, removed):
    data = {key: value for key, value in RIGHT.items() if key not in removed} | changes
    quick = reader(Outer)(data)
    try:
        built = build(tree_of(data), Outer)
    except Fault:
        built = WRONG
    assert (quick is WRONG) == (built is WRONG)
    assert quick is WRONG or quick == built


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (RIGHT | {"flag": "true"}, 'f: at.flag: expected true or false, found "true"'),
        (RIGHT | {"number": True}, "f: at.number: expected a number or null, found true"),
        (RIGHT | {"number": 2**63}, "f: at: expected a mapping of keys, found something else"),
        (RIGHT | {"pair": ["x"]}, r"f: at.pair: expected \[text, a number\], found a list of 1"),
        (RIGHT | {"pair": [1, 2]}, r"f: at.pair\[0\]: expected text, found 1"),
        (RIGHT | {"values": {"k": "\ud800"}}, "f: at: expected a mapping of keys, found something else"),
        ({}, "f: at.number: missing key.*; f: at.flag: missing key"),
        (json.loads("[" * 50 + "]" * 50), "f: nested more than 32 levels deep"),
    ],
)
def test_what_is_said(data, words):
    with pytest.raises(RaceError, match=words):
        from_json(data, Outer, error=RaceError, label="f", path="at")


def test_whatever_json_can_hold():
    read = reader(object)
    data = {"a": [1, 2.5, None, True, "x", {}]}
    assert read(data) == data
    for wrong in (float("nan"), "\ud800", {"\ud800": 1}, Path(), json.loads("[" * 50 + "]" * 50), 10**30):
        assert read([wrong]) is WRONG


def test_a_whole_number_stays_one_where_a_number_is_wanted():
    """So that a journal's digest stays what it was."""
    assert repr(reader(float)(3)) == "3"
