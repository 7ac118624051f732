import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mercator_design.modules.behaviours import (
    TURN_CYCLES,
    anti_phototaxis,
    attraction,
    exploration,
    phototaxis,
    repulsion,
    stop,
    wheels_from_vector,
)
from mercator_design.modules.reference import Readings, ReferenceModel, drive

MODEL = ReferenceModel()


def explored(readings, tau, u, cycles):
    """The wheels of exploration: `readings` in the first cycle, nothing perceived in the others."""
    memory = [0.0, 0.0]
    return [exploration(MODEL, readings if k == 0 else Readings(), memory, u, tau) for k in range(cycles)]


@pytest.mark.parametrize(("u", "turns"), [(0.0, 1), (0.05, 1), (0.1, 2), (0.35, 7), (0.999999, 19)])
def test_exploration_turns_for_a_random_number_of_cycles_below_tau(u, turns):
    wheels = explored(Readings(proximity_x=0.5, proximity_y=-0.1), 20, u, 30)
    ahead, left = drive(1, 1), drive(-1, 1)
    assert wheels == [ahead] + [left] * turns + [ahead] * (29 - turns)


@given(st.integers(0, 100), st.floats(0, 1, exclude_max=True))
def test_exploration_never_turns_for_tau_cycles_or_more(tau, u):
    wheels = explored(Readings(proximity_x=1.0), tau, u, 105)
    turns = sum(w != drive(1, 1) for w in wheels)
    assert 1 <= turns <= max(1, tau - 1)


@pytest.mark.parametrize(
    ("x", "y", "turn"),
    [
        (0.5, -0.5, drive(-1, 1)),  # obstacle on the right: to the left
        (0.5, 0.5, drive(1, -1)),
        (0.5, 0.0, drive(1, -1)),  # straight ahead: to the right
        (0.0, 0.1, drive(1, -1)),  # just beside, just strong enough
        (0.0999, 0.0, drive(1, 1)),  # too weak
        (-0.01, 0.9, drive(1, 1)),  # behind
    ],
)
def test_exploration_turns_away_from_what_is_in_front(x, y, turn):
    assert explored(Readings(proximity_x=x, proximity_y=y), 10, 0.5, 2)[1] == turn


def test_exploration_looks_again_after_a_turn():
    memory = [0.0, 0.0]
    obstacle = Readings(proximity_x=1.0)
    wheels = [exploration(MODEL, obstacle, memory, 0.0, 1) for _ in range(6)]
    assert wheels == [drive(1, 1), drive(1, -1)] * 3
    assert memory[TURN_CYCLES] == 0


def test_stop_stops():
    assert stop(MODEL, Readings(proximity_x=1.0), [], 0.3) == drive(0, 0)


@given(st.floats(-math.pi, math.pi), st.floats(0.2, 10))
def test_wheels_steer_towards_the_vector_with_one_tread_at_full_speed(angle, length):
    left, right, *_ = wheels_from_vector(MODEL, length * math.cos(angle), length * math.sin(angle))
    assert max(left, right) == 1.0
    assert min(left, right) == pytest.approx(math.cos(angle), abs=1e-9)
    if abs(angle) > 1e-6 and abs(angle) < 3.14159:
        assert (right > left) == (angle > 0)


def test_a_weak_vector_counts_as_none():
    assert wheels_from_vector(MODEL, -0.0999, 0.0) == drive(1, 1)
    assert wheels_from_vector(MODEL, 0.0, 0.0) == drive(1, 1)
    assert wheels_from_vector(MODEL, -0.1, 0.0) == drive(1, -1)  # straight behind: spin


def test_the_inner_wheel_is_not_slower_than_the_slowest():
    model = MODEL._replace(slowest_wheel=-0.5)
    assert wheels_from_vector(model, -1.0, 0.0) == drive(1, -0.5)
    assert wheels_from_vector(model, -0.8, 0.6) == drive(-0.5, 1)
    assert wheels_from_vector(model, -0.4, 0.9) == wheels_from_vector(MODEL, -0.4, 0.9)  # faster than that
    assert wheels_from_vector(model, 0.6, -0.8) == drive(1, 0.6)


@pytest.mark.parametrize(
    ("behaviour", "readings", "vector"),
    [
        (attraction, Readings(neighbours_x=0.2, neighbours_y=0.6), (1.2 * 3 * 0.2, 1.2 * 3 * 0.6)),
        (repulsion, Readings(neighbours_x=0.2, neighbours_y=0.6), (-3 * 0.2, -3 * 0.6)),
        (
            attraction,
            Readings(neighbours_x=0.5, proximity_x=0.1, proximity_y=0.3),
            (1.2 * 3 * 0.5 - 5 * 0.1, -5 * 0.3),
        ),
        (
            repulsion,
            Readings(neighbours_x=0.5, proximity_x=0.1, proximity_y=0.3),
            (-3 * 0.5 - 5 * 0.1, -5 * 0.3),
        ),
        (phototaxis, Readings(light_x=0.6, light_y=-0.8, proximity_y=0.1), (0.6, -0.8 - 0.5)),
        (anti_phototaxis, Readings(light_x=0.6, light_y=-0.8, proximity_y=0.1), (-0.6, 0.8 - 0.5)),
        (attraction, Readings(), (0.0, 0.0)),
    ],
)
def test_vector_behaviours_follow_the_papers_equations(behaviour, readings, vector):
    alpha = [3.0] if behaviour in {attraction, repulsion} else []
    assert behaviour(MODEL, readings, [], 0.5, *alpha) == pytest.approx(wheels_from_vector(MODEL, *vector))


def test_strength_is_data_of_the_reference_model():
    original = MODEL._replace(strength_step=1.0, repulsion_power=2.0)
    readings = Readings(neighbours_x=0.011)
    # 1.2 * 0.011 * alpha reaches 0.1 at alpha = 7.6; with power 2 repulsion needs 0.011 * alpha^2 >= 0.1.
    behind = drive(1, -1)
    assert repulsion(original, readings, [], 0.5, 4.0) == behind
    assert repulsion(original, readings, [], 0.5, 3.9) == drive(1, 1)  # 3.9 counts as 3
    assert repulsion(MODEL, readings, [], 0.5, 4.0) == drive(1, 1)
