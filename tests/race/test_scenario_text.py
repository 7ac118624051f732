import pytest

from mercator_design.errors import RaceError
from mercator_design.race.irace.scenario_text import read_assignments, to_text


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("maxExperiments = 5000", {"maxExperiments": 5000}),
        ("maxExperiments <- 5000L", {"maxExperiments": 5000}),
        ("a=1;b = 2", {"a": 1, "b": 2}),
        ("a = 10 * 1000 + 2", {"a": 10002}),
        ("a = -1e-4", {"a": -1e-4}),
        ("a = TRUE\nb = F\nc = T", {"a": True, "b": False, "c": True}),
        ("a = NA\nb = NULL", {"a": None, "b": None}),
        ('a = "x#y" # a comment', {"a": "x#y"}),
        ("## a = 1\n\n  # b\n", {}),
        ("a = 'it\"s'", {"a": 'it"s'}),
        (r'a = "\"\\\n\t\x41\101\u00e9\u{1F600}"', {"a": '"\\\n\tAAé\U0001f600'}),
        ("a = c(\"x\", # first\n  'y',\n3)\nb = 1", {"a": ("x", "y", "3"), "b": 1}),
        ("a =\n  3\nb = 4 +\n  1", {"a": 3, "b": 5}),
        ('.mine = "x"\na = .mine', {"a": "x"}),
        ("a = 1\nb = a * 2", {"a": 1, "b": 2}),
        ("a = 1\na = 2", {"a": 2}),
        ("a = 1:3\nb = seq(2, 8, by = 3)", {"a": (1, 2, 3), "b": (2, 5, 8)}),
    ],
)
def test_what_is_read(text, expected):
    assert {one.name: one.value for one in read_assignments(text, "scenario.txt")} == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = 1\nnonsense", "s:2: expected NAME = VALUE, found 'nonsense'"),
        ("a == 1", "s:1: expected NAME = VALUE, found 'a == 1'"),
        ("\n a = 'x", "s:2: expected the closing ' of 'x"),
        ("a = 1\nb = c(1,\n2", "s:2: expected the end of 'b = c(1,\\n2', found the end of the file"),
        ("a = b", "s:1: a: expected text in quotes, a number, TRUE or FALSE, found the name 'b'"),
        ("a = 1\nf = function(x) x", "s:2: f: expected a value, found a function of R, which cannot be run here"),
        ("f = \\(x) x", "found a function of R"),
        ('a = "\\q"', "s:1, column 6: expected an escape of R such as \\n or \\\\, found '\\q'"),
        ("a = c(1,\n  @)", "s:2, column 3: expected a number, a name, text or an operator, found '@'"),
        ('a = system("x")', "s:1, column 5: expected one of min, max, "),
        ('a = 1 + "x"', "s:1: a: 1 + \"x\": expected a number, found 'x'"),
        ('source("other.txt")', "expected NAME = VALUE"),
    ],
)
def test_what_is_refused(text, message):
    with pytest.raises(RaceError) as error:
        read_assignments(text, "s")
    assert message in str(error.value)


def test_what_is_written_is_read():
    settings = {"a": 'x\\y"z\n', "b": True, "c": ("1", "x"), "d": None, "e": 0.05, "f": (2, 1e-10), "g": 1 - 0.1 / 3}
    again = {one.name: one.value for one in read_assignments(to_text(settings), "s")}
    assert again == settings | {"b": 1}
