import math
import pickle

import pytest

from mercator_design.errors import RaceError
from mercator_design.race import Parameter, Space, categorical, integer, ordered, parse_space, real
from tests.race.spaces import machines

PARAMETERS = [
    categorical("c1", ["a", "b", "c", "d"]),
    ordered("o1", [1, 2, 5, 10, 20]),
    integer("i1", 1, 100),
    integer("il", 1, 1000, log=True),
    real("r1", -5, 5),
    real("rl", 0.001, 10, log=True),
]


@pytest.mark.parametrize("parameter", PARAMETERS, ids=lambda parameter: parameter.name)
def test_position_undoes_quantile(parameter):
    bounds = parameter.bounds({})
    for u in (0.0, 0.2, 0.5, 0.77, 0.999, 1.0):
        value = parameter.quantile(u, bounds)
        position = parameter.position(value, bounds)
        assert 0 <= position <= 1
        assert parameter.quantile(position, bounds) == value


def test_a_grammar_of_machines_is_read():
    space = machines()
    assert (len(space.parameters), space.n_variable, max(space.levels.values())) == (149, 149, 4)
    assert space["P3x3"].digits == 2
    small = {"NumStates": 1, "S0": "1"}
    space.check(small)
    assert space.command_line(small) == "--nstates 1 --s0 1"
    space.check({"NumStates": 2, "S0": "1", "S1": "1", **_connection(0), **_connection(1)})


def _connection(state):
    return {
        f"NumConnections{state}": 1,
        f"N{state}x0": 0,
        f"C{state}x0": "3",
        f"B{state}x0": 5,
        f"W{state}x0": 0.25,
    }


def example():
    return Space(
        [
            categorical("rule", ["slow", "fast"]),
            integer("n", 1, 10),
            integer("m", 1, "n", condition='rule == "fast"'),
            real("x", 0, 1, condition="m > 3"),
            categorical("fixed", ["only"]),
        ],
        forbidden=['rule == "slow" & n > 8'],
    )


def test_what_is_active_follows_conditions_by_level():
    space = example()
    assert space.levels == {"rule": 1, "n": 1, "m": 2, "x": 3, "fixed": 1}
    assert space.n_variable == 4
    built = space.build(lambda parameter, bounds: parameter.quantile(0.99, bounds))
    assert built == {"rule": "fast", "n": 10, "m": 10, "x": 0.99, "fixed": "only"}
    built = space.build(lambda parameter, bounds: parameter.quantile(0.0, bounds))
    assert built == {"rule": "slow", "n": 1, "fixed": "only"}


@pytest.mark.parametrize(
    ("configuration", "message"),
    [
        ({"rule": "slow", "n": 1}, "parameter 'fixed': expected its only value"),
        ({"rule": "quick", "n": 1, "fixed": "only"}, 'expected one of "slow", "fast", found \'quick\''),
        ({"rule": "slow", "n": 1.5, "fixed": "only"}, r"'n': expected integer within \(1, 10\), found 1.5"),
        ({"rule": "slow", "n": True, "fixed": "only"}, "'n': expected integer .* found True"),
        ({"rule": "slow", "n": 11, "fixed": "only"}, "'n': expected integer .* found 11"),
        ({"rule": "fast", "n": 5, "fixed": "only"}, r"'m': expected a value in \(1, n\), found none"),
        (
            {"rule": "fast", "n": 5, "m": 6, "fixed": "only"},
            r"'m': expected integer within \(1, 5\), found 6",
        ),
        (
            {"rule": "slow", "n": 5, "m": 1, "fixed": "only"},
            "'m': expected no value as it is inactive, found 1",
        ),
        (
            {"rule": "slow", "n": 5, "fixed": "other"},
            "'fixed': expected its only value 'only', found 'other'",
        ),
        ({"rule": "slow", "n": 5, "fixed": "only", "nn": 1}, "expected names of parameters, found 'nn'"),
        ({"rule": "slow", "n": 9, "fixed": "only"}, "as it is forbidden"),
        ({"rule": "fast", "n": 5, "m": 4, "x": "0", "fixed": "only"}, "'x': expected real .* found '0'"),
        ({"rule": "fast", "n": 5, "m": 4, "x": math.nan, "fixed": "only"}, "'x': expected real .* found nan"),
    ],
)
def test_a_configuration_that_is_not_valid_is_refused(configuration, message):
    with pytest.raises(RaceError, match=message):
        example().check(configuration)


def test_a_dependent_domain_may_be_one_value_but_not_empty():
    parameter = integer("m", 0, "n-2")
    assert parameter.bounds({"n": 2}) == (0, 0)
    assert parameter.quantile(0.7, (0, 0)) == 0
    assert parameter.position(0, (0, 0)) == 0.5
    assert parameter.bounds({}) is None
    with pytest.raises(
        RaceError, match=r"'m', domain \(0, n-2\): expected finite lower <= upper, found \(0, -1\) with n = 1"
    ):
        parameter.bounds({"n": 1})
    with pytest.raises(RaceError, match=r"expected finite lower <= upper, found \(0, inf\) with n = 1"):
        integer("m", 0, "1 / (n - 1)").bounds({"n": 1})


