"""Configurations as rows of numbers."""

import numpy as np
import pytest

from mercator_design.designer import flavour_space
from mercator_design.race import Space, integer, parse_space
from mercator_design.race.space.encoding import Encoding
from tests.race.mixed import MIXED
from tests.race.spaces import machines

SPACES = {
    "mixed": MIXED,
    "machines": machines(),
    "watermelon": flavour_space("watermelon"),
    "dependent": parse_space(
        'n "" i (1, 9)\nm "" i (1, "n")\nx "" r (0, "n / m") | n > 3\ny "" i (0, "2 * m") | x > 1'
    ),
    "several parents": parse_space(
        'a "" c (x, y, z)\nb "" o (1, 5, 9) | a != "z"\nr "" r (0, 1)\nc "" c (u, v) | a == "x" & b > 1 & r < 0.5'
    ),
    "logarithmic": parse_space('n "" i,log (1, 100)\nm "" i (1, 5) | n > 20\nk "" i,log (3, 90) | m > 2'),
    "fixed": parse_space('a "" c (x, y)\nf "" c (1) | a == "x"\nb "" i (1, 3) | f == 1\nc "" i (1, 3) | b > 1'),
    "below what is fixed": parse_space('a "" c (x)\nb "" i (1, 3) | a == "x"\nc "" r (0, 1) | b > 1'),
    "many values": parse_space(
        'a "" i (1, 500)\nb "" i (1, 500)\nc "" c (u, v) | a > b\nd "" i ("a", 1000) | c == "u"'
    ),
}


@pytest.fixture(params=SPACES)
def encoding(request):
    return Encoding(SPACES[request.param])


def anywhere(space, n, seed):
    draws = np.random.default_rng(seed)
    return [space.build(lambda p, bounds: p.quantile(draws.random(), bounds)) for _ in range(n)]


def test_a_row_has_a_number_for_each_active_parameter_and_is_decoded_again(encoding):
    space = encoding.space
    configurations = anywhere(space, 60, seed=1)
    rows = encoding.rows(configurations)
    for row, configuration in zip(rows, configurations, strict=True):
        active = {p.name for p, number in zip(space.variable, row, strict=True) if not np.isnan(number)}
        assert active == {p.name for p in space.variable if p.name in configuration}
        assert encoding.configuration(row) == pytest.approx(configuration)


def test_settled_rows_are_those_of_configurations(encoding):
    """But for the rounding of real values; also when it is known already what follows from the values."""
    space = encoding.space
    is_real = np.array([p.kind == "real" for p in space.variable])
    for seed in (2, 3):
        rows = encoding.settled(encoding.uniform(100, np.random.default_rng(seed)))
        configurations = [encoding.configuration(row) for row in rows]
        for configuration in configurations:
            space.check(configuration)
        again = encoding.rows(configurations)
        assert again[:, ~is_real] == pytest.approx(rows[:, ~is_real], abs=1e-12, nan_ok=True)
        assert again[:, is_real] == pytest.approx(rows[:, is_real], abs=1e-2, nan_ok=True)


def test_settled_rows_stay_as_they_are(encoding):
    """Values for inactive parameters are of no effect."""
    draws = np.random.default_rng(4)
    rows = encoding.settled(encoding.uniform(50, draws))
    filled = np.where(np.isnan(rows), encoding.uniform(50, draws), rows)
    assert encoding.settled(filled) == pytest.approx(rows, abs=1e-12, nan_ok=True)


def test_uniform_rows_have_all_values_equally_often():
    space = Space([integer("n", 0, 3)])
    encoding = Encoding(space)
    rows = encoding.settled(encoding.uniform(4000, np.random.default_rng(5)))
    numbers = np.bincount([encoding.configuration(row)["n"] for row in rows])
    assert numbers == pytest.approx(np.full(4, 1000), abs=150)  # five sigma are 137
