import pytest

from mercator_design.errors import RaceError
from mercator_design.race import Space
from mercator_design.race.configurations_text import read_configurations, to_text

SPACE = Space.from_text("""
x "--x " r (0, 1)
n "--n " i (1, 9) | rule == "fast"
rule "--rule " c (slow, fast, "in between")
only "--only " c (this)
[forbidden]
x > 0.9
""")
FAST = {"x": 0.25, "n": 3, "rule": "fast", "only": "this"}
BETWEEN = {"x": 0.5, "rule": "in between", "only": "this"}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x n rule only\n0.25 3 fast this", [FAST]),
        ("rule x n  # in any order\n\nfast .25 3.0\n'in between' 5e-1 NA\n", [FAST, BETWEEN]),
        ('x rule n\n0.5 "in between" <NA>', [BETWEEN]),
        ("x rule n", []),
    ],
)
def test_what_is_read(tmp_path, text, expected):
    (tmp_path / "c.txt").write_text(text)
    assert read_configurations(tmp_path / "c.txt", SPACE) == (expected, [])


def test_what_is_forbidden_is_left_out_and_said(tmp_path):
    file = tmp_path / "c.txt"
    file.write_text("x n rule\n0.95 3 fast\n0.25 3 fast\n")
    assert read_configurations(file, SPACE) == ([FAST], [f"{file}:2: is forbidden, and left out"])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("# nothing\n", ": expected a line with the names of parameters, found none"),
        ("x y\n1 2", ":1: expected names of parameters, found 'y'"),
        ("x rule n\n1 fast", ":2: expected 3 values, found 2"),
        ("x rule n\n\nhigh fast 3", ":3: parameter 'x': expected a number, found 'high'"),
        ("x rule n\n0.5 fast 1_0", ":2: parameter 'n': expected a whole number, found '1_0'"),
        ("x rule n\n0.5 fast 2.5", ":2: parameter 'n': expected a whole number, found '2.5'"),
        ("x rule n\n0.5 fast 12", ":2: parameter 'n': expected integer within (1, 9), found 12"),
        ("x rule n\n0.5 fast NA", ":2: parameter 'n': expected a value in (1, 9), found none"),
        ("x rule n\n0.5 slow 3", ":2: parameter 'n': expected no value as it is inactive, found 3"),
        ("x rule n\n0.5 quick NA", ":2: parameter 'rule': expected one of"),
        ("x rule n\n0.25 fast 3\n.25 fast 3", ":3: expected another configuration, found that of line 2"),
        ("x rule n\n0.25 'fast 3", ":2: expected values, in quotes if they have blanks, found No closing quotation"),
    ],
)
def test_what_is_refused(tmp_path, text, message):
    (tmp_path / "c.txt").write_text(text)
    with pytest.raises(RaceError) as error:
        read_configurations(tmp_path / "c.txt", SPACE)
    assert f"{tmp_path / 'c.txt'}{message}" in str(error.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(RaceError, match=r"c\.txt: no such file"):
        read_configurations(tmp_path / "c.txt", SPACE)


def test_what_is_written_is_read(tmp_path):
    (tmp_path / "c.txt").write_text(to_text(SPACE, [FAST, BETWEEN], ["best: of all"]))
    assert read_configurations(tmp_path / "c.txt", SPACE) == ([FAST, BETWEEN], [])