def test_a_parameter_whose_bounds_are_missing_is_inactive():
    space = Space([categorical("a", [1, 2]), integer("b", 1, 9, condition="a == 1"), integer("c", 0, "b")])
    space.check({"a": "2"})
    with pytest.raises(RaceError, match="'c': expected no value as it is inactive"):
        space.check({"a": "2", "c": 0})


def test_constant_expressions_are_bounds_like_numbers():
    parameter = integer("m", "2*3", "max(7, 10)")
    assert (parameter.low, parameter.high, parameter.is_dependent) == (6, 10, False)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: integer("a", 1, 1), "expected lower < upper"),
        (lambda: integer("a", 2, 1), "expected lower < upper"),
        (lambda: integer("a", 1.5, 3), "expected whole numbers, found 1.5"),
        (lambda: real("a", 0, 1, log=True), "expected a lower bound above 0"),
        (lambda: real("a", 0, 0.12345), "expected bounds of at most 4 digits, found 0.12345"),
        (lambda: real("a", 0, 1, digits=0), "expected 1 to 15 digits"),
        (lambda: real("a", 0, math.inf), "expected finite bounds"),
        (lambda: real("a", 0, math.nan), "expected finite bounds"),
        (lambda: integer("a", 1, "b", log=True), "found a dependent domain"),
        (lambda: categorical("a", []), "expected at least one value"),
        (lambda: categorical("a", ["x", "y", "x"]), "found 'x' twice"),
        (lambda: ordered("a", [1, 5, 2]), "expected increasing numbers"),
        (lambda: ordered("a", [1, 1.0, 2]), r"expected increasing numbers, found \(1, 1.0, 2\)"),
        (lambda: integer("a", 0, "1" * 400), "expected finite bounds"),
        (lambda: integer("a", 1, f"floor({'1' * 400})"), "expected finite bounds"),
        (lambda: Parameter(name="a", kind="categorical", values=("x",), log=True), "may be log"),
        (lambda: Space([integer("a", 1, 2), real("a", 0, 1)]), "'a': expected a new name"),
        (lambda: Space([integer("a", 1, "b")]), "'a': expected names of parameters, found 'b'"),
        (lambda: Space([integer("a", 1, 2, condition="b > 1")]), "found 'b'"),
        (lambda: Space([integer("a", 1, "b"), categorical("b", [1, 2])]), "found 'b', which is categorical"),
        (lambda: Space([integer("a", 1, "b"), integer("b", 1, "a")]), "depends on itself"),
        (lambda: Space([integer("a", 1, 3, condition="a > 1")]), "depends on itself"),
        (lambda: Space([integer("a", 1, 3)], forbidden=["b == 1"]), "forbidden b == 1: .* found 'b'"),
    ],
)
def test_a_space_that_is_not_valid_is_refused(make, message):
    with pytest.raises(RaceError, match=message):
        make()


def test_a_condition_that_is_neither_true_nor_false_is_said():
    space = parse_space('c "" c (0, 1)\ny "" i (0, 5) | c')
    with pytest.raises(RaceError, match=r"c: expected TRUE or FALSE, found '0' \(with c = '0'\)"):
        space.check({"c": "0", "y": 1})


def test_bounds_that_are_too_large_are_said():
    space = parse_space(f'a "" i (1, 5)\ny "" r (0, "a*{"9" * 400}/3")')
    with pytest.raises(RaceError, match=r"expected finite lower <= upper, found \(0, inf\) with a = 2"):
        space.check({"a": 2, "y": 1.0})


def test_ordered_text_need_not_be_numbers():
    assert ordered("size", ["small", "large"]).values == ("small", "large")


def test_a_forbidden_combination_is_not_one_that_is_missing():
    space = Space(
        [categorical("a", [1, 2]), integer("b", 1, 5, condition="a == 1")],
        forbidden=["b > 3", "a == 2 & b == 1"],
    )
    assert space.is_forbidden({"a": "1", "b": 4})
    assert not space.is_forbidden({"a": "2"})


def test_a_space_can_be_sent_to_other_processes():
    space = pickle.loads(pickle.dumps(example()))  # noqa: S301 - our own
    space.check({"rule": "fast", "n": 5, "m": 4, "x": 0.5, "fixed": "only"})


def test_a_long_chain_of_conditions_may_stand_in_any_order():
    n = 1200
    lines = [f'p{k} "" c (a, b) | p{k + 1} == "a"' for k in range(n)]
    space = parse_space("\n".join([*lines, f'p{n} "" c (a, b)']))
    assert (space.levels["p0"], space.levels[f"p{n}"]) == (n + 1, 1)
