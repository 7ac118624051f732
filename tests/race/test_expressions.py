import pickle

import pytest

from mercator_design.errors import RaceError
from mercator_design.race.expressions import Expression
from mercator_design.race.operations import number_text

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
        ("big == 100000", True),
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
        ("n = 3", 3, "a number, a name, text or an operator", "'='"),
        ('rule == "fast', 9, "a number, a name, text or an operator", "'\"'"),
        ("sqrt(n) > 1", 1, "one of min, max", "'sqrt'"),
        ("floor(n, 2)", 1, "1 argument of floor", "'2'"),
        ("round(n, 2, 3)", 1, "1 to 2 arguments of round", "'3'"),
        ("n n", 3, "an operator or the end", "'n'"),
        ("min()", 5, "a value, a parameter or '('", "')'"),
    ],
)
def test_a_wrong_text_is_refused_with_its_place(text, column, expected, found):
    with pytest.raises(RaceError) as error:
        Expression(text, source="parameters.txt", line=7)
    assert str(error.value).startswith(f"parameters.txt:7, column {column}: expected {expected}")
    assert str(error.value).endswith(f"found {found}")


@pytest.mark.parametrize("text", ["n > 1", "!n", "n & 1", "n | 1", "'a'", "as.numeric(n)", "n %in% 1", "c(1)"])
def test_bounds_are_arithmetic(text):
    with pytest.raises(RaceError, match="expected"):
        Expression(text, arithmetic=True)


@pytest.mark.parametrize("text", ["rule + 1", "n & rule", "c(1, 2) == n", "-rule", "min(rule, 1)"])
def test_operands_of_the_wrong_type_are_named(text):
    with pytest.raises(RaceError, match=r"expected .*, found .*"):
        Expression(text)(GIVEN)


def test_a_condition_of_the_wrong_type_is_named():
    with pytest.raises(RaceError, match=r"rule: expected TRUE or FALSE, found 'fast' \(with rule = 'fast'\)"):
        Expression("rule").holds(GIVEN)


def test_a_long_row_of_conditions():
    text = " & ".join(["n == 3"] * 5000)
    assert Expression(text).holds(GIVEN)
    assert Expression(f"n == 4 | {text}").holds(GIVEN)
    assert Expression(" | ".join(["n == 4"] * 5000)).holds(GIVEN) is False


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("(" * 3000 + "n" + ")" * 3000, "line 1, column 42: expected at most 40 parentheses, .* found '\\('"),
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
        ("round(n, 1 / 0)", "cannot convert float infinity to integer"),
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


def test_numbers_are_written_without_exponents():
    assert [number_text(x) for x in (1e-10, 1e15, 0.1 + 0.2, 3, -0.0001, 10**20)] == [
        "0.0000000001",
        "1000000000000000",
        "0.3",
        "3",
        "-0.0001",
        "100000000000000000000",
    ]
