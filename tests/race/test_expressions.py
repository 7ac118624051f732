import json
import pickle
from pathlib import Path

import pytest

from mercator_design.errors import RaceError
from mercator_design.race.space.expressions import Expression
from mercator_design.race.space.r_operators import number, number_text

GIVEN = {"n": 3, "x": 0.5, "s": "1", "rule": "fast", "big": "100000"}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("n", 3),
        ("rule", "fast"),
        ("1e2", 100),
        ("2L + .5", 2.5),
        ("n == 3", True),
        ("n != 3", False),
        ("x < n", True),
        ("n <= 2", False),
        ("n >= 3", True),
        ("n > 3", False),
        ('rule == "fast"', True),
        ("rule == 'slow'", False),
        ("1 + 2 * 3 - 4 / 2", 5),
        ("-n + 1", -2),
        ("- -n", 3),
        ("(1 + 2) * n", 9),
        ("10 - 3 - 2", 5),
        ("7 %% 4 * 2", 6),
        ("-7 %% 4", 1),
        ("2 * n %% 2", 2),
        ("1 / 0 > 10", True),
        ("min(n, 2, x)", 0.5),
        ("max(n, 2)", 3),
        ("round(2.5)", 2),
        ("round(3.14159, 2)", 3.14),
        ("floor(-0.5)", -1),
        ("ceiling(0.2)", 1),
        ("trunc(-1.7)", -1),
        ("n > 1 & x > 1 | TRUE", True),
        ("TRUE | FALSE & FALSE", True),
        ("!n == 3", False),
        ("!(n == 3) | x == 0.5", True),
        ("n > 1 && x < 1", True),
        ("n > 5 || x < 1", True),
        ("n %in% c(1, 2, 3)", True),
        ("n %in% c(1, 2)", False),
        ("!n %in% c(1, 2)", True),
        ('rule %in% c("slow", "fast")', True),
        ("2 ^ 3 ^ 0", 2.0),
        ("-n ^ 2", -9.0),
        ("4 ^ -x", 0.5),
        ("2 * n ^ 2", 18.0),
        ("0 ^ -1 > 1e300 & (-10) ^ 309 < 0 & 10 ^ 400 > 0", True),
        ("7 %/% 2 * 2", 6),
        ("-7 %/% 2", -4),
        ("log(8, 2)", 3.0),
        ("log(1)", 0.0),
        ("log(0) < 0", True),
        ("as.logical('T') & !as.logical('false') & as.logical(n)", True),
        ("as.numeric(s) + 1", 2),
        ("as.numeric(s) > 0 & n < 4", True),
        ("round(n, -99999999) == 0", True),
        ("round(n, 1 / 0) == n", True),
        ("round(1.25, 99999999)", 1.25),
        ("ifelse(TRUE, seq(1, 2, length.out = 0), 1)", None),
    ],
)
def test_value(text, value):
    found = Expression(text)(GIVEN)
    assert found == value
    assert isinstance(found, bool) == isinstance(value, bool)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("s == 1", True),
        ("1 == s", True),
        ("s == 1.0", True),
        ("s != 2", True),
        ("s %in% c(0, 1)", True),
        ("s == '01'", False),
        ("big == 100000", False),
        ("big == 100000L", True),
        ("s == TRUE", False),
        ("TRUE == 1", True),
    ],
)
def test_text_and_numbers_compare_as_text(text, value):
    assert Expression(text)(GIVEN) is value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("gone", None),
        ("gone == 1", None),
        ("gone + 1", None),
        ("!gone", None),
        ("min(gone, 1)", None),
        ("as.numeric(gone)", None),
        ("as.numeric(rule)", None),
        ("0 / 0", None),
        ("n %% 0", None),
        ("0 %/% 0", None),
        ("(-8) ^ x", None),
        ("log(-1)", None),
        ("as.logical(rule)", None),
        ("as.numeric('1_0')", None),
        ("NA", None),
        ("gone == gone", None),
        ("FALSE & gone", False),
        ("gone & FALSE", False),
        ("TRUE & gone", None),
        ("TRUE | gone", True),
        ("gone | TRUE", True),
        ("FALSE | gone", None),
        ("gone %in% c(1, 2)", False),
        ("gone %in% c(1, NA)", True),
        ("is.na(gone)", True),
        ("is.na(n)", False),
        ("is.na(gone) | gone > 3", True),
    ],
)
def test_missing_values_follow_three_valued_logic(text, value):
    assert Expression(text)(GIVEN) is value


