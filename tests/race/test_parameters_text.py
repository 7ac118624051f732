import re

import pytest
from numpy.random import default_rng

from mercator_design.designer import flavour_space
from mercator_design.errors import RaceError
from mercator_design.race import Space, categorical, integer, ordered, parse_space, real
from mercator_design.race.irace.parameters import parameters_text
from mercator_design.race.space.relations import ValueIn, ValuePlus
from tests.fsm.strategies import FLAVOURS
from tests.race.spaces import machines, uniform

TEXT = """
# an example with all that the format has
algorithm  "--"            c      (as, "mm as", "eas")     # values may be quoted
level      "--level "      o      (0, 1, 2)
alpha      "--alpha="      r      (0.00, 5.00)
ants       "--ants "       i,log  (5, 100)
rate       '--rate '       r,log  ("0.01", 1)
best       ""              i      (1, "min(ants, 10)")     | algorithm %in% c("eas", "mm as") & level != 0
half       "--half "       r      (0.5, (ants + 1) * 0.5)  | is.na(best) | best > 3

[forbidden]
alpha == 0 & level == 2
(ants > 50) && (algorithm == "as")
[global]
digits = 3
"""


def test_the_whole_format_is_read():
    space = parse_space(TEXT)
    assert space.parameters == (
        categorical("algorithm", ["as", "mm as", "eas"], switch="--"),
        ordered("level", [0, 1, 2], switch="--level "),
        real("alpha", 0.0, 5.0, switch="--alpha=", digits=3),
        integer("ants", 5, 100, log=True, switch="--ants "),
        real("rate", 0.01, 1, log=True, switch="--rate ", digits=3),
        integer("best", 1, "min(ants, 10)", condition='algorithm %in% c("eas", "mm as") & level != 0'),
        real("half", 0.5, "(ants + 1) * 0.5", switch="--half ", condition="is.na(best) | best > 3", digits=3),
    )
    assert [f.text for f in space.forbidden] == [
        "alpha == 0 & level == 2",
        '(ants > 50) && (algorithm == "as")',
    ]
    assert space.is_forbidden({"algorithm": "as", "ants": 60})


def test_a_space_is_written_and_read_again():
    for space in (parse_space(TEXT), machines()):
        again = parse_space(parameters_text(space))
        assert (again.parameters, again.forbidden) == (space.parameters, space.forbidden)


def test_relations_are_written_in_irace_s_language():
    space = Space(
        [
            integer("n", 1, 4, switch="--n "),
            integer("m", 1, ValuePlus("n", 2), condition=ValueIn("n", range(2, 5))),
            integer("k", 1, 3, condition=ValueIn("n", range(2, 4))),
            categorical("c", ["a b", "d"], condition=ValueIn("k", range(3, 4))),
            real("x", ValuePlus("n", -1), 9, digits=2, condition=ValueIn("c", ("a b", "d"))),
        ]
    )
    assert parameters_text(space).splitlines() == [
        'n "--n " i (1, 4)',
        'm "" i (1, "n+2") | n > 1',
        'k "" i (1, 3) | n %in% c("2", "3")',
        'c "" c ("a b", d) | as.numeric(k) > 2',
        'x "" r ("n-1", 9) | c %in% c("a b", "d")',
        "",
        "[global]",
        "digits = 2",
    ]


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_the_text_of_a_flavour_means_its_space(flavour):
    space = flavour_space(flavour)
    read = parse_space(parameters_text(space))
    assert [one.domain for one in read.parameters] == [one.domain for one in space.parameters]
    assert read.levels == space.levels
    assert uniform(read, 300, default_rng(1)) == uniform(space, 300, default_rng(1))


def test_different_digits_cannot_be_written():
    with pytest.raises(RaceError, match="expected the same digits for all real parameters, found 2, 3"):
        parameters_text(Space([real("x", 0, 1, digits=3), real("y", 0, 1, digits=2)]))


def test_single_quotes_are_part_of_a_value():
    """As readParameters of irace has it."""
    space = parse_space("""a "" c ('eas', it's, "a b")""", "p.txt")
    assert space["a"].values == ("'eas'", "it's", "a b")
    assert space.notes == (
        "p.txt:1: irace takes single quotes for a part of the value 'eas', and so does this: use double quotes",
    )


@pytest.mark.parametrize(
    ("text", "notes"),
    [
        ('a "-a " i (0,5)', ()),
        ('a "-a " i(0,5)', ("p.txt:1, column 10: irace expects a blank after the type",)),
        ('a"-a " i (0,5)', ("p.txt:1, column 2: irace expects a blank after the name",)),
        ('a "-a "r,log(1,5)', ("p.txt:1, column 8: irace expects a blank after the switch",
                              "p.txt:1, column 13: irace expects a blank after the type")),
        ("a '-a ' i (0,5)", ("p.txt:1, column 3: irace expects the switch in double quotes",)),
        ('a "" i (0,5)\nb "" c (x,y) | a > 1 && a < 3\n[forbidden]\na == 1 || b == "x"',
         ("p.txt:2, column 22: irace refuses '&&' here: write '&'",
          "p.txt:4, column 8: irace refuses '||' here: write '|'")),
        ('a "" i (0,5)\nb "" c (100000,y)\nc "" c (u,v) | b == 100000',
         ("p.txt:3, column 21: R compares text with '1e+05' where a condition has the number 100000: "
          "put it in quotes",)),
        ('a "" i (0,200000)\nc "" c (u,v) | a == 100000', ()),
    ],
)  # fmt: skip
def test_what_irace_refuses_is_noted(text, notes):
    assert parse_space(text, "p.txt").notes == notes


