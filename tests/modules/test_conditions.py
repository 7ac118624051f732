import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.modules.conditions import (
    COLOUR_LABELS,
    black_floor,
    colour_label,
    fixed_probability,
    floor_colour,
    gray_floor,
    inverted_neighbours_count,
    logistic,
    neighbours_count,
    white_floor,
)
from mercator_design.modules.reference import Readings, ReferenceModel

MODEL = ReferenceModel()
BETA = 0.7
COLOURS = {
    "black": (0, 0, 0),
    "gray": (127, 127, 127),
    "white": (255, 255, 255),
    "green": (0, 255, 0),
    "blue": (0, 0, 255),
    "red": (255, 0, 0),
    "yellow": (255, 255, 0),
}


def on(colour):
    red, green, blue = COLOURS.get(colour, colour)
    return Readings(ground_red=float(red), ground_green=float(green), ground_blue=float(blue))


@pytest.mark.parametrize("colour", COLOURS)
def test_floor_conditions_fire_on_their_levels_only(colour):
    """Colours count by brightness: green (150) is gray, yellow (226) white; red (76) and blue (29) are neither."""
    fires = {
        "black": (black_floor,),
        "gray": (gray_floor,),
        "white": (white_floor,),
        "green": (gray_floor,),
        "yellow": (white_floor,),
    }
    for condition in (black_floor, gray_floor, white_floor):
        expected = BETA if condition in fires.get(colour, ()) else 0.0
        assert condition(MODEL, on(colour), [], BETA) == expected


@pytest.mark.parametrize(
    ("condition", "level", "fires"),
    [
        (black_floor, 12, True),
        (black_floor, 13, False),
        (white_floor, 198, False),
        (white_floor, 199, True),
        (gray_floor, 76, False),
        (gray_floor, 77, True),
        (gray_floor, 178, True),
        (gray_floor, 179, False),
    ],
)
def test_floor_thresholds_are_the_papers(condition, level, fires):
    assert condition(MODEL, on((level, level, level)), [], BETA) == (BETA if fires else 0.0)


@pytest.mark.parametrize("colour", COLOURS)
@pytest.mark.parametrize("label", range(4))
def test_colour_condition_fires_on_its_label_only(colour, label):
    assert floor_colour(MODEL, on(colour), [], BETA, label) == (BETA if COLOUR_LABELS[label] == colour else 0.0)


def test_a_label_that_is_none_matches_nothing():
    for label in (-1, 4, 99):
        assert all(floor_colour(MODEL, on(colour), [], BETA, label) == 0.0 for colour in COLOURS)


def test_red_is_recognised_on_both_sides_of_hue_zero():
    assert COLOUR_LABELS[colour_label(MODEL, 255, 10, 0)] == "red"
    assert COLOUR_LABELS[colour_label(MODEL, 255, 0, 10)] == "red"
    linear = MODEL._replace(hue_period=1e9)
    assert colour_label(linear, 255, 0, 10) == -1


@pytest.mark.parametrize(
    "colour",
    [(127, 127, 127), (0, 0, 0), (255, 60, 60), (255, 128, 0), (0, 255, 255), (120, 130, 125)],
)
def test_gray_pale_and_in_between_show_no_label(colour):
    assert colour_label(MODEL, *colour) == -1


@pytest.mark.parametrize(("hue", "found"), [(14.9, True), (15.1, False)])
def test_hue_tolerance(hue, found):
    green = 255 * hue / 60
    assert (colour_label(MODEL, 255, green, 0) == 2) == found


@given(st.integers(0, 20), st.integers(0, 10), st.floats(0, 20))
def test_neighbour_conditions_are_the_papers_logistic(n, xi, eta):
    readings = Readings(neighbours=float(n))
    p = neighbours_count(MODEL, readings, [], xi, eta)
    assert p == pytest.approx(1 / (1 + math.exp(eta * (xi - n))) if eta * (xi - n) < 700 else 0.0)
    assert inverted_neighbours_count(MODEL, readings, [], xi, eta) == 1 - p
    if n == xi:
        assert p == 0.5


@pytest.mark.parametrize(("n", "p"), [(0, 0.047), (1, 0.119), (2, 0.269), (3, 0.5), (4, 0.0), (9, 0.0)])
def test_counts_that_wrap_are_those_of_unsigned_numbers(n, p):
    model, readings = MODEL._replace(count_wraps=1.0), Readings(neighbours=float(n))
    assert neighbours_count(model, readings, [], 3, 1.0) == pytest.approx(p, abs=5e-4)
    assert inverted_neighbours_count(model, readings, [], 3, 1.0) == pytest.approx(1 - p, abs=5e-4)
    assert neighbours_count(model, readings, [], 3, 0.0) == 0.5


@given(st.floats(allow_nan=False))
def test_logistic_is_a_probability_for_any_number(x):
    assert 0.0 <= logistic(x) <= 1.0
    assert logistic(x) == pytest.approx(1 - logistic(-x))


def test_fixed_probability():
    assert fixed_probability(MODEL, Readings(), [], 0.3) == 0.3