def test_a_condition_that_is_missing_does_not_hold():
    values = [None, False, True, 0, 2]
    assert [Expression("c").holds({"c": value}) for value in values] == [False, False, True, False, True]


@pytest.mark.parametrize(
    ("text", "column", "expected", "found"),
    [
        ("", 1, "a value, a parameter or '('", "the end"),
        ("n ==", 5, "a value, a parameter or '('", "the end"),
        ("n == 3)", 7, "an operator or the end", "')'"),
        ("(n == 3", 8, "')'", "the end"),
        ("1 < n < 3", 7, "an operator or the end", "'<'"),
        ("n = 3", 3, "an operator or the end", "'='"),
        ("n ? 3", 3, "a number, a name, text or an operator", "'?'"),
        ('rule == "fast', 9, "a number, a name, text or an operator", "'\"'"),
        ("paste(n) > 1", 1, "one of min, max", "'paste'"),
        ("floor(n, 2)", 1, "1 argument of floor", "'2'"),
        ("round(n, 2, 3)", 1, "1 to 2 arguments of round", "'3'"),
        ("n n", 3, "an operator or the end", "'n'"),
        ("min()", 1, "1 or more arguments of min", "'0'"),
        ("grepl('a')", 1, "2 to 5 arguments of grepl", "'1'"),
        ("seq(1, to = 2, from = 3, 4, 5)", 1, "1 to 4 arguments of seq", "'5'"),
        ("round(n, digit = 2, digits = 2)", 1, "one argument 'digits' of round", "'3'"),
        ("grepl('a', rule, colour = TRUE)", 1, "arguments pattern, x, ignore.case, perl, fixed of grepl", "'3'"),
        ("1:n:", 5, "a value, a parameter or '('", "the end"),
    ],
)
def test_a_wrong_text_is_refused_with_its_place(text, column, expected, found):
    with pytest.raises(RaceError) as error:
        Expression(text, source="parameters.txt", line=7)
    assert str(error.value).startswith(f"parameters.txt:7, column {column}: expected {expected}")
    assert str(error.value).endswith(f"found {found}")


@pytest.mark.parametrize(
    "text", ["n > 1", "!n", "n & 1", "n | 1", "'a'", "as.numeric(n)", "n %in% 1", "c(1)", "1:n", "sqrt(n)", "seq(n)"]
)
def test_bounds_are_arithmetic(text):
    with pytest.raises(RaceError, match="expected"):
        Expression(text, arithmetic=True)


@pytest.mark.parametrize(
    "text",
    [
        "rule + 1", "n & rule", "-rule", "min(rule, 1)", "xor(rule, TRUE)", "any(rule)", "rule:3", "NA:3", "1:1000000",
        "seq(1, 10, by = -1)", "seq(1, 1e9, 0.1)", "seq(1, NA)", "grepl('(', rule)", "1:(1/0)",
        "seq(1, 2, by = 1, length.out = 3)",
    ],
)  # fmt: skip
def test_operands_of_the_wrong_type_are_named(text):
    with pytest.raises(RaceError, match=r"expected .*, found .*"):
        Expression(text)(GIVEN)


def members(value):
    """Of a vector, which is a tuple of ours and a list of JSON's."""
    return list(value) if isinstance(value, (tuple, list)) else [value]


R_VALUES = json.loads((Path(__file__).parents[1] / "data" / "r_expressions.json").read_text())


@pytest.mark.parametrize(("text", "kind", "value"), R_VALUES["values"], ids=[text for text, *_ in R_VALUES["values"]])
def test_what_r_makes_of_it(text, kind, value):
    """What R printed, by tests/data/r_expressions.R."""
    found, expected = members(Expression(text)(GIVEN)), members(value)
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        if one is None or other is None:
            assert one is other
        else:
            assert isinstance(one, bool) == (kind == "logical")
            assert one == pytest.approx(other, rel=1e-14) if kind == "double" else one == other


def test_a_name_in_backticks():
    expression = Expression("`rule` == 'fast' & `2opt` > 1")
    assert expression.names == ("rule", "2opt")
    assert expression({"rule": "fast", "2opt": 2}) is True