def test_digits_are_four_unless_said_and_sections_may_come_in_any_order():
    assert parse_space('a "" r (0,1)')["a"].digits == 4
    space = parse_space('a "" r (0,1)\n[global]\ndigits=2\n[forbidden]\na > 0.5\n')
    assert space["a"].digits == 2
    assert space.is_forbidden({"a": 0.6})


def test_a_parameter_may_depend_on_one_that_comes_later():
    space = parse_space('a "-a " i (1, "b") | b > 2\nb "-b " i (1,9)')
    assert list(space.build(lambda p, bounds: p.quantile(0.9, bounds))) == ["a", "b"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "p.txt: expected at least one parameter, before [forbidden] and [global], found none"),
        ("# nothing", "p.txt: expected at least one parameter, before [forbidden] and [global], found none"),
        (
            '\na! "" c (x)',
            'p.txt:2, column 2: expected a switch in quotes such as "--name ", found \'! "" c (x)\'',
        ),
        ('"--a" c (x)', "p.txt:1, column 1: expected the name of a parameter, found '\"--a\" c (x)'"),
        ("a --a c (x)", 'p.txt:1, column 3: expected a switch in quotes such as "--name "'),
        (
            'a "-a"',
            "p.txt:1, column 7: expected a type: c, o, i, r, i,log or r,log, found the end of the line",
        ),
        ('a "-a" x (1,2)', "p.txt:1, column 8: expected a type: c, o, i, r, i,log or r,log, found 'x (1,2)'"),
        ('a "-a" i, log (1,2)', "p.txt:1, column 8: expected a type"),
        ('a "-a" i 1,2', "p.txt:1, column 10: expected a domain in parentheses, found '1,2'"),
        ('a "-a" i (1,2', "p.txt:1, column 10: expected the closing ) of the domain, found '(1,2'"),
        ('a "-a" c (x, "y)', 'p.txt:1, column 10: expected the closing " of the domain'),
        ('a "-a" c (x,,y)', "p.txt:1, column 13: expected a value, found ',y)'"),
        ('a "-a" i (1)', "p.txt:1, column 11: expected two bounds, found 1"),
        ('a "-a" i (1,2,3)', "p.txt:1, column 11: expected two bounds, found 3"),
        ('a "-a" i (1,2) b > 1', "p.txt:1, column 16: expected '|' and a condition, or the end of the line"),
        ('a "-a" i (1,2) |', "p.txt:1, column 17: expected a value, a parameter or '(', found the end"),
        (
            'a "-a" i (1,2) | b =< 1',
            "p.txt:1, column 20: expected an operator or the end, found '='",
        ),
        ('a "-a" i (1, "b >")', "p.txt:1, column 17: expected arithmetic, found '>'"),
        ('a "-a" i (one, 2)', "p.txt: parameter 'a': expected names of parameters, found 'one'"),
        ('a "-a" i (2, 1)', "p.txt:1: parameter 'a', domain (2, 1): expected lower < upper"),
        (
            'a "-a" r (0, 0.00001)',
            "p.txt:1: parameter 'a', domain (0, 0.00001): expected bounds of at most 4 digits",
        ),
        ('a "-a" r (-1e308, 1e308)', "p.txt:1: parameter 'a', domain "),
        ('a "-a" r (-1e308, 1e308)', ": expected a finite difference, found too large bounds"),
        ('a "-a" i (0, 2147483648)', "expected integers up to 2147483647, found too large bounds"),
        ('a "-a" c,log (1, 2)', "p.txt:1: parameter 'a': only integer and real parameters may be log"),
        ('a "-a" c (1, 1)', "p.txt:1: parameter 'a': expected different values, found '1' twice"),
        (
            'a "" c (x)\nb "" c (x)\na "" c (y)',
            "p.txt:3, column 1: expected a new name, as line 1 has this one",
        ),
        ('a "" i (1,2) | b > 1', "p.txt: parameter 'a': expected names of parameters, found 'b'"),
        ('a "" c (x)\n[forbiden]', "p.txt:2, column 1: expected [forbidden] or [global], found [forbiden]"),
        (
            'a "" c (x)\n[global]\ndigit = 2',
            "p.txt:3, column 1: expected digits = 1 .. 15 (parameters belong before [forbidden] and [global]), "
            "found 'digit = 2'",
        ),
        (
            '[global]\ndigits = 4\na "" c (x)',
            "p.txt:3, column 1: expected digits = 1 .. 15 (parameters belong before [forbidden] and [global]), "
            "found 'a \"\" c (x)'",
        ),
        (
            'a "" c (x)\n[global]\ndigits = 16',
            "p.txt:3, column 1: expected digits = 1 .. 15 (parameters belong before [forbidden] and [global]), "
            "found 'digits = 16'",
        ),
        ('a "" c (x)\n[forbidden]\na == ', "p.txt:3, column 5: expected a value, a parameter or '('"),
        (
            'a "" c (x)\n[forbidden]\nb == 1',
            "p.txt: forbidden b == 1: expected names of parameters, found 'b'",
        ),
    ],
)
def test_a_wrong_text_is_refused_with_its_place(text, message):
    with pytest.raises(RaceError, match=re.escape(message)):
        parse_space(text, "p.txt")
