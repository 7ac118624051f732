import pytest

from mercator_design.errors import RaceError
from mercator_design.race import Space, categorical, parse_space
from mercator_design.race.irace.configurations import read_configurations, to_text

SPACE = parse_space("""
x "--x " r (0, 0.9)
n "--n " i (1, 9) | rule == "fast"
rule "--rule " c (slow, fast, "in between")
only "--only " c (this)
[forbidden]
x > 0.8
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
        ("         x n rule only\n12 0.25 3 fast this\n3  0.50 NA 'in between' this\n", [FAST, BETWEEN]),
        ("x n rule\n'1' 0.25 3 fast # the best\n", [FAST]),
        ("x n rule\n0.2500499 3 fast\n", [FAST]),
    ],
)
def test_what_is_read(tmp_path, text, expected):
    (tmp_path / "c.txt").write_text(text)
    assert read_configurations(tmp_path / "c.txt", SPACE) == (expected, [])


@pytest.mark.parametrize(
    ("row", "words"), [("0.49999 NA 0.1", "'z': expected a value"), ("0.5 a 0.16666", "'w': expected real within")]
)
def test_what_is_not_of_the_space_when_it_is_rounded(tmp_path, row, words):
    """0.49999 is 0.5 with four digits, for which another parameter is active; 0.1667 is more than a third of it."""
    space = parse_space('x "" r (0, 1)\nz "" c (a, b) | x >= 0.5\nw "" r (0.01, "x/3")\n')
    (tmp_path / "c.txt").write_text(f"x z w\n{row}\n")
    with pytest.raises(RaceError, match=rf"c.txt:2: rounded to the digits of its parameters: parameter {words}"):
        read_configurations(tmp_path / "c.txt", space)


def test_what_is_forbidden_is_left_out_and_said(tmp_path):
    file = tmp_path / "c.txt"
    file.write_text("x n rule\n0.85 3 fast\n0.25 3 fast\n")
    assert read_configurations(file, SPACE) == ([FAST], [f"{file}:2: is forbidden, and left out"])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("# nothing\n", ": expected a line with the names of parameters, found none"),
        ("x y\n1 2", ":1: expected names of parameters, found 'y'"),
        ("x rule n x\n1 fast 2 1", ":1: expected each parameter once, found 'x' twice"),
        ("x rule n\n0.5 fast", ":2: expected 3 values, found 2"),
        ("x rule n\n\nhigh fast 3", ":3: parameter 'x': expected a number, found 'high'"),
        ("x rule n\n0.5 fast 1_0", ":2: parameter 'n': expected a whole number, found '1_0'"),
        ("x rule n\n0.5 fast 2.5", ":2: parameter 'n': expected a whole number, found '2.5'"),
        ("x rule n\n0.5 fast 12", ":2: parameter 'n': expected integer within (1, 9), found 12"),
        ("x rule n\n0.5 fast NA", ":2: parameter 'n': expected a value in (1, 9), found none"),
        ("x rule n\n0.5 slow 3", ":2: parameter 'n': expected no value as it is inactive, found 3"),
        ("x rule n\n0.5 quick NA", ":2: parameter 'rule': expected one of"),
        ("x rule n\n0.25 fast 3\n.25 fast 3", ":3: expected another configuration, found that of line 2"),
        ("x rule n\n0.25 'fast 3", ":2: expected values, in quotes if they have blanks, found 'fast 3"),
        ("x rule n\n1 0.25 fast 3\n0.5 slow NA", ":3: expected 4 values, found 3"),
        ("x rule n\n-1e-5 fast 3", ":2: parameter 'x': expected real within (0, 0.9), found -1e-05"),
    ],
)
def test_what_is_refused(tmp_path, text, message):
    (tmp_path / "c.txt").write_text(text)
    with pytest.raises(RaceError) as error:
        read_configurations(tmp_path / "c.txt", SPACE)
    assert f"{tmp_path / 'c.txt'}{message}" in str(error.value)


def test_a_table_that_irace_printed(tmp_path):
    """What R printed: `configurations.print` of irace 3.5, whose rows are named by their configurations' numbers."""
    space = parse_space('x "--x " r (-1,1)\nrule "--rule " c (\'a\', b)\nn "--n=" i (1,5) | rule == "b"\n')
    (tmp_path / "c.txt").write_text("          x rule  n\n12  0.25000  'a' NA\n3  -0.00001    b  3\n")
    found, notes = read_configurations(tmp_path / "c.txt", space)
    assert found == [{"x": 0.25, "rule": "'a'"}, {"x": 0.0, "rule": "b", "n": 3}]
    assert notes == []
    assert space.command_line(found[1]) == "--x 0 --rule b --n=3"
    assert "-0" not in to_text(space, found)


def test_a_column_that_irace_expects_is_noted(tmp_path):
    (tmp_path / "c.txt").write_text("x rule\n0.5 'in between'\n")
    found, notes = read_configurations(tmp_path / "c.txt", SPACE)
    assert (found, notes) == ([BETWEEN], [f"{tmp_path / 'c.txt'}:1: irace expects a column for parameter 'n'"])


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(RaceError, match=r"c\.txt: no such file"):
        read_configurations(tmp_path / "c.txt", SPACE)


def test_what_is_written_is_read(tmp_path):
    (tmp_path / "c.txt").write_text(to_text(SPACE, [FAST, BETWEEN], ["best: of all"]))
    assert read_configurations(tmp_path / "c.txt", SPACE) == ([FAST, BETWEEN], [])


ODD = ["it's", 'say "x"', "'a'", "# 1", "a\\b", "a\\", "NA", "", 'b"', '"c', "d 'e\"", "f\\ g", "\\'", '\\"',
       "h i\\", "'j\\", "k l\\\\", "#\\"]  # fmt: skip


def test_odd_values_are_read_as_they_were(tmp_path):
    space = Space([categorical("a", ODD), categorical("b", ["x", "y"])])
    configurations = [{"a": one, "b": "x"} for one in ODD]
    (tmp_path / "c.txt").write_text(to_text(space, configurations))
    assert read_configurations(tmp_path / "c.txt", space) == (configurations, [])


def test_a_value_that_cannot_be_written_is_refused():
    space = Space([categorical("a", ["b c\\", "b c\\\\"])])
    with pytest.raises(RaceError, match=r"parameter 'a': expected a value that can be written in a table, found 'b c"):
        to_text(space, [{"a": "b c\\"}])