def test_what_irace_refuses_is_noted():
    expression = Expression("n > 1 && x < 1 || n == 100000", source="p.txt", line=3)
    assert expression.double_operators == ("p.txt:3, column 7: irace refuses '&&' here: write '&'",
                                  "p.txt:3, column 16: irace refuses '||' here: write '|'")  # fmt: skip
    [(name, note)] = expression.ambiguous_numbers
    assert (name, note.partition(": ")[2]) == (
        "n", "R compares text with '1e+05' where a condition has the number 100000: put it in quotes"
    )  # fmt: skip
    assert Expression("n %in% c(1, 2L, 100000L) & x > 0.5").ambiguous_numbers == ()


def test_a_condition_of_the_wrong_type_is_named():
    with pytest.raises(RaceError, match=r"rule: expected TRUE or FALSE, found 'fast' \(with rule = 'fast'\)"):
        Expression("rule").holds(GIVEN)
    with pytest.raises(RaceError, match=r"expected TRUE or FALSE, found \(False, False\)"):
        Expression("c(1, 2) == n").holds(GIVEN)


def test_a_long_row_of_conditions():
    text = " & ".join(["n == 3"] * 5000)
    assert Expression(text).holds(GIVEN)
    assert Expression(f"n == 4 | {text}").holds(GIVEN)
    assert Expression(" | ".join(["n == 4"] * 5000)).holds(GIVEN) is False


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("(" * 3000 + "n" + ")" * 3000, "line 1, column 42: expected at most 40 nested parentheses, .* found '\\('"),
        ("!" * 3000 + "n", "at most 40"),
        ("-" * 3000 + "n", "at most 40"),
        ("n ^ " * 3000 + "n", "at most 40"),
        ("floor(" * 3000 + "n" + ")" * 3000, "at most 40"),
        ("+".join(["n"] * 5000), "expected fewer operators in a row"),
        (f"n / 3 * {'9' * 300} * {'9' * 300}", None),
        (f"n * {'9' * 400} / 3", None),
        (f"floor({'9' * 400})", None),
        (f"floor(n * {'9' * 5000})", None),
        ("*".join(["1000000000000000"] * 30), None),
    ],
)
def test_too_deep_too_long_too_large(text, message):
    """Numbers are R's: infinite beyond 1e308."""
    if message is None:
        assert Expression(text)(GIVEN) > 1e300
        return
    with pytest.raises(RaceError, match=message):
        Expression(text)(GIVEN)


def test_forty_within_one_another_are_few_enough():
    assert Expression("(" * 40 + "n" + ")" * 40)(GIVEN) == 3


def test_an_expression_knows_its_names_and_can_be_sent_to_other_processes():
    expression = Expression(" a > 1 & (b == 2 | a < 0) ")
    assert expression.names == ("a", "b")
    again = pickle.loads(pickle.dumps(expression))  # noqa: S301 - our own
    assert again == expression
    assert again({"a": 2, "b": 2}) is True


@pytest.mark.parametrize(
    ("text", "value"),
    [("0x1A", 26), ("-0X10", -16), ("0x1.8p1", 3), ("0x.8", 0.5), ("1.", 1), (".5", 0.5), (" 7 ", 7), ("+1e-3", 1e-3),
     ("1e400", float("inf")), ("-inf", float("-inf")), ("Infinity", float("inf")), ("0x1p99999", float("inf"))],
)  # fmt: skip
def test_numbers_are_r_s(text, value):
    assert number(text) == value


@pytest.mark.parametrize("text", ["", ".", "1_0", "1L", "1d2", "0x", "\u0661", "1 2", "ten", "NA"])
def test_what_is_no_number_to_r(text):
    with pytest.raises(ValueError, match=r"^"):
        number(text)


def test_numbers_are_written_without_exponents():
    assert [number_text(x) for x in (1e-10, 1e15, 0.1 + 0.2, 3, -0.0001, 10**20, -0.0)] == [
        "0.0000000001",
        "1000000000000000",
        "0.3",
        "3",
        "-0.0001",
        "100000000000000000000",
        "0",
    ]


def test_whole_and_real_numbers_are_not_the_same_value():
    text = Expression("ifelse(x > 0, as.character(n), s)")
    assert [text({"x": 0.5, "n": value, "s": ""}) for value in (100000.0, 100000)] == ["1e+05", "100000"]
